"""The planner: a finite-state machine that drives, brakes for what stands in its way, and holds.

Pure: :func:`plan` takes the state and returns the next one. Two rule sets: ``default``, whose
trigger needs an object of a vehicle class, seen with enough confidence, large enough in the image,
standing in the ego's path, on several camera frames in a row, and which brakes until standstill;
and ``autodrive``, the rule of the published AEB script (:mod:`devkit.planning_autodrive`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta, Struct

from devkit import planning_autodrive
from schemas.messages import Detection

VEHICLE_CLASSES = frozenset({"car", "truck", "bus"})
"""Labels that can trigger emergency braking in v1."""

STANDSTILL_MPS = 0.05
"""Below this speed the ego has come to rest [m/s]."""


class Planner(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the planner."""

    rules: Literal["default", "autodrive"] = "default"
    """Rule set. ``autodrive`` has fixed limits: only ``cruise_speed_mps`` applies to it."""
    cruise_speed_mps: Annotated[float, Meta(ge=0, le=60)] = 8.0
    """Speed on a free road [m/s], 0 to 60."""
    confidence_min: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """Least confidence that counts [-], 0 to 1."""
    area_min_ratio: Annotated[float, Meta(ge=0, le=1)] = 0.0043
    """Least box area relative to the image [-], 0 to 1; 1000 px^2 of 640x360 in the original."""
    frames_min: Annotated[int, Meta(ge=1, le=1000)] = 2
    """Consecutive camera frames that must agree, 1 to 1000."""
    corridor_half_m: Annotated[float, Meta(gt=0, le=10)] = 1.1
    """Half width of the ego's path around its centre line [m], above 0 to 10."""
    camera_height_m: Annotated[float, Meta(gt=0, le=5)] = 1.4
    """Camera above the road [m], above 0 to 5."""
    camera_lateral_m: Annotated[float, Meta(ge=-5, le=5)] = -0.35
    """Camera left of the ego's centre line [m], -5 to 5; right is negative."""
    flank_length_m: Annotated[float, Meta(ge=0, le=30)] = 3.0
    """Length granted to an object that is seen from the side [m], 0 to 30.

    Its inner edge in the image is its far corner. Shorter than real cars on purpose: too short
    moves an object towards the path, so the error is on the side of braking.
    """

    def __post_init__(self) -> None:
        """Refuse limits that the chosen rules would not look at."""
        if self.rules == "autodrive":
            for name in _DEFAULT_RULES_ONLY:
                if getattr(self, name) != Planner.__struct_defaults__[_FIELDS.index(name)]:
                    raise ValueError(
                        f"{name} is set, but rules: autodrive have limits of their own"
                    )


_FIELDS = Planner.__struct_fields__
_DEFAULT_RULES_ONLY = tuple(name for name in _FIELDS if name not in ("rules", "cruise_speed_mps"))


@dataclass(frozen=True, slots=True)
class View:
    """A pinhole camera that looks straight ahead along a flat road."""

    width_px: int
    height_px: int
    focal_px: float

    @classmethod
    def from_fov(cls, width_px: int, height_px: int, hfov_deg: float) -> View:
        """View of a camera with square pixels and horizontal field of view ``hfov_deg`` [deg]."""
        focal_px = 0.5 * width_px / math.tan(0.5 * math.radians(hfov_deg))
        return cls(width_px, height_px, focal_px)


@dataclass(frozen=True, slots=True)
class Cruise:
    """Drives; ``frames`` consecutive camera frames have shown something to brake for."""

    frames: int = 0


@dataclass(frozen=True, slots=True)
class Brake:
    """Emergency braking, latched until standstill."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Stands still, brake held; in v1 a case ends here."""


@dataclass(frozen=True, slots=True)
class React:
    """Rules ``autodrive``: what the last camera frame asked for, and nothing remembered of it."""

    aeb: bool = False


State = Cruise | Brake | Hold | React


@dataclass(frozen=True, slots=True)
class Plan:
    """What the controller is asked to do."""

    speed_mps: float
    """Speed to keep [m/s]; 0 while braking or holding."""
    aeb: bool
    """Emergency braking is triggered: full brake, no throttle."""


def plan(
    state: State,
    detections: Sequence[Detection] | None,
    speed_mps: float,
    view: View,
    planner: Planner,
) -> tuple[State, Plan]:
    """One control tick.

    Args:
        state: the state of the last tick, :class:`Cruise` at reset for either rule set.
        detections: those of a new camera frame; None when no frame is due (the count of frames
            that agree is kept, neither raised nor reset).
        speed_mps: forward speed of the ego [m/s].
        view: the camera that the detections come from.
        planner: parameters.
    """
    state = _next_state(state, detections, speed_mps, view, planner)
    if isinstance(state, Cruise) or (isinstance(state, React) and not state.aeb):
        return state, Plan(planner.cruise_speed_mps, aeb=False)
    return state, Plan(0.0, aeb=True)


def _next_state(
    state: State,
    detections: Sequence[Detection] | None,
    speed_mps: float,
    view: View,
    planner: Planner,
) -> State:
    if planner.rules == "autodrive":
        if detections is None:
            return state if isinstance(state, React) else React()
        return React(planning_autodrive.brakes(detections, view.width_px, view.height_px))
    if isinstance(state, Hold | React):
        return state
    if isinstance(state, Brake):
        return Hold() if speed_mps < STANDSTILL_MPS else state
    if detections is None:
        return state
    if not any(is_threat(detection, view, planner) for detection in detections):
        return Cruise(frames=0)
    frames = state.frames + 1
    return Brake() if frames >= planner.frames_min else Cruise(frames)


def is_threat(detection: Detection, view: View, planner: Planner) -> bool:
    """Whether one detection, seen once, is something to brake for. All limits are inclusive."""
    area_px2 = detection.width_px * detection.height_px
    return (
        detection.label in VEHICLE_CLASSES
        and detection.confidence >= planner.confidence_min
        and area_px2 >= planner.area_min_ratio * (view.width_px * view.height_px)
        and is_in_path(detection, view, planner)
    )


def is_in_path(detection: Detection, view: View, planner: Planner) -> bool:
    """Whether the object's lateral extent touches the ego's corridor."""
    extent = lateral_extent_m(detection, view, planner)
    if extent is None:
        return False
    right_m, left_m = extent
    return left_m >= -planner.corridor_half_m and right_m <= planner.corridor_half_m


def lateral_extent_m(
    detection: Detection, view: View, planner: Planner
) -> tuple[float, float] | None:
    """Where an object stands across the road, from its box alone.

    On a flat road the box's bottom edge, d px below the horizon, is the near end of the object at
    z = focal x camera height / d; a column u px right of the axis is u z / focal to the right. A
    box that lies on one side of the axis shows the object's flank: the edge nearer to the axis is
    the far corner, at z + flank length. (Without this, a parked car that leaves the image seems to
    reach into the lane.)

    Returns:
        (right end, left end) in the ego's frame, left positive [m]; None if the box ends at or
        above the horizon, so that it stands nowhere on a flat road.
    """
    below_horizon_px = detection.y_px + detection.height_px - 0.5 * view.height_px
    if below_horizon_px <= 0.0:
        return None
    near_m = view.focal_px * planner.camera_height_m / below_horizon_px
    far_m = near_m + planner.flank_length_m
    left_px = detection.x_px - 0.5 * view.width_px
    right_px = left_px + detection.width_px
    left_m = -left_px * (far_m if left_px > 0.0 else near_m) / view.focal_px
    right_m = -right_px * (far_m if right_px < 0.0 else near_m) / view.focal_px
    return planner.camera_lateral_m + right_m, planner.camera_lateral_m + left_m
