"""ROS 2 messages of a stack -> records of what it asks for.

A record says what the message says, in our units and signs, and no more: pedals are made of it by a
controller elsewhere. Only :class:`PlainDrive` holds the drive plane's own command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from schemas.messages import Command, Detection, Lights, Pose, SensorErrors
from twin.ros2.parts import MessageParts, nanoseconds_of
from twin.ros2.store import MessageError, TypeStore

DETECTIONS_MAX = 1000
"""Most detections of a command."""

_LEFT, _RIGHT, _HAZARD = 1, 2, 3


@dataclass(frozen=True, slots=True)
class PlainDrive:
    """The drive plane's command; its slot and token are 0."""

    stamp_ns: int
    command: Command


@dataclass(frozen=True, slots=True)
class AckermannDemand:
    """Wheel angle and speed, of ackermann_msgs and autoware_control_msgs."""

    stamp_ns: int | None
    """None: the message has no stamp."""
    steering_rad: float
    """Angle of the road wheels, left positive."""
    steering_rate_radps: float | None
    """None: as fast as possible."""
    speed_mps: float
    """Negative: backwards."""
    accel_mps2: float | None
    """None: the controller chooses."""
    jerk_mps3: float | None


@dataclass(frozen=True, slots=True)
class TwistDemand:
    """Speed and turn rate, of geometry_msgs."""

    stamp_ns: int | None
    speed_mps: float
    """Negative: backwards."""
    yaw_rate_radps: float
    """Left positive."""


@dataclass(frozen=True, slots=True)
class GearDemand:
    """The selector: ``drive``, ``reverse``, ``neutral``, ``park``; empty: as it is."""

    stamp_ns: int
    gear: str


@dataclass(frozen=True, slots=True)
class IndicatorDemand:
    """Lamps of :attr:`schemas.messages.Lights.indicators`: 0 off, 1 left, 2 right, 3 hazard."""

    stamp_ns: int
    hazard: bool
    """Whether the message is about hazard lights; otherwise about turn indicators."""
    indicators: int | None
    """None: as they are."""


Demand = PlainDrive | AckermannDemand | TwistDemand | GearDemand | IndicatorDemand
"""What a stack asks."""


def read_command(store: TypeStore, type_name: str, data: bytes | memoryview) -> Demand:
    """What is in the bytes of a command of a peer who is not trusted.

    Args:
        store: of the types.
        type_name: one of :data:`twin.ros2.tables.COMMAND_TYPES`.
        data: CDR.

    Raises:
        MessageError: no such message, or numbers that are not finite; one line.
    """
    message = store.decode(type_name, data)
    package, _, name = type_name.split("/")
    if package == "drivetwin_msgs":
        return PlainDrive(nanoseconds_of(message.stamp), _plain(message))
    if package == "ackermann_msgs":
        return _ackermann(message, type_name)
    if package == "autoware_control_msgs":
        return _autoware(message, type_name)
    if package == "geometry_msgs":
        return _twist(message, type_name)
    stamp_ns = nanoseconds_of(message.stamp)
    if name == "GearCommand":
        return GearDemand(stamp_ns, _gear(message.command))
    return _indicators(stamp_ns, name == "HazardLightsCommand", message.command, type_name)


def write_plain(store: TypeStore, stamp_ns: int, command: Command) -> Any:
    """drivetwin_msgs/DriveCommand of a command of the drive plane."""
    parts = MessageParts(store)
    lights = command.lights
    pose, errors = command.pose, command.sensors
    return store.make(
        "drivetwin_msgs/msg/DriveCommand",
        stamp=parts.time(stamp_ns),
        tick=command.tick,
        throttle=command.throttle,
        brake=command.brake,
        steering_rad=command.steering_rad,
        handbrake=command.handbrake,
        reverse=command.reverse,
        aeb=command.aeb,
        warning=command.warning,
        trigger=-1 if command.trigger is None else command.trigger,
        lights=store.make("drivetwin_msgs/msg/Lights", **_fields(lights)),
        detections=[
            store.make("drivetwin_msgs/msg/Detection", **_fields(each))
            for each in command.detections
        ],
        sensor_errors=[]
        if errors is None
        else [store.make("drivetwin_msgs/msg/SensorErrors", **_fields(errors))],
        pose=[]
        if pose is None
        else [parts.pose((pose.x_m, pose.y_m, pose.z_m), (pose.qx, pose.qy, pose.qz, pose.qw))],
    )


def _fields(struct: Any) -> dict[str, Any]:
    return {name: getattr(struct, name) for name in struct.__struct_fields__}


def _plain(message: Any) -> Command:
    """Ranges and NaN are checked where every command is (``command_mistake``)."""
    if len(message.detections) > DETECTIONS_MAX:
        raise MessageError(
            f"command: {len(message.detections)} detections, allowed: up to {DETECTIONS_MAX}"
        )
    for name in ("sensor_errors", "pose"):
        if (count := len(getattr(message, name))) > 1:
            raise MessageError(f"command {name}: {count} given, allowed: at most one")
    if message.lights.indicators > _HAZARD:
        raise MessageError(
            f"command lights.indicators is {message.lights.indicators}, allowed: 0 to {_HAZARD}"
        )
    return Command(
        slot=0,
        token=0,
        tick=message.tick,
        throttle=message.throttle,
        brake=message.brake,
        steering_rad=message.steering_rad,
        aeb=message.aeb,
        lights=_struct(Lights, message.lights),
        detections=[_struct(Detection, each) for each in message.detections],
        sensors=_struct(SensorErrors, message.sensor_errors[0]) if message.sensor_errors else None,
        handbrake=message.handbrake,
        pose=_pose(message.pose[0]) if message.pose else None,
        trigger=None if message.trigger < 0 else message.trigger,
        reverse=message.reverse,
        warning=message.warning,
    )


def _struct(kind: Any, message: Any) -> Any:
    return kind(**{name: getattr(message, name) for name in kind.__struct_fields__})


def _pose(message: Any) -> Pose:
    at, turn = message.position, message.orientation
    return Pose(at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)


def _ackermann(message: Any, type_name: str) -> AckermannDemand:
    stamped = type_name.endswith("Stamped")
    drive = message.drive if stamped else message
    _check_finite(
        type_name,
        drive,
        *("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk"),
    )
    # Its definition: a zero stands for "as fast as possible".
    return AckermannDemand(
        stamp_ns=nanoseconds_of(message.header.stamp) if stamped else None,
        steering_rad=drive.steering_angle,
        steering_rate_radps=drive.steering_angle_velocity or None,
        speed_mps=drive.speed,
        accel_mps2=drive.acceleration or None,
        jerk_mps3=drive.jerk or None,
    )


def _autoware(message: Any, type_name: str) -> AckermannDemand:
    lateral, longitudinal = message.lateral, message.longitudinal
    _check_finite(type_name, lateral, "steering_tire_angle", "steering_tire_rotation_rate")
    _check_finite(type_name, longitudinal, "velocity", "acceleration", "jerk")
    return AckermannDemand(
        stamp_ns=nanoseconds_of(message.stamp),
        steering_rad=lateral.steering_tire_angle,
        steering_rate_radps=lateral.steering_tire_rotation_rate
        if lateral.is_defined_steering_tire_rotation_rate
        else None,
        speed_mps=longitudinal.velocity,
        accel_mps2=longitudinal.acceleration if longitudinal.is_defined_acceleration else None,
        jerk_mps3=longitudinal.jerk if longitudinal.is_defined_jerk else None,
    )


def _twist(message: Any, type_name: str) -> TwistDemand:
    stamped = type_name.endswith("Stamped")
    twist = message.twist if stamped else message
    _check_finite(f"{type_name} linear", twist.linear, "x")
    _check_finite(f"{type_name} angular", twist.angular, "z")
    stamp_ns = nanoseconds_of(message.header.stamp) if stamped else None
    return TwistDemand(stamp_ns, twist.linear.x, twist.angular.z)


def _gear(value: int) -> str:
    if 2 <= value <= 19 or value in (23, 24):
        return "drive"
    return {1: "neutral", 20: "reverse", 21: "reverse", 22: "park"}.get(value, "")


def _indicators(stamp_ns: int, hazard: bool, value: int, type_name: str) -> IndicatorDemand:
    if hazard:
        meanings = {0: None, 1: 0, 2: _HAZARD}
    else:
        meanings = {0: None, 1: 0, 2: _LEFT, 3: _RIGHT}
    if value not in meanings:
        raise MessageError(f"{type_name}: command is {value}, allowed: 0 to {max(meanings)}")
    return IndicatorDemand(stamp_ns, hazard, meanings[value])


def _check_finite(what: str, message: Any, *names: str) -> None:
    for name in names:
        value = getattr(message, name)
        if not math.isfinite(value):
            raise MessageError(f"{what}: {name} is {value}, allowed: finite numbers")
