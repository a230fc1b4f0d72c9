"""Actions of a program, one row for each actor that may do them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from msgspec.structs import fields

from twin.scenario.storyboard.player.kinds import ACTION_TYPES, action_code, domains_of
from twin.scenario.storyboard.program.actions import Action, AddEntityAction, GlobalAction
from twin.scenario.storyboard.program.conditions import Trigger
from twin.scenario.storyboard.program.places import RelativePosition
from twin.scenario.storyboard.program.program import ElementKind, Program


@dataclass(frozen=True, slots=True)
class ActionInstance:
    """An action of one actor."""

    action: Action
    kind: int
    actor: int
    """-1: global."""
    element: int
    """-1: of Init."""
    domains: int
    level: int
    always: int
    """1: named as an actor; 0: only if it triggered the event."""

    @property
    def body(self) -> int:
        """The entity whose state it changes; -1: none's."""
        return self.action.entity if isinstance(self.action, AddEntityAction) else self.actor


@dataclass(frozen=True, slots=True)
class ProgramInstances:
    """Make it with :func:`program_instances`."""

    rows: tuple[ActionInstance, ...]
    """Those of Init first, then in the order of the storyboard."""
    inits: int
    by_element: dict[int, tuple[int, int]]
    """Where those of an action element begin, and how many there are."""
    levels: int
    """Rounds that Init takes."""


def program_instances(program: Program) -> ProgramInstances:
    """All instances of a program."""
    levels = _init_levels(program)
    rows = [
        _instance(init.action, init.actor, -1, level)
        for init, level in zip(program.init, levels, strict=True)
    ]
    inits = len(rows)
    by_element = {}
    for index, element in enumerate(program.elements):
        if element.kind is not ElementKind.ACTION or element.action is None:
            continue
        first = len(rows)
        if isinstance(element.action, GlobalAction):
            rows.append(_instance(element.action, -1, index, 0))
        else:
            for actor, always in _actors(program, index):
                rows.append(_instance(element.action, actor, index, 0, always))
        by_element[index] = (first, len(rows) - first)
    return ProgramInstances(tuple(rows), inits, by_element, max(levels, default=0) + 1)


def _instance(
    action: Action, actor: int, element: int, level: int, always: int = 1
) -> ActionInstance:
    assert type(action) in ACTION_TYPES
    return ActionInstance(
        action, action_code(type(action)), actor, element, domains_of(action), level, always
    )


def _actors(program: Program, action: int) -> Iterator[tuple[int, int]]:
    """Who may do an action: the actors of its group, then those that may trigger its event."""
    event = program.elements[action].parent
    group = event
    while program.elements[group].kind is not ElementKind.GROUP:
        group = program.elements[group].parent
    named = program.elements[group].actors
    yield from ((actor, 1) for actor in named)
    if program.elements[group].triggering_actors:
        trigger = program.elements[event].start
        yield from ((actor, 0) for actor in _triggering(trigger) if actor not in named)


def _triggering(trigger: Trigger | None) -> list[int]:
    groups = trigger.groups if trigger is not None else ()
    entities = (e for group in groups for condition in group for e in condition.entities)
    return list(dict.fromkeys(entities))


def _init_levels(program: Program) -> list[int]:
    """The round of each Init action: after all earlier ones of entities that it refers to.

    Actions of one round start at the same time on what was there before it, so the order of
    actors is that of the file wherever it matters.
    """
    done = [0] * len(program.entities)
    """Rounds after which each entity stands where Init has put it so far."""
    read = [0] * len(program.entities)
    """Round in which others have last read its state."""
    levels = []
    for init in program.init:
        references = _references(init.action)
        level = max((done[entity] for entity in references), default=0)
        if init.actor >= 0:
            level = max(level, done[init.actor] - 1, read[init.actor])
            done[init.actor] = max(done[init.actor], level + 1)
        for entity in references:
            read[entity] = max(read[entity], level)
        levels.append(level)
    return levels


def _references(action: Action) -> list[int]:
    """Entities whose states an action reads when it starts."""
    entities = []
    for field in fields(action):
        value = getattr(action, field.name)
        if isinstance(value, RelativePosition):
            entities.append(value.entity)
        elif field.name in ("entity", "master") and isinstance(value, int) and value >= 0:
            entities.append(value)
    return entities
