"""Longitudinal control: cruising by speed or by throttle, full brake for AEB.

Pure: :func:`control` takes the integral and returns the next one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta, Struct

from devkit.reference.planning import DrivePlan


class Controller(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the controller."""

    cruise: Literal["speed", "throttle"] = "speed"
    """``speed``: a proportional-integral throttle keeps the planner's speed. ``throttle``: a
    constant one, as in the published script; only ``cruise_throttle`` applies to it."""
    cruise_throttle: Annotated[float, Meta(ge=0, le=1)] = 0.2
    """Throttle while cruising by throttle [-], 0 to 1; the published script's."""
    throttle_max: Annotated[float, Meta(ge=0, le=1)] = 0.6
    """Largest throttle while cruising [-], 0 to 1."""
    throttle_gain: Annotated[float, Meta(ge=0, le=10)] = 0.3
    """Throttle per speed error [s/m], 0 to 10."""
    throttle_integral_gain: Annotated[float, Meta(ge=0, le=10)] = 0.05
    """Throttle per speed error held for a second [1/m], 0 to 10."""
    overspeed_mps: Annotated[float, Meta(ge=0, le=10)] = 0.5
    """Excess speed that engine braking is left to deal with [m/s], 0 to 10."""
    cruise_brake_gain: Annotated[float, Meta(ge=0, le=10)] = 0.1
    """Brake per excess speed beyond that [s/m], 0 to 10."""
    cruise_brake_max: Annotated[float, Meta(ge=0, le=1)] = 0.2
    """Largest brake while cruising [-], 0 to 1."""

    def __post_init__(self) -> None:
        """Refuse parameters that the chosen way to cruise would not look at."""
        for name, default in zip(_FIELDS[1:], Controller.__struct_defaults__[1:], strict=True):
            ignored = (name == "cruise_throttle") == (self.cruise == "speed")
            if ignored and getattr(self, name) != default:
                raise ValueError(f"{name} is set, but cruise: {self.cruise} does not look at it")


_FIELDS = Controller.__struct_fields__


@dataclass(frozen=True, slots=True)
class Actuation:
    """Actuator values for the drive-by-wire system."""

    throttle: float
    """0 to 1 [-]."""
    brake: float
    """0 to 1 [-]."""


def control(
    integral: float, plan: DrivePlan, speed_mps: float, period_s: float, controller: Controller
) -> tuple[float, Actuation]:
    """One control tick.

    Args:
        integral: the throttle's integral part [-], 0 at reset.
        plan: of this tick.
        speed_mps: forward speed of the ego [m/s].
        period_s: control period [s].
        controller: parameters.

    Returns:
        The integral part for the next tick, and the actuation.
    """
    if plan.aeb:
        return 0.0, Actuation(throttle=0.0, brake=1.0)
    if controller.cruise == "throttle":
        return 0.0, Actuation(controller.cruise_throttle, brake=0.0)
    error_mps = plan.speed_mps - speed_mps
    # The integral moves only while the throttle can follow it: no wind-up during the launch.
    advanced = integral + controller.throttle_integral_gain * error_mps * period_s
    proportional = controller.throttle_gain * error_mps
    if 0.0 <= proportional + integral <= controller.throttle_max:
        integral = _clamp(advanced, controller.throttle_max)
    excess_mps = -error_mps - controller.overspeed_mps
    brake = _clamp(controller.cruise_brake_gain * excess_mps, controller.cruise_brake_max)
    throttle = 0.0 if brake > 0.0 else _clamp(proportional + integral, controller.throttle_max)
    return integral, Actuation(throttle, brake)


def _clamp(value: float, upper: float) -> float:
    return min(max(value, 0.0), upper)
