"""Storyboard programs for tests, written from a few words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.road.tables.road_tables import RoadTables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.actions import (
    Action,
    DynamicsDimension,
    DynamicsShape,
    SpeedAction,
    TeleportAction,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    Condition,
    ConditionEdge,
    EntityExpression,
    SimulationTimeCondition,
    Trigger,
    ValueExpression,
)
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.places import FixedPosition, RoadRoute, Trajectory
from twin.scenario.storyboard.program.program import (
    DriverModel,
    ElementKind,
    EventPriority,
    InitAction,
    Program,
    ProgramVariable,
    StoryElement,
)

STEP_S = 0.01


class EventPlan(NamedTuple):
    """An event of the one maneuver of a group."""

    start: Trigger | None
    actions: Sequence[Action]
    priority: EventPriority = EventPriority.PARALLEL
    runs: int = 1


class GroupPlan(NamedTuple):
    """A maneuver group with one maneuver."""

    actors: tuple[int, ...]
    events: Sequence[EventPlan]
    runs: int = 1
    triggering: bool = False


def car(name: str = "car", **changes: object) -> StoryboardEntity:
    """A car of 5 m x 2 m whose origin is 1.5 m before its rear end."""
    fields: dict[str, object] = {
        "name": name,
        "category": EntityCategory.CAR,
        "box": BodyBox(1.0, 0.0, 0.8, 5.0, 2.0, 1.6),
        "speed_max_mps": 70.0,
        "acceleration_max_mps2": 20.0,
        "deceleration_max_mps2": 20.0,
        "wheelbase_m": 3.0,
        "mass_kg": 1500.0,
        "ego": False,
    }
    return StoryboardEntity(**(fields | changes))  # type: ignore[arg-type]


def at(x_m: float, y_m: float = 0.0, heading_rad: float = 0.0) -> FixedPosition:
    """A place on open ground."""
    return FixedPosition(x_m, y_m, 0.0, heading_rad)


def dynamics(
    shape: DynamicsShape, value: float, dimension: DynamicsDimension = DynamicsDimension.TIME
) -> TransitionDynamics:
    """How a value changes."""
    return TransitionDynamics(shape, dimension, value)


def speed_at_once(speed_mps: float) -> SpeedAction:
    """A speed action of shape step."""
    return SpeedAction(dynamics(DynamicsShape.STEP, 0.0), -1, speed_mps)


def speed_over(seconds: float, speed_mps: float) -> SpeedAction:
    """A linear speed action."""
    return SpeedAction(dynamics(DynamicsShape.LINEAR, seconds), -1, speed_mps)


def when(
    expression: EntityExpression | ValueExpression,
    *entities: int,
    edge: ConditionEdge = ConditionEdge.NONE,
    delay_s: float = 0.0,
    every: bool = False,
) -> Condition:
    """A condition."""
    return Condition("c", expression, edge, delay_s, entities, every)


def trigger(*conditions: Condition) -> Trigger:
    """A trigger of one group."""
    return Trigger((conditions,))


def from_time(seconds: float, **changes: object) -> Trigger:
    """True from a time on."""
    rule = ComparisonRule.GREATER_OR_EQUAL
    return trigger(when(SimulationTimeCondition(seconds, rule), **changes))  # type: ignore[arg-type]


def start_at(entity: int, place: FixedPosition, speed_mps: float) -> list[InitAction]:
    """Init of an entity."""
    return [
        InitAction(TeleportAction(place), entity),
        InitAction(speed_at_once(speed_mps), entity),
    ]


def program(
    entities: Sequence[StoryboardEntity],
    init: Sequence[InitAction],
    groups: Sequence[GroupPlan] = (),
    *,
    stop: Trigger | None = None,
    act_stop: Trigger | None = None,
    variables: Sequence[ProgramVariable] = (),
    trajectories: Sequence[Trajectory] = (),
    routes: Sequence[RoadRoute] = (),
    models: Sequence[DriverModel] = (),
) -> Program:
    """A program of one act. Names of elements: g0, g0.m, g0.e0, g0.e0.a0 ..."""
    elements = [
        StoryElement(ElementKind.STORYBOARD, "storyboard", -1, stop=stop),
        StoryElement(ElementKind.STORY, "story", 0),
        StoryElement(ElementKind.ACT, "act", 1, stop=act_stop),
    ]
    for number, group in enumerate(groups):
        name = f"g{number}"
        elements.append(
            StoryElement(
                ElementKind.GROUP,
                name,
                2,
                executions_max=group.runs,
                actors=group.actors,
                triggering_actors=group.triggering,
            )
        )
        elements.append(StoryElement(ElementKind.MANEUVER, f"{name}.m", len(elements) - 1))
        maneuver = len(elements) - 1
        for index, event in enumerate(group.events):
            elements.append(
                StoryElement(
                    ElementKind.EVENT,
                    f"{name}.e{index}",
                    maneuver,
                    start=event.start,
                    priority=event.priority,
                    executions_max=event.runs,
                )
            )
            parent = len(elements) - 1
            elements += [
                StoryElement(ElementKind.ACTION, f"{name}.e{index}.a{k}", parent, action=action)
                for k, action in enumerate(event.actions)
            ]
    return Program(
        "test",
        tuple(entities),
        tuple(elements),
        tuple(init),
        trajectories=tuple(trajectories),
        routes=tuple(routes),
        variables=tuple(variables),
        models=tuple(models),
    )


class Played(NamedTuple):
    """What became of a program; arrays [steps + 1, entities]."""

    player: StoryboardPlayer
    x_m: np.ndarray
    y_m: np.ndarray
    heading_rad: np.ndarray
    speed_mps: np.ndarray
    lane: np.ndarray
    events: list[tuple[int, str, str]]
    """Step, element and transition."""


def played(plan: Program, steps: int, roads: RoadTables | None = None) -> Played:
    """A program after so many steps, or until its storyboard has stopped."""
    player = StoryboardPlayer([plan], roads, 1, step_s=STEP_S)
    player.start(0, 0)
    rows = []
    for number in range(steps + 1):
        states = player.states()
        rows.append(
            (
                *(states.x_m[0], states.y_m[0], states.heading_rad[0], states.speed_mps[0]),
                states.lane[0],
            )
        )
        if number < steps and player.running(0):
            player.step()
        if player.steps(0) <= number:
            break
    columns = [np.array([row[k] for row in rows]) for k in range(5)]
    names = [element.name for element in plan.elements]
    events = [
        (row.step, names[row.element], row.state.name.partition("_")[0].lower())
        for row in player.transitions(0)
    ]
    return Played(player, *columns, events)


def steps_of(events: Sequence[tuple[int, str, str]], name: str, transition: str) -> list[int]:
    """Steps at which an element went through a transition."""
    return [step for step, element, kind in events if (element, kind) == (name, transition)]
