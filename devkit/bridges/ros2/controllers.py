"""From what a ROS 2 stack asks of a car to pedals and the angle of the road wheels. Pure.

A stack that speaks of speeds needs somebody who presses pedals. Here it is a controller of one
page, the same for ``ackermann_msgs``, ``geometry_msgs/Twist`` and ``autoware_control_msgs``; it
uses +, -, x, / and, for twists, an arc tangent without its last bits, in which C libraries differ.
The same controller behind the drive plane gives the same bytes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta, Struct

from schemas.steady import steady

LATERAL_SPEED_MIN_MPS = 0.5
"""Slowest speed by which a yaw rate is turned into an angle; a car does not turn on the spot."""

STANDSTILL_MPS = 0.1
"""A car slower than this stands [m/s]."""

ANGLE_BITS = 44
"""Significant bits of an angle that a yaw rate became."""


class AskedError(ValueError):
    """What was asked is no number; one line."""


class MotionControl(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the controller, under ``autonomy.parameters``."""

    throttle_gain: Annotated[float, Meta(ge=0, le=10)] = 0.3
    """Throttle per speed error [s/m]."""
    throttle_integral_gain: Annotated[float, Meta(ge=0, le=10)] = 0.05
    """Throttle per speed error held for a second [1/m]."""
    throttle_per_mps2: Annotated[float, Meta(ge=0, le=10)] = 0.1
    """Throttle per acceleration that is asked for, where a message has one [s^2/m]."""
    brake_per_throttle: Annotated[float, Meta(ge=0, le=10)] = 0.5
    """Brake where the sum of these is negative, per missing throttle [-]."""
    standstill_brake: Annotated[float, Meta(ge=0, le=1)] = 0.3
    """Brake that holds a car that is asked to stand [-]."""
    wheelbase_m: Annotated[float, Meta(gt=0, le=20)] = 2.5
    """Distance of the axles, for twists [m]."""
    steering_max_rad: Annotated[float, Meta(gt=0, le=1.5)] = 0.62
    """Largest angle of the road wheels that is passed on; opencav's limit [rad]."""


@dataclass(frozen=True, slots=True)
class AskedMotion:
    """What a stack asks for, in one vocabulary."""

    speed_mps: float
    """Speed; negative: backwards [m/s]."""
    acceleration_mps2: float = 0.0
    """Acceleration along the direction of travel; 0: as the controller thinks [m/s^2]."""
    steering_rad: float | None = None
    """Angle of the road wheels, left positive [rad]; None: by the yaw rate."""
    yaw_rate_radps: float = 0.0
    """Yaw rate, left positive, where there is no angle [rad/s]."""


@dataclass(frozen=True, slots=True)
class PressedPedals:
    """What the drive plane's command holds of it."""

    throttle: float
    """0 to 1 [-]."""
    brake: float
    """0 to 1 [-]."""
    steering_rad: float
    """Angle of the road wheels, left positive [rad]."""
    reverse: bool
    """The throttle drives backwards."""


def press(
    integral: float,
    asked: AskedMotion,
    speed_mps: float,
    period_s: float,
    control: MotionControl,
    *,
    gear: str = "",
) -> tuple[float, PressedPedals]:
    """One control tick.

    Args:
        integral: throttle's integral part [-], 0 at the beginning of a case.
        asked: the motion that is asked for.
        speed_mps: the car's forward speed, negative backwards [m/s].
        period_s: control period [s].
        control: parameters.
        gear: ``drive``, ``reverse``, ``neutral`` or ``park``; empty: the sign of the speed says it.
            A speed against the gear, and any speed in neutral and park, asks the car to stand.

    Returns:
        The integral part for the next tick, and the pedals.

    Raises:
        AskedError: a number that was asked for is none.
    """
    _check(asked)
    steering_rad = _steering(asked, control)
    backwards, drives = _direction(asked, speed_mps, gear)
    along_mps = -speed_mps if backwards else speed_mps
    target_mps = abs(asked.speed_mps) if drives else 0.0
    acceleration_mps2 = asked.acceleration_mps2 if drives else 0.0
    integral = integral if drives else 0.0
    if target_mps == 0.0 and abs(speed_mps) < STANDSTILL_MPS:
        return 0.0, PressedPedals(0.0, control.standstill_brake, steering_rad, backwards)
    if along_mps < -STANDSTILL_MPS:  # it rolls the other way: first it has to stop
        return 0.0, PressedPedals(0.0, 1.0, steering_rad, not backwards)
    error_mps = target_mps - along_mps
    proportional = control.throttle_gain * error_mps
    forward = proportional + control.throttle_per_mps2 * acceleration_mps2
    # The integral moves only while the throttle can follow it: no wind-up.
    if 0.0 <= forward + integral <= 1.0:
        integral += control.throttle_integral_gain * error_mps * period_s
        integral = min(max(integral, 0.0), 1.0)
    wanted = forward + integral
    if wanted >= 0.0:
        return integral, PressedPedals(min(wanted, 1.0), 0.0, steering_rad, backwards)
    brake = min(-wanted * control.brake_per_throttle, 1.0)
    return integral, PressedPedals(0.0, brake, steering_rad, backwards)


def _direction(asked: AskedMotion, speed_mps: float, gear: str) -> tuple[bool, bool]:
    """Whether the throttle drives backwards, and whether the gear lets the car drive as asked."""
    if not gear:
        return asked.speed_mps < 0.0, True
    if gear == "drive":
        return False, asked.speed_mps >= 0.0
    if gear == "reverse":
        return True, asked.speed_mps <= 0.0
    return speed_mps < 0.0, False


def _steering(asked: AskedMotion, control: MotionControl) -> float:
    angle_rad = asked.steering_rad
    if angle_rad is None:
        speed_mps = max(abs(asked.speed_mps), LATERAL_SPEED_MIN_MPS)
        tangent = control.wheelbase_m * asked.yaw_rate_radps / speed_mps
        angle_rad = float(steady(math.atan(tangent), ANGLE_BITS))
        angle_rad = -angle_rad if asked.speed_mps < 0.0 else angle_rad
    return min(max(angle_rad, -control.steering_max_rad), control.steering_max_rad)


def _check(asked: AskedMotion) -> None:
    for name in ("speed_mps", "acceleration_mps2", "steering_rad", "yaw_rate_radps"):
        value = getattr(asked, name)
        if value is not None and not math.isfinite(value):
            raise AskedError(f"{name} is {value}, a finite number is needed")
