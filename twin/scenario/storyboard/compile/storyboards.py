"""The storyboard: its elements in depth-first order, their triggers, and the actions of Init."""

from __future__ import annotations

from dataclasses import dataclass

from twin.scenario.storyboard.compile.context import Compilation, RefusalError, only_child
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.references import STORYBOARD_TYPES
from twin.scenario.storyboard.program.conditions import Trigger
from twin.scenario.storyboard.program.program import (
    ElementKind,
    EventPriority,
    InitAction,
    StoryElement,
)

EXECUTIONS_MAX = 1_000_000
"""Larger counts in a file mean this."""
_KINDS = {
    "Story": ElementKind.STORY,
    "Act": ElementKind.ACT,
    "ManeuverGroup": ElementKind.GROUP,
    "Maneuver": ElementKind.MANEUVER,
    "Event": ElementKind.EVENT,
    "Action": ElementKind.ACTION,
}
_PRIORITIES = {
    "parallel": EventPriority.PARALLEL,
    "override": EventPriority.OVERRIDE,
    "overwrite": EventPriority.OVERRIDE,
    "skip": EventPriority.SKIP,
}
GLOBAL = ("GlobalAction", "UserDefinedAction")


@dataclass(frozen=True, slots=True)
class _Place:
    """An element of the storyboard before its triggers and actions are compiled."""

    element: ScenarioElement
    parent: int


def compile_storyboard(
    storyboard: ScenarioElement, context: Compilation
) -> tuple[StoryElement, ...]:
    """All elements in depth-first order, the storyboard first."""
    places = [_Place(storyboard, -1)]
    _number(storyboard, 0, "", places, context)
    return tuple(_compiled(place, context) for place in places)


def _number(
    element: ScenarioElement,
    parent: int,
    path: str,
    places: list[_Place],
    context: Compilation,
) -> None:
    """Give every element its number first, so that conditions can refer to later ones."""
    for child in (*element.children, *([element.target] if element.target else [])):
        below, number = path, parent
        if child.type_name in _KINDS:
            below = f"{path}::{child.label}" if path else child.label
            number = len(places)
            context.elements.setdefault((STORYBOARD_TYPES[child.type_name], below), number)
            places.append(_Place(child, parent))
        _number(child, number, below, places, context)


def _compiled(place: _Place, context: Compilation) -> StoryElement:
    element = place.element
    kind = _KINDS.get(element.type_name, ElementKind.STORYBOARD)
    name, line = element.label, element.line
    if kind is ElementKind.STORYBOARD:
        stop = _trigger(element, "StopTrigger", context)
        return StoryElement(kind, "", -1, line, stop=stop)
    if kind is ElementKind.ACT:
        start = _trigger(element, "StartTrigger", context)
        stop = _trigger(element, "StopTrigger", context)
        return StoryElement(kind, name, place.parent, line, start=start, stop=stop)
    if kind is ElementKind.GROUP:
        actors, triggering = _actors(element, context)
        return StoryElement(
            kind,
            name,
            place.parent,
            line,
            executions_max=_executions(element),
            actors=actors,
            triggering_actors=triggering,
        )
    if kind is ElementKind.EVENT:
        return StoryElement(
            kind,
            name,
            place.parent,
            line,
            start=_trigger(element, "StartTrigger", context),
            priority=_PRIORITIES[str(element.values["priority"])],
            executions_max=_executions(element),
        )
    if kind is ElementKind.ACTION:
        action = None
        with context.collecting(element):
            action = context.compile(only_child(element))
        return StoryElement(kind, name, place.parent, line, action=action)
    return StoryElement(kind, name, place.parent, line)


def _trigger(element: ScenarioElement, name: str, context: Compilation) -> Trigger | None:
    child = element.first(name)
    if child is None:
        return None
    trigger: Trigger = context.compile(child)
    return trigger


def _executions(element: ScenarioElement) -> int:
    return min(int(element.values.get("maximumExecutionCount", 1)), EXECUTIONS_MAX)


def _actors(element: ScenarioElement, context: Compilation) -> tuple[tuple[int, ...], bool]:
    actors = element.first("Actors")
    assert actors is not None
    numbers: dict[int, None] = {}
    for reference in actors.children:
        with context.collecting(reference):
            numbers |= dict.fromkeys(context.members(reference))
    return tuple(numbers), bool(actors.values["selectTriggeringEntities"])


def compile_init(init: ScenarioElement, context: Compilation) -> tuple[InitAction, ...]:
    """The actions of Init in the order of the file."""
    actions = []
    for child in only_child(init).children:
        if child.type_name in GLOBAL:
            with context.collecting(child):
                actions.append(InitAction(context.compile(child)))
            continue
        actors: tuple[int, ...] = ()
        with context.collecting(child):
            actors = context.members(child)
        for item in child.children:
            with context.collecting(item):
                action = context.compile(item)
                if action is None:
                    raise RefusalError(item, "it does nothing")
                actions += [InitAction(action, actor) for actor in actors]
    return tuple(actions)
