"""The fields of AutoDRIVE's ``Bridge`` event: text of numbers, in both directions. Pure.

Axes and units are those of the published OpenCAV: x forward, y left, z up; metres, radians,
seconds; quaternions x y z w; steering commands -1 to 1 of the largest angle, left positive;
throttle commands -1 to 1, negative ones in reverse.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from devkit.reference.lights import of_code
from schemas.files.kpi import HEADLIGHTS, INDICATORS
from schemas.messages import (
    ENCODER_COLUMNS,
    IMU_COLUMNS,
    POSE_COLUMNS,
    VEHICLE_COLUMNS,
    Command,
    Lights,
    Pose,
)

ENVIRONMENT = ("Auto Time", "Time Scale", "Time", "Weather", "Clouds", "Fog", "Rain", "Snow")
"""What a script may ask of the world; a campaign's matrix decides it instead."""

POSE_FIELDS = ("PosX", "PosY", "PosZ", "RotX", "RotY", "RotZ", "RotW")
"""Fields of a commanded pose, in the order of :class:`schemas.messages.Pose`."""

GRAVITY_MPS2 = 9.80665
"""What an IMU at rest measures, upwards [m/s^2]."""

NEARLY_ZERO_RAD = math.radians(0.005)
"""Unity's angles are rounded to hundredths of a degree where they are compared with zero [rad]."""

_REAR = (ENCODER_COLUMNS.index("rear_left_ticks"), ENCODER_COLUMNS.index("rear_right_ticks"))


class FieldError(ValueError):
    """A field is missing or is no number; one line."""


def telemetry(
    rows: Mapping[str, np.ndarray],
    images: Mapping[str, bytes],
    points: bytes,
    ticks_per_rev: float,
    *,
    reverse: bool = False,
) -> dict[str, str]:
    """What the AutoDRIVE Simulator says of its vehicle.

    Args:
        rows: last readings of ``vehicle``, ``encoders``, ``imu`` and ``pose``.
        images: JPEG files of ``front_left`` and ``front_right``.
        points: float32 x, y, z, intensity of every return of a lidar; may be empty.
        ticks_per_rev: encoder ticks per revolution of a wheel.
        reverse: the throttle drives backwards, and is sent as a negative number.
    """
    vehicle = dict(zip(VEHICLE_COLUMNS, rows["vehicle"], strict=True))
    imu = dict(zip(IMU_COLUMNS, rows["imu"], strict=True))
    pose = dict(zip(POSE_COLUMNS, rows["pose"], strict=True))
    quaternion = [pose[name] for name in ("qx", "qy", "qz", "qw")]
    ticks = [rows["encoders"][column] for column in _REAR]
    return {
        "V1 Collisions": "0",  # a case ends with its first
        "V1 Throttle": _text([-vehicle["throttle"] if reverse else vehicle["throttle"]]),
        "V1 Steering": _text([vehicle["steering_rad"]]),
        "V1 Brake": _text([vehicle["brake"]]),
        "V1 Handbrake": _text([vehicle["handbrake"]]),
        "V1 Encoder Ticks": " ".join(str(int(t)) for t in ticks),
        "V1 Encoder Angles": _text([2 * math.pi * (t / ticks_per_rev) for t in ticks]),
        "V1 Position": _text([pose[name] for name in ("x_m", "y_m", "z_m")]),
        "V1 Orientation Quaternion": _text(quaternion),
        "V1 Orientation Euler Angles": _text(euler(quaternion)),
        "V1 Angular Velocity": _text([imu[f"rate_{axis}_radps"] for axis in "xyz"]),
        "V1 Linear Acceleration": _text(acceleration(imu, quaternion)),
        "V1 Left Camera Image": base64.b64encode(images["front_left"]).decode(),
        "V1 Right Camera Image": base64.b64encode(images["front_right"]).decode(),
        "V1 LIDAR Pointcloud": base64.b64encode(points).decode(),
    }


def command(
    data: Any,
    slot: int,
    token: int,
    tick: int,
    steering_max_rad: float,
    aeb_brake: float,
    *,
    cosim: bool = False,
) -> Command:
    """What a script asks of the vehicle, as a command of the drive plane.

    Raises:
        FieldError: no mapping, a field missing or no number, or out of its range.
    """
    if not isinstance(data, dict):
        raise FieldError(f"answered {type(data).__name__} instead of the fields of 'Bridge'")
    pose = None
    if _number(data, "V1 CoSim", 0.0) != 0.0:
        if not cosim:
            raise FieldError(
                "V1 CoSim is set, but poses may not be commanded in this campaign; set it to 0, or "
                "autonomy.cosim to true"
            )
        pose = Pose(*(_number(data, f"V1 {name}") for name in POSE_FIELDS))
    # Who commands poses need not say anything of pedals, and they do nothing then.
    needed = 0.0 if pose is not None else None
    steering = _number(data, "V1 Steering", needed)
    if abs(steering) > 1.0 + 1e-9:
        raise FieldError(f"V1 Steering is {steering:g}, allowed: -1 to 1")
    throttle = _number(data, "V1 Throttle", needed)
    if abs(throttle) > 1.0 + 1e-9:
        raise FieldError(f"V1 Throttle is {throttle:g}, allowed: -1 to 1")
    brake = _number(data, "V1 Brake", 0.0)
    return Command(
        slot=slot,
        token=token,
        tick=tick,
        throttle=abs(throttle),
        brake=brake,
        steering_rad=steering * steering_max_rad,
        aeb=brake >= aeb_brake,
        lights=_lights(data),
        handbrake=_number(data, "V1 Handbrake", 0.0),
        pose=pose,
        reverse=throttle < 0.0,
    )


def asks_for_weather(data: Any) -> bool:
    """Whether a script says something of time or weather."""
    return isinstance(data, dict) and any(name in data for name in ENVIRONMENT)


def euler(quaternion: list[float]) -> list[float]:
    """Roll, pitch, yaw [rad] of a unit quaternion x y z w, each from 0 up to a full turn.

    As the AutoDRIVE Simulator sends them: Unity's angles have that range. There, rolls and yaws of
    less than 0.005 degrees below zero are sent as (nearly) zero.
    """
    x, y, z, w = quaternion
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return [_turned(roll, NEARLY_ZERO_RAD), _turned(pitch), _turned(yaw, NEARLY_ZERO_RAD)]


def _turned(angle: float, nearly_zero: float = 0.0) -> float:
    """``angle`` from 0 up to, and without, a full turn [rad]."""
    if -nearly_zero < angle <= 0.0:
        return 0.0
    turned = angle % (2 * math.pi)
    return turned if turned < 2 * math.pi else 0.0  # of a tiny negative number


def acceleration(imu: Mapping[str, float], quaternion: list[float]) -> list[float]:
    """The change of velocity along the vehicle's axes [m/s^2]; zero at rest.

    The AutoDRIVE Simulator differentiates the velocity of its car. An IMU measures gravity as well,
    which is taken out here by the true orientation.

    Args:
        imu: specific force by column.
        quaternion: x y z w, from vehicle to world axes.
    """
    x, y, z, w = quaternion
    up = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return [imu[f"accel_{axis}_mps2"] - GRAVITY_MPS2 * u for axis, u in zip("xyz", up, strict=True)]


def _lights(data: Mapping[str, Any]) -> Lights:
    code = _choice(data, "V1 Headlights", len(HEADLIGHTS))
    return of_code(code, _choice(data, "V1 Indicators", len(INDICATORS)))


def _choice(data: Mapping[str, Any], name: str, count: int) -> int:
    value = _number(data, name, 0.0)
    if not (0 <= value < count and value == int(value)):
        raise FieldError(f"{name} is {value:g}, allowed: 0 to {count - 1}")
    return int(value)


def _number(data: Mapping[str, Any], name: str, default: float | None = None) -> float:
    if name not in data:
        if default is None:
            raise FieldError(f"answered without the field '{name}'")
        return default
    try:
        return float(data[name])
    except (TypeError, ValueError, OverflowError):
        raise FieldError(f"{name} is {str(data[name])[:40]!r}, a number is needed") from None


def _text(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
