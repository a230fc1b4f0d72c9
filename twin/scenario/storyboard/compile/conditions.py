"""Triggers and conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    as_number,
    number_of,
    only_child,
    seconds_of,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.program.conditions import (
    AccelerationCondition,
    AngleCondition,
    AngleKind,
    CollisionCondition,
    ComparisonRule,
    Condition,
    ConditionEdge,
    DistanceCondition,
    DistanceFrame,
    DistanceKind,
    ElementState,
    ElementStateCondition,
    EndOfRoadCondition,
    LaneRange,
    OffroadCondition,
    ReachPositionCondition,
    RelativeAngleCondition,
    RelativeClearanceCondition,
    RelativeDistanceCondition,
    RelativeSpeedCondition,
    SimulationTimeCondition,
    SpeedAxis,
    SpeedCondition,
    StandStillCondition,
    TimeHeadwayCondition,
    TimeOfDayCondition,
    TimeToCollisionCondition,
    TrafficSignalCondition,
    TraveledDistanceCondition,
    Trigger,
    VariableCondition,
)
from twin.scenario.storyboard.program.signal_states import lamps_of_state

RULES = {
    "equalTo": ComparisonRule.EQUAL,
    "greaterThan": ComparisonRule.GREATER,
    "lessThan": ComparisonRule.LESS,
    "greaterOrEqual": ComparisonRule.GREATER_OR_EQUAL,
    "lessOrEqual": ComparisonRule.LESS_OR_EQUAL,
    "notEqualTo": ComparisonRule.NOT_EQUAL,
}
EDGES = {
    "none": ConditionEdge.NONE,
    "rising": ConditionEdge.RISING,
    "falling": ConditionEdge.FALLING,
    "risingOrFalling": ConditionEdge.EITHER,
}
FRAMES = {
    "entity": DistanceFrame.ENTITY,
    "road": DistanceFrame.ROAD,
    "lane": DistanceFrame.LANE,
    "trajectory": DistanceFrame.TRAJECTORY,
    "world": DistanceFrame.WORLD,
}
_KINDS = {
    "cartesianDistance": DistanceKind.EUCLIDEAN,
    "euclidianDistance": DistanceKind.EUCLIDEAN,
    "longitudinal": DistanceKind.LONGITUDINAL,
    "lateral": DistanceKind.LATERAL,
}
_AXES = {
    "longitudinal": SpeedAxis.LONGITUDINAL,
    "lateral": SpeedAxis.LATERAL,
    "vertical": SpeedAxis.VERTICAL,
}
_ANGLES = {"heading": AngleKind.HEADING, "pitch": AngleKind.PITCH, "roll": AngleKind.ROLL}
_STATES = {
    "standbyState": ElementState.STANDBY,
    "runningState": ElementState.RUNNING,
    "completeState": ElementState.COMPLETE,
    "startTransition": ElementState.START_TRANSITION,
    "endTransition": ElementState.END_TRANSITION,
    "stopTransition": ElementState.STOP_TRANSITION,
    "skipTransition": ElementState.SKIP_TRANSITION,
}
LANES_MAX = 1000
"""Lanes counted to one side; ranges that are open, or larger, end there."""
OBJECT_TYPES = {"vehicle": -2, "pedestrian": -3, "miscellaneous": -4}
"""Values of ``CollisionCondition.category`` for whole types of objects."""


def _trigger(element: ScenarioElement, context: Compilation) -> Trigger:
    groups = []
    for group in element.children:
        conditions = []
        for condition in group.children:
            with context.collecting(condition):
                conditions.append(_condition(condition, context))
        groups.append(tuple(conditions))
    return Trigger(tuple(groups))


def _condition(element: ScenarioElement, context: Compilation) -> Condition:
    delay = float(element.values["delay"])
    if not 0.0 <= delay < math.inf:
        raise RefusalError(element, f"delay is {delay:g} s, it must be 0 or more and finite")
    edge = EDGES[str(element.values["conditionEdge"])]
    by_entity = element.first("ByEntityCondition")
    if by_entity is None:
        leaf = only_child(only_child(element))
        return Condition(element.label, context.compile(leaf), edge, delay)
    triggering = by_entity.first("TriggeringEntities")
    inner = by_entity.first("EntityCondition")
    assert triggering is not None
    assert inner is not None
    numbers: dict[int, None] = {}
    for reference in triggering.children:
        numbers |= dict.fromkeys(context.members(reference))
    expression = context.compile(only_child(inner))
    everybody = triggering.values["triggeringEntitiesRule"] == "all"
    return Condition(element.label, expression, edge, delay, tuple(numbers), everybody)


def _rule(values: Mapping[str, Value]) -> ComparisonRule:
    return RULES[str(values["rule"])]


def _frame(element: ScenarioElement) -> DistanceFrame:
    """Coordinate system of a distance; ``alongRoute`` of version 1.0 means the road."""
    if "coordinateSystem" in element.values:
        return FRAMES[str(element.values["coordinateSystem"])]
    return DistanceFrame.ROAD if element.values.get("alongRoute") else DistanceFrame.ENTITY


def _kind(element: ScenarioElement, key: str = "relativeDistanceType") -> DistanceKind:
    """What is measured; without a word the straight distance, ``alongRoute``: along the road."""
    if key in element.values:
        return _KINDS[str(element.values[key])]
    along = bool(element.values.get("alongRoute"))
    return DistanceKind.LONGITUDINAL if along else DistanceKind.EUCLIDEAN


def _axis(element: ScenarioElement) -> SpeedAxis:
    word = element.values.get("direction")
    return SpeedAxis.TOTAL if word is None else _AXES[str(word)]


def _end_of_road(element: ScenarioElement, context: Compilation) -> EndOfRoadCondition:
    context.road_map(element)
    return EndOfRoadCondition(_duration(element))


def _duration(element: ScenarioElement) -> float:
    duration = float(element.values["duration"])
    if not 0.0 <= duration < math.inf:
        raise RefusalError(element, f"duration is {duration:g} s, it must be 0 or more and finite")
    return duration


def _collision(element: ScenarioElement, context: Compilation) -> CollisionCondition:
    child = only_child(element)
    if child.type_name == "EntityRef":
        return CollisionCondition(context.entity(child), -1)
    word = str(child.values["type"])
    if word not in OBJECT_TYPES:
        raise RefusalError(child, "objects that the player does not know collide with nothing")
    return CollisionCondition(-1, OBJECT_TYPES[word])


def _offroad(element: ScenarioElement, context: Compilation) -> OffroadCondition:
    context.road_map(element)
    return OffroadCondition(_duration(element))


def _headway(element: ScenarioElement, context: Compilation) -> TimeHeadwayCondition:
    values = element.values
    return TimeHeadwayCondition(
        context.entity(element),
        float(values["value"]),
        _rule(values),
        bool(values["freespace"]),
        _frame(element),
        _kind(element),
    )


def _time_to_collision(element: ScenarioElement, context: Compilation) -> TimeToCollisionCondition:
    values = element.values
    target = element.first("TimeToCollisionConditionTarget")
    assert target is not None
    child = only_child(target)
    by_entity = child.type_name == "EntityRef"
    return TimeToCollisionCondition(
        context.entity(child) if by_entity else -1,
        None if by_entity else context.position(child),
        float(values["value"]),
        _rule(values),
        bool(values["freespace"]),
        _frame(element),
        _kind(element),
    )


def _acceleration(element: ScenarioElement, _context: Compilation) -> AccelerationCondition:
    value = float(element.values["value"])
    return AccelerationCondition(value, _rule(element.values), _axis(element))


def _stand_still(element: ScenarioElement, _context: Compilation) -> StandStillCondition:
    return StandStillCondition(_duration(element))


def _speed(element: ScenarioElement, _context: Compilation) -> SpeedCondition:
    return SpeedCondition(float(element.values["value"]), _rule(element.values), _axis(element))


def _relative_speed(element: ScenarioElement, context: Compilation) -> RelativeSpeedCondition:
    value = float(element.values["value"])
    return RelativeSpeedCondition(
        context.entity(element), value, _rule(element.values), _axis(element)
    )


def _traveled(element: ScenarioElement, _context: Compilation) -> TraveledDistanceCondition:
    return TraveledDistanceCondition(float(element.values["value"]))


def _reach(element: ScenarioElement, context: Compilation) -> ReachPositionCondition:
    position = element.first("Position")
    assert position is not None
    return ReachPositionCondition(context.position(position), float(element.values["tolerance"]))


def _distance(element: ScenarioElement, context: Compilation) -> DistanceCondition:
    values, position = element.values, element.first("Position")
    assert position is not None
    return DistanceCondition(
        context.position(position),
        float(values["value"]),
        _rule(values),
        bool(values["freespace"]),
        _frame(element),
        _kind(element),
    )


def _relative_distance(element: ScenarioElement, context: Compilation) -> RelativeDistanceCondition:
    values = element.values
    return RelativeDistanceCondition(
        context.entity(element),
        float(values["value"]),
        _rule(values),
        bool(values["freespace"]),
        _frame(element),
        _kind(element),
    )


def _angle(element: ScenarioElement, _context: Compilation) -> AngleCondition:
    values = element.values
    frame = FRAMES[str(values.get("coordinateSystem", "world"))]
    return AngleCondition(
        _ANGLES[str(values["angleType"])],
        float(values["angle"]),
        float(values["angleTolerance"]),
        frame,
    )


def _relative_angle(element: ScenarioElement, context: Compilation) -> RelativeAngleCondition:
    values = element.values
    return RelativeAngleCondition(
        context.entity(element),
        _ANGLES[str(values["angleType"])],
        float(values["angle"]),
        float(values["angleTolerance"]),
    )


def _clearance(element: ScenarioElement, context: Compilation) -> RelativeClearanceCondition:
    context.road_map(element)
    ahead_m = number_of(element, "distanceForward", 0.0)
    behind_m = number_of(element, "distanceBackward", 0.0)
    if not (0.0 <= ahead_m < math.inf and 0.0 <= behind_m < math.inf):
        raise RefusalError(element, "distances must be 0 or more and finite")
    entities: dict[int, None] = {}
    for reference in element.all("EntityRef"):
        entities |= dict.fromkeys(context.members(reference))
    return RelativeClearanceCondition(
        ahead_m,
        behind_m,
        bool(element.values["freeSpace"]),
        bool(element.values["oppositeLanes"]),
        tuple(entities),
        tuple(_lane_range(item) for item in element.all("RelativeLaneRange")),
    )


def _lane_range(element: ScenarioElement) -> LaneRange:
    first, last = (
        max(-LANES_MAX, min(LANES_MAX, int(element.values.get(key, default))))
        for key, default in (("from", -LANES_MAX), ("to", LANES_MAX))
    )
    if first > last:
        raise RefusalError(element, f"from {first} is above to {last}")
    return LaneRange(first, last)


def _simulation_time(element: ScenarioElement, _context: Compilation) -> SimulationTimeCondition:
    return SimulationTimeCondition(float(element.values["value"]), _rule(element.values))


def _time_of_day(element: ScenarioElement, _context: Compilation) -> TimeOfDayCondition:
    seconds = seconds_of(str(element.values["dateTime"]))
    return TimeOfDayCondition(seconds, _rule(element.values))


def _variable_rule(element: ScenarioElement, context: Compilation, number: int) -> ComparisonRule:
    rule = _rule(element.values)
    text = context.variable_list[number].text
    if text and rule not in (ComparisonRule.EQUAL, ComparisonRule.NOT_EQUAL):
        raise RefusalError(
            element, f"words have no order; rule {element.values['rule']} needs numbers"
        )
    return rule


def _of_kind(kind: str, key: str) -> Handler:
    def handler(element: ScenarioElement, context: Compilation) -> VariableCondition:
        number = context.variable(element, kind, str(element.values[key]))
        value = context.number(element, number, element.values["value"])
        return VariableCondition(number, value, _variable_rule(element, context, number))

    return handler


def _user_value(element: ScenarioElement, context: Compilation) -> VariableCondition:
    """A value that something outside gives; until then it is no number and the empty word."""
    name, value = str(element.values["name"]), element.values["value"]
    ordered = _rule(element.values) not in (ComparisonRule.EQUAL, ComparisonRule.NOT_EQUAL)
    if f"value {name}" not in context.variables:
        try:
            as_number(element, value)
            context.declare("value", name, math.nan, text=False)
        except RefusalError:
            if ordered:
                raise
            context.declare("value", name, context.word(""), text=True)
    number = context.variables[f"value {name}"]
    return VariableCondition(
        number,
        context.number(element, number, value),
        _variable_rule(element, context, number),
    )


def _element_state(element: ScenarioElement, context: Compilation) -> ElementStateCondition:
    state = _STATES[str(element.values["state"])]
    return ElementStateCondition(context.part(element), state)


def _signal(element: ScenarioElement, context: Compilation) -> TrafficSignalCondition:
    number = signal_variable(element, context)
    return TrafficSignalCondition(number, context.word(str(element.values["state"])))


def signal_variable(element: ScenarioElement, context: Compilation, key: str = "name") -> int:
    """The variable with the state of the traffic signal that an attribute names."""
    return signal_named(element, context, str(element.values[key]))


def signal_named(element: ScenarioElement, context: Compilation, name: str) -> int:
    """The variable with the state of a traffic signal."""
    roads = context.road_map(element)
    signals = {signal.id for frame in roads.frames.values() for signal in frame.road.signals}
    if name not in signals:
        raise RefusalError(element, f"the road network has no signal '{name}'")
    if f"signal {name}" not in context.variables:
        context.declare("signal", name, context.word(""), text=True)
    return context.variables[f"signal {name}"]


def signal_word(element: ScenarioElement, context: Compilation) -> float:
    """The number of the state that a traffic signal is given; noted where pictures do not know
    which lamps it means."""
    state = str(element.values["state"])
    if lamps_of_state(state) is None:
        context.note(element, f"pictures do not know the state '{state}': its lamps are off there")
    return context.word(state)


CONDITIONS: dict[str, Handler] = {
    "Trigger": _trigger,
    "EndOfRoadCondition": _end_of_road,
    "CollisionCondition": _collision,
    "OffroadCondition": _offroad,
    "TimeHeadwayCondition": _headway,
    "TimeToCollisionCondition": _time_to_collision,
    "AccelerationCondition": _acceleration,
    "StandStillCondition": _stand_still,
    "SpeedCondition": _speed,
    "RelativeSpeedCondition": _relative_speed,
    "TraveledDistanceCondition": _traveled,
    "ReachPositionCondition": _reach,
    "DistanceCondition": _distance,
    "RelativeDistanceCondition": _relative_distance,
    "AngleCondition": _angle,
    "RelativeAngleCondition": _relative_angle,
    "RelativeClearanceCondition": _clearance,
    "SimulationTimeCondition": _simulation_time,
    "TimeOfDayCondition": _time_of_day,
    "VariableCondition": _of_kind("variable", "variableRef"),
    "ParameterCondition": _of_kind("parameter", "parameterRef"),
    "UserDefinedValueCondition": _user_value,
    "StoryboardElementStateCondition": _element_state,
    "TrafficSignalCondition": _signal,
}
"""Handlers of triggers and conditions by element type."""
