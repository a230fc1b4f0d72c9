"""The planner: a finite-state machine that drives, brakes for what stands in its way, and holds.

Pure: :func:`plan` takes the state and returns the next one. Two rule sets. ``default`` looks at the
nearest road user in the ego's path that is seen with enough confidence and large enough; a time to
collision below the limit, in enough of the last camera frames, brakes until standstill.
``autodrive`` is the rule of the published AEB script (:mod:`devkit.reference.planning_autodrive`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple

from msgspec import Meta, Struct

from devkit.reference import planning_autodrive
from devkit.reference.view import CameraView
from schemas.messages import Detection


class RoadUserShape(NamedTuple):
    """What is known of a road user by its label."""

    width_m: float
    height_m: float
    flank_m: float
    """Length granted to it when seen from the side. Shorter than real ones on purpose: too short
    moves an object towards the path, so the error is on the side of braking."""


SHAPES = {
    "car": RoadUserShape(1.8, 1.5, 3.0),
    "truck": RoadUserShape(2.5, 3.2, 5.0),
    "bus": RoadUserShape(2.5, 3.2, 8.0),
    "pedestrian": RoadUserShape(0.5, 1.7, 0.2),
    "bicycle": RoadUserShape(0.6, 1.7, 1.2),
}
"""Labels that can trigger emergency braking; typical sizes."""

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
    area_min_ratio: Annotated[float, Meta(ge=0, le=1)] = 0.002
    """Least area of a car's box relative to the image [-], 0 to 1; of other labels in proportion to
    their size. The default is 460 px^2 of 640x360: a car at about 35 m."""
    ttc_max_s: Annotated[float, Meta(gt=0, le=60)] = 3.5
    """Time to collision that triggers [s], above 0 to 60; objects are taken to stand. A stop
    from 8 m/s on packed snow (friction 0.2) takes 2.0 s of it, reaction and bonnet the rest."""
    warning_ttc_s: Annotated[float, Meta(ge=0, le=60)] = 0.0
    """Time to collision from which on the driver is warned [s], 0 to 60; never later than the first
    frame that shows a threat."""
    frames_min: Annotated[int, Meta(ge=1, le=100)] = 2
    """Frames that must agree of the last ``frames_window``, 1 to 100: a flash of one
    frame does not brake, a miss of one frame does not start the count again."""
    frames_window: Annotated[int, Meta(ge=1, le=100)] = 3
    """1 to 100, not below ``frames_min``."""
    corridor_half_m: Annotated[float, Meta(gt=0, le=10)] = 1.1
    """Half width of the ego's path around its centre line [m], above 0 to 10."""

    def __post_init__(self) -> None:
        """Refuse what contradicts itself, and limits that the chosen rules would not look at."""
        if self.frames_window < self.frames_min:
            raise ValueError(
                f"frames_window: given {self.frames_window}, "
                f"allowed: at least frames_min {self.frames_min}"
            )
        if self.rules == "autodrive":
            for name in _DEFAULT_RULES_ONLY:
                if getattr(self, name) != Planner.__struct_defaults__[_FIELDS.index(name)]:
                    raise ValueError(
                        f"{name} is set, but rules: autodrive have limits of their own"
                    )


_FIELDS = Planner.__struct_fields__
_DEFAULT_RULES_ONLY = tuple(name for name in _FIELDS if name not in ("rules", "cruise_speed_mps"))


@dataclass(frozen=True, slots=True)
class Cruise:
    """The car drives; ``recent``: whether the last camera frames showed a threat, newest last."""

    recent: tuple[bool, ...] = ()
    warns: bool = field(default=False, compare=False)
    """Whether the last frame showed something within the warning time; decides nothing else."""


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
class DrivePlan:
    """What the controller is asked to do."""

    speed_mps: float
    """Speed to keep [m/s]; 0 while braking or holding."""
    aeb: bool
    """Emergency braking is triggered: full brake, no throttle."""
    trigger: int | None = None
    """Place of the detection that triggers it, in the tick in which it does; None: no trigger in
    this tick."""
    warns: bool = False
    """Something is within the warning time."""

    @property
    def warning(self) -> bool:
        """The driver is warned."""
        return self.aeb or self.warns


def plan(
    state: State,
    detections: Sequence[Detection] | None,
    speed_mps: float,
    view: CameraView,
    planner: Planner,
    curvature_per_m: float = 0.0,
) -> tuple[State, DrivePlan]:
    """One control tick.

    Args:
        state: the state of the last tick, :class:`Cruise` at reset for either rule set.
        detections: those of a new camera frame; None when no frame is due (what the last frames
            showed is kept).
        speed_mps: forward speed of the ego [m/s].
        view: the camera that the detections come from.
        planner: parameters.
        curvature_per_m: of the ego's path, left positive [1/m].
    """
    state, trigger = _next_state(state, detections, speed_mps, view, planner, curvature_per_m)
    if isinstance(state, Cruise) or (isinstance(state, React) and not state.aeb):
        warns = isinstance(state, Cruise) and state.warns
        return state, DrivePlan(planner.cruise_speed_mps, aeb=False, warns=warns)
    return state, DrivePlan(0.0, aeb=True, trigger=trigger)


def _next_state(
    state: State,
    detections: Sequence[Detection] | None,
    speed_mps: float,
    view: CameraView,
    planner: Planner,
    curvature_per_m: float,
) -> tuple[State, int | None]:
    """The next state, and the place of the detection that has triggered it."""
    if planner.rules == "autodrive":
        if detections is None:
            return state if isinstance(state, React) else React(), None
        place = planning_autodrive.trigger(detections, view.width_px, view.height_px)
        return React(place is not None), place
    if isinstance(state, Hold | React):
        return state, None
    if isinstance(state, Brake):
        return Hold() if speed_mps < STANDSTILL_MPS else state, None
    if detections is None:
        return state, None
    ahead = nearest(detections, view, planner, curvature_per_m)
    threat = ahead is not None and ahead.ahead_m <= planner.ttc_max_s * speed_mps
    early_s = max(planner.warning_ttc_s, planner.ttc_max_s)
    warns = ahead is not None and ahead.ahead_m <= early_s * speed_mps
    recent = (*state.recent, threat)[-planner.frames_window :]
    if sum(recent) < planner.frames_min:
        return Cruise(recent, warns), None
    # The window was not full a frame ago, so this frame's object has filled it.
    return Brake(), ahead.place if ahead else None


class NearestObject(NamedTuple):
    """The nearest relevant object in the ego's path."""

    ahead_m: float
    """Distance of its near end before the camera [m]."""
    place: int
    """Place in the detections; of several at the same distance the first."""


def nearest(
    detections: Sequence[Detection],
    view: CameraView,
    planner: Planner,
    curvature_per_m: float = 0.0,
) -> NearestObject | None:
    """The nearest relevant object in the ego's path; None: there is none.

    All limits are inclusive.
    """
    ahead: NearestObject | None = None
    for place, detection in enumerate(detections):
        if not is_relevant(detection, view, planner):
            continue
        extent = extent_m(detection, view, curvature_per_m)
        if extent is None or not extent.touches(planner.corridor_half_m):
            continue
        if extent.ahead_m < (ahead.ahead_m if ahead else math.inf):
            ahead = NearestObject(extent.ahead_m, place)
    return ahead


def is_relevant(detection: Detection, view: CameraView, planner: Planner) -> bool:
    """Whether one detection is of a road user, confident and large enough; wherever it stands."""
    shape, car = SHAPES.get(detection.label), SHAPES["car"]
    if shape is None or detection.confidence < planner.confidence_min:
        return False
    share = shape.width_m * shape.height_m / (car.width_m * car.height_m)
    least_px2 = planner.area_min_ratio * share * (view.width_px * view.height_px)
    return detection.width_px * detection.height_px >= least_px2


class Extent(NamedTuple):
    """Extent of an object on the road."""

    ahead_m: float
    """Distance of its near end before the camera [m]."""
    right_m: float
    """Place of its right end, left of the middle of the ego's path [m]."""
    left_m: float
    """Place of its left end, likewise [m]."""

    def touches(self, half_m: float) -> bool:
        """Whether it reaches into a path of this half width [m]."""
        return self.left_m >= -half_m and self.right_m <= half_m


def extent_m(detection: Detection, view: CameraView, curvature_per_m: float = 0.0) -> Extent | None:
    """Extent of an object on a flat road, from its box alone.

    The bottom edge of the box is the object's near end. Objects stand along the path, which has
    the slope k x with curvature k and x from the rear axle. One that is seen to one side of that
    direction shows its flank: the edge nearer to it is the far corner, one flank further away.
    (Without this, a parked car that leaves the image seems to reach into the lane.) The middle of
    the path lies k x^2 / 2 to the left.

    Returns:
        None if the box ends at or above the horizon, so that it stands nowhere, or if its label has
        no shape.
    """
    shape = SHAPES.get(detection.label)
    bottom_px = detection.y_px + detection.height_px
    ends_px = detection.x_px, detection.x_px + detection.width_px
    ahead_m = view.ground_m(0.5 * (ends_px[0] + ends_px[1]), bottom_px)
    if shape is None or ahead_m is None:
        return None
    far_m = ahead_m + shape.flank_m

    def across_m(end_px: float, distance_m: float) -> float:
        x_m = view.forward_m + distance_m
        middle_m = 0.5 * curvature_per_m * x_m * x_m
        return view.across_m(end_px, bottom_px, distance_m) - middle_m

    def is_left(end_px: float) -> bool:
        x, y, _ = view.ray(end_px, bottom_px)
        return y > x * curvature_per_m * (view.forward_m + ahead_m)

    left_px, right_px = ends_px
    left_m = across_m(left_px, ahead_m if is_left(left_px) else far_m)
    right_m = across_m(right_px, far_m if is_left(right_px) else ahead_m)
    return Extent(ahead_m, right_m, left_m)
