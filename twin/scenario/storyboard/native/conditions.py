"""Conditions of events and of the end."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from schemas.validation import suggest
from twin.scenario.storyboard.native.ground import NativeMistakes, ScenarioGround
from twin.scenario.storyboard.native.starts import StartPlace, origin_at
from twin.scenario.storyboard.native.watches import RELATIVE, ActorWatch, ScenarioSpot, ValueRange
from twin.scenario.storyboard.program import conditions as records
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    Condition,
    ConditionEdge,
    DistanceFrame,
    DistanceKind,
    ElementState,
    EntityExpression,
    SpeedAxis,
    Trigger,
    ValueExpression,
)

Groups = tuple[tuple[Condition, ...], ...]


def condition(
    name: str,
    expression: EntityExpression | ValueExpression,
    delay_s: float = 0.0,
    entity: int | None = None,
) -> Condition:
    """A condition that counts as long as it holds."""
    entities = () if entity is None else (entity,)
    return Condition(name, expression, ConditionEdge.NONE, delay_s, entities)


def at_time(time_s: float) -> Condition:
    """From a time on."""
    rule = ComparisonRule.GREATER_OR_EQUAL
    return condition(f"{time_s:g} s", records.SimulationTimeCondition(time_s, rule))


def element_in(name: str, element: int, state: ElementState, delay_s: float) -> Condition:
    """A storyboard element is in a state."""
    return condition(name, records.ElementStateCondition(element, state), delay_s)


def watch_conditions(
    path: str,
    name: str,
    watch: ActorWatch,
    delay_s: float,
    ground: ScenarioGround,
    places: Mapping[str, StartPlace],
    numbers: Mapping[str, int],
    mistakes: NativeMistakes,
) -> list[Condition]:
    """Conditions on one actor; what cannot be is noted.

    Args:
        path: of the watch in the file.
        name: the actor.
        watch: what must hold of it.
        delay_s: of each condition.
        ground: the roads.
        places: where everybody starts.
        numbers: of entities, by name.
        mistakes: gets what is wrong.
    """
    if name not in numbers:
        mistakes.add(path, f"no actor '{name}'; {suggest(name, list(numbers))}")
        return []
    other = _other(path, name, watch, numbers, mistakes)
    expressions: list[tuple[str, EntityExpression]] = []
    for field in (*RELATIVE, "speed_mps", "acceleration_mps2"):
        bounds = getattr(watch, field)
        if bounds is not None and (other is not None or field not in RELATIVE):
            expressions += [
                (f"{name} {field} {words}", _expression(field, value, rule, other or 0))
                for value, rule, words in _bounds(bounds)
            ]
    if watch.travelled_m is not None:
        words = f"{name} travelled {watch.travelled_m:g} m"
        expressions.append((words, records.TraveledDistanceCondition(watch.travelled_m)))
    if watch.stands_s is not None:
        words = f"{name} stands for {watch.stands_s:g} s"
        expressions.append((words, records.StandStillCondition(watch.stands_s)))
    if watch.touches:
        touched = _touched(f"{path}.touches", name, watch.touches, numbers, mistakes)
        words = f"{name} touches {watch.touches}"
        expressions.append((words, records.CollisionCondition(touched, -1)))
    if watch.reaches is not None and name in places:
        spot = watch.reaches
        there = mistakes.attempt(
            f"{path}.reaches", lambda: reach_expression(spot, ground, places[name])
        )
        expressions += [(f"{name} reaches {spot.s_m:g} m", there)] if there else []
    return [condition(words, one, delay_s, numbers[name]) for words, one in expressions]


def reach_expression(
    spot: ScenarioSpot, ground: ScenarioGround, place: StartPlace
) -> records.ReachPositionCondition:
    """The middle of an actor is at a spot.

    Raises:
        SpotError: there is no such place.
    """
    return records.ReachPositionCondition(origin_at(spot, ground, place), spot.within_m)


def _other(
    path: str,
    name: str,
    watch: ActorWatch,
    numbers: Mapping[str, int],
    mistakes: NativeMistakes,
) -> int | None:
    """Number of the one that gaps and times are to; None: there is none."""
    relative = [field for field in RELATIVE if getattr(watch, field) is not None]
    others = [other for other in numbers if other != name]
    if not relative:
        if watch.to:
            mistakes.add(f"{path}.to", f"nothing is to '{watch.to}'; give {', '.join(RELATIVE)}")
        return None
    if not watch.to and name == "ego":
        words = f"missing; {relative[0]} of the ego is to an actor: {', '.join(others)}"
        mistakes.add(f"{path}.to", words)
        return None
    to = watch.to or "ego"
    if to == name or to not in numbers:
        words = "itself" if to == name else "no actor"
        mistakes.add(f"{path}.to", f"'{to}' is {words}; {suggest(to, others)}")
        return None
    return numbers[to]


def _touched(
    path: str, name: str, touched: str, numbers: Mapping[str, int], mistakes: NativeMistakes
) -> int:
    if touched == "any":
        return -1
    if touched not in numbers or touched == name:
        others = [other for other in numbers if other != name]
        mistakes.add(path, f"no actor '{touched}' to touch; {suggest(touched, ['any', *others])}")
        return -1
    return numbers[touched]


def _bounds(bounds: ValueRange) -> list[tuple[float, ComparisonRule, str]]:
    rows = []
    if bounds.below is not None:
        rows.append((bounds.below, ComparisonRule.LESS, f"below {bounds.below:g}"))
    if bounds.above is not None:
        rows.append((bounds.above, ComparisonRule.GREATER, f"above {bounds.above:g}"))
    return rows


def _expression(field: str, value: float, rule: ComparisonRule, other: int) -> EntityExpression:
    road, along, across = DistanceFrame.ROAD, DistanceKind.LONGITUDINAL, DistanceKind.LATERAL
    match field:
        case "gap_m":
            return records.RelativeDistanceCondition(other, value, rule, True, road, along)
        case "lateral_gap_m":
            return records.RelativeDistanceCondition(other, value, rule, True, road, across)
        case "distance_m":
            return records.RelativeDistanceCondition(
                other, value, rule, True, DistanceFrame.ENTITY, DistanceKind.EUCLIDEAN
            )
        case "headway_s":
            return records.TimeHeadwayCondition(other, value, rule, True, road, along)
        case "ttc_s":
            return records.TimeToCollisionCondition(other, None, value, rule, True, road, along)
        case "relative_speed_mps":
            return records.RelativeSpeedCondition(other, value, rule, SpeedAxis.LONGITUDINAL)
        case "speed_mps":
            return records.SpeedCondition(value, rule, SpeedAxis.LONGITUDINAL)
    assert field == "acceleration_mps2"
    return records.AccelerationCondition(value, rule, SpeedAxis.LONGITUDINAL)


def all_of(parts: Sequence[Groups]) -> Trigger | None:
    """True if every part is, each of which is true if any of its groups is; None: no part."""
    if not parts:
        return None
    groups = itertools.product(*parts)
    return Trigger(tuple(tuple(itertools.chain(*group)) for group in groups))
