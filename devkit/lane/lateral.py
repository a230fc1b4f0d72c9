"""Lateral control: pure pursuit of the lane that the camera sees, and what to do when it sees none.

Pure: :func:`steer` takes the state and returns the next one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta, Struct

from devkit.lane.curve import LaneCurve
from devkit.lane.track import Chassis

AHEAD_MIN_M = 4.0
"""Shortest distance to the point that is driven to: at walking pace the gain stays finite [m]."""
BEND_AT_M = 14.0
"""Distance at which the bend of the lane is taken: as far as markings are seen well [m]."""
BEND_S = 0.25
"""The bend that is handed on follows the one that is seen with this lag [s]."""


class LateralParameters(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of lateral control."""

    steering: Literal["straight", "visual"] = "straight"
    """``straight``: holds the wheel straight, as the published script does; nothing below applies
    to it. ``visual``: keeps the lane between the markings in the camera image; for streets whose
    markings do not stop, as they do at crossings."""
    lane_width_m: Annotated[float, Meta(ge=2, le=6)] = 3.5
    """Width from the middle line to the inner border of the edge line [m], 2 to 6."""
    marking_width_m: Annotated[float, Meta(ge=0.05, le=0.5)] = 0.1
    """Width of the edge line, which lies outside the lane [m], 0.05 to 0.5."""
    preview_s: Annotated[float, Meta(ge=0.2, le=3)] = 0.7
    """The point that is driven to lies this far ahead [s], 0.2 to 3, and never nearer than 4 m."""
    wheelbase_m: Annotated[float, Meta(ge=0.5, le=10)] = 3.09
    """Wheelbase of the car [m], 0.5 to 10."""
    understeer_rad_per_mps2: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.003
    """Road-wheel angle that a bend takes beyond the bicycle's, per lateral acceleration
    [rad s^2/m], -0.1 to 0.1."""
    roll_rad_per_mps2: Annotated[float, Meta(ge=0, le=0.1)] = 0.0125
    """Roll of the body, and so of the camera, per lateral acceleration [rad s^2/m], 0 to 0.1."""
    sideslip_rad_per_mps2: Annotated[float, Meta(ge=0, le=0.1)] = 0.006
    """Slip angle of the rear axle per lateral acceleration [rad s^2/m], 0 to 0.1."""
    steering_max_rad: Annotated[float, Meta(gt=0, le=1.5)] = 0.6
    """Largest road-wheel angle that is asked for [rad], above 0 to 1.5."""
    steering_rate_radps: Annotated[float, Meta(gt=0, le=10)] = 0.5
    """Fastest change of the steering angle [rad/s], above 0 to 10."""
    fade_s: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """Time in which the last bend is let go of without a lane in sight [s], above 0 to 10."""

    def __post_init__(self) -> None:
        """Refuse parameters that ``straight`` would not look at."""
        if self.steering == "straight":
            names = LateralParameters.__struct_fields__[1:]
            for name, default in zip(names, LateralParameters.__struct_defaults__[1:], strict=True):
                if getattr(self, name) != default:
                    raise ValueError(f"{name} is set, but steering: straight looks at no lane")

    @property
    def chassis(self) -> Chassis:
        """What the lane's track needs to know of the car."""
        return Chassis(self.roll_rad_per_mps2, self.sideslip_rad_per_mps2)

    @property
    def lines_m(self) -> tuple[float, float]:
        """Middles of edge line and middle line, left of the lane's centre [m]."""
        half_m = 0.5 * self.lane_width_m
        return (-half_m - 0.5 * self.marking_width_m, half_m)


@dataclass(frozen=True, slots=True)
class Wheel:
    """Memory of the lateral control between ticks."""

    angle_rad: float = 0.0
    """Road-wheel angle asked for last, left positive [rad]."""
    bend_per_m: float = 0.0
    """Curvature of the lane ahead, as far as it is known [1/m]."""


def steer(
    wheel: Wheel,
    curve: LaneCurve | None,
    bend: LaneCurve | None,
    speed_mps: float,
    period_s: float,
    steering: LateralParameters,
) -> Wheel:
    """One control tick.

    Pure pursuit (Coulter 1992): the arc that leaves the rear axle along the car and passes through
    a point of the lane's centre x ahead and y to the left has curvature 2 y / (x^2 + y^2). A
    bicycle without slip drives it at the road-wheel angle atan(wheelbase x curvature), a car with
    tyres at so much more as its understeer gradient says. Without a lane the last bend fades:
    first the bend is driven on, then straight ahead.

    Args:
        wheel: the state of the last tick.
        curve: centre line of the lane; None where it is not known.
        bend: the same, None where its bend cannot be told: the last one is kept.
        speed_mps: forward speed of the ego [m/s].
        period_s: control period [s].
        steering: parameters.
    """
    if steering.steering == "straight":
        return wheel
    bend_per_m = wheel.bend_per_m
    if curve is None:
        bend_per_m /= 1.0 + period_s / steering.fade_s
        curvature_per_m = bend_per_m
    else:
        ahead_m = max(speed_mps * steering.preview_s, AHEAD_MIN_M)
        left_m = curve.left_m(ahead_m)
        curvature_per_m = 2.0 * left_m / (ahead_m * ahead_m + left_m * left_m)
    if bend is not None:
        step_per_m = bend.bend_per_m(BEND_AT_M) - bend_per_m
        bend_per_m += step_per_m * period_s / (period_s + BEND_S)
    # Rounded: arc tangents of C libraries differ in their last bits.
    angle_rad = math.atan(steering.wheelbase_m * curvature_per_m)
    lateral_mps2 = speed_mps * speed_mps * curvature_per_m
    wanted_rad = round(angle_rad + steering.understeer_rad_per_mps2 * lateral_mps2, 9)
    wanted_rad = _within(wanted_rad, steering.steering_max_rad)
    step_rad = steering.steering_rate_radps * period_s
    angle_rad = wheel.angle_rad + _within(wanted_rad - wheel.angle_rad, step_rad)
    return Wheel(angle_rad, bend_per_m)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
