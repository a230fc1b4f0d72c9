"""Actions that change the speed, the lane or the distance of an entity."""

from __future__ import annotations

import math

from twin.scenario.storyboard.compile.conditions import FRAMES
from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
    only_child,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.actions import (
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    LaneChangeAction,
    LaneOffsetAction,
    LateralDistanceAction,
    LongitudinalDistanceAction,
    MotionLimits,
    SpeedAction,
    SpeedProfileAction,
    SpeedProfileEntry,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import DistanceFrame

_SHAPES = {
    "linear": DynamicsShape.LINEAR,
    "cubic": DynamicsShape.CUBIC,
    "sinusoidal": DynamicsShape.SINUSOIDAL,
    "step": DynamicsShape.STEP,
}
_DIMENSIONS = {
    "time": DynamicsDimension.TIME,
    "rate": DynamicsDimension.RATE,
    "distance": DynamicsDimension.DISTANCE,
}
_DISPLACEMENTS = {
    "any": Displacement.ANY,
    "leadingReferencedEntity": Displacement.AHEAD,
    "trailingReferencedEntity": Displacement.BEHIND,
    "leftToReferencedEntity": Displacement.AHEAD,
    "rightToReferencedEntity": Displacement.BEHIND,
}
_LIMITS = (
    *("maxAcceleration", "maxDeceleration", "maxSpeed"),
    *("maxAccelerationRate", "maxDecelerationRate"),
)


def _dynamics(element: ScenarioElement, context: Compilation) -> TransitionDynamics:
    shape = _SHAPES[str(element.values["dynamicsShape"])]
    dimension = _DIMENSIONS[str(element.values["dynamicsDimension"])]
    value = float(element.values["value"])
    if dimension is DynamicsDimension.RATE and value < 0.0:
        # The standard allows 0 or more; files in use give decelerations with their sign.
        context.note(element, f"the rate of {value:g} counts as {-value:g}")
        value = -value
    if shape is DynamicsShape.STEP:
        return TransitionDynamics(shape, DynamicsDimension.TIME, 0.0)
    if not 0.0 <= value < math.inf:
        raise RefusalError(element, f"value is {value:g}, it must be 0 or more and finite")
    return TransitionDynamics(shape, dimension, value)


def _limits(element: ScenarioElement) -> MotionLimits:
    limits = element.first("DynamicConstraints")
    if limits is None:
        return MotionLimits()
    values = [number_of(limits, key, math.inf) for key in _LIMITS]
    if any(not value >= 0.0 for value in values):
        raise RefusalError(limits, "limits must not be negative")
    return MotionLimits(*values)


def _speed(element: ScenarioElement, context: Compilation) -> SpeedAction:
    dynamics, target = element.first("SpeedActionDynamics"), element.first("SpeedActionTarget")
    assert dynamics is not None
    assert target is not None
    leaf = only_child(target)
    value = float(leaf.values["value"])
    if leaf.type_name == "AbsoluteTargetSpeed":
        return SpeedAction(_dynamics(dynamics, context), -1, value)
    return SpeedAction(
        _dynamics(dynamics, context),
        context.entity(leaf),
        value,
        leaf.values["speedTargetValueType"] == "factor",
        bool(leaf.values["continuous"]),
    )


def _speed_profile(element: ScenarioElement, context: Compilation) -> SpeedProfileAction:
    reference = context.entity(element) if "entityRef" in element.values else -1
    entries = []
    for entry in element.all("SpeedProfileEntry"):
        duration = number_of(entry, "time", -1.0)
        if "time" in entry.values and not 0.0 <= duration < math.inf:
            raise RefusalError(entry, f"time is {duration:g} s, it must be 0 or more and finite")
        entries.append(SpeedProfileEntry(float(entry.values["speed"]), duration))
    follow = element.values["followingMode"] == "follow"
    return SpeedProfileAction(reference, tuple(entries), follow, _limits(element))


def _longitudinal_distance(
    element: ScenarioElement, context: Compilation
) -> LongitudinalDistanceAction:
    values = element.values
    if ("distance" in values) == ("timeGap" in values):
        raise RefusalError(element, "give either distance or timeGap")
    value = float(values["distance" if "distance" in values else "timeGap"])
    if not 0.0 <= value < math.inf:
        raise RefusalError(element, f"it asks for {value:g}, which must be 0 or more and finite")
    return LongitudinalDistanceAction(
        context.entity(element),
        value,
        "timeGap" in values,
        bool(values["freespace"]),
        bool(values["continuous"]),
        _frame(element),
        _DISPLACEMENTS[str(values.get("displacement", "trailingReferencedEntity"))],
        _limits(element),
    )


def _frame(element: ScenarioElement) -> DistanceFrame:
    return FRAMES[str(element.values.get("coordinateSystem", "entity"))]


def _lane_change(element: ScenarioElement, context: Compilation) -> LaneChangeAction:
    context.road_map(element)
    dynamics, target = element.first("LaneChangeActionDynamics"), element.first("LaneChangeTarget")
    assert dynamics is not None
    assert target is not None
    leaf = only_child(target)
    reference = context.entity(leaf) if leaf.type_name == "RelativeTargetLane" else -1
    try:
        lane = int(str(leaf.values["value"]))
    except ValueError:
        raise RefusalError(leaf, f"'{leaf.values['value']}' is no lane of OpenDRIVE") from None
    if reference < 0 and lane == 0:
        raise RefusalError(leaf, "lane 0 is the centre line, nobody drives on it")
    offset = number_of(element, "targetLaneOffset", 0.0)
    return LaneChangeAction(_dynamics(dynamics, context), reference, lane, offset)


def _lane_offset(element: ScenarioElement, context: Compilation) -> LaneOffsetAction:
    context.road_map(element)
    dynamics, target = element.first("LaneOffsetActionDynamics"), element.first("LaneOffsetTarget")
    assert dynamics is not None
    assert target is not None
    leaf = only_child(target)
    relative = leaf.type_name == "RelativeTargetLaneOffset"
    most = number_of(dynamics, "maxLateralAcc", math.inf)
    if not most > 0.0:
        raise RefusalError(dynamics, f"maxLateralAcc is {most:g} m/s2, it must be above 0")
    return LaneOffsetAction(
        _SHAPES[str(dynamics.values["dynamicsShape"])],
        most,
        context.entity(leaf) if relative else -1,
        float(leaf.values["value"]),
        bool(element.values["continuous"]),
    )


def _lateral_distance(element: ScenarioElement, context: Compilation) -> LateralDistanceAction:
    values = element.values
    if "distance" not in values:
        raise RefusalError(element, "give a distance")
    limits = element.first("DynamicConstraints")
    for key in _LIMITS[3:]:
        if limits is not None and key in limits.values:
            context.note(limits, f"{key} has no effect on a lateral distance")
    return LateralDistanceAction(
        context.entity(element),
        float(values["distance"]),
        bool(values["freespace"]),
        bool(values["continuous"]),
        _frame(element),
        _DISPLACEMENTS[str(values.get("displacement", "any"))],
        _limits(element),
    )


MOTIONS: dict[str, Handler] = {
    "SpeedAction": _speed,
    "SpeedProfileAction": _speed_profile,
    "LongitudinalDistanceAction": _longitudinal_distance,
    "LaneChangeAction": _lane_change,
    "LaneOffsetAction": _lane_offset,
    "LateralDistanceAction": _lateral_distance,
}
"""Handlers of motions by element type."""
