"""Playing of one scenario without a simulator: where everybody is, and which events happen when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.conditions import ElementState
from twin.scenario.storyboard.program.program import ElementKind, Program

STEP_S = 0.01
TIME_MAX_S = 3600.0
"""Longest time that is played."""


@dataclass(frozen=True, slots=True)
class PlayedEvent:
    """An event that started or ended."""

    time_s: float
    name: str
    actor: str
    started: bool


@dataclass(frozen=True, slots=True)
class ScenarioPlay:
    """What happened; T moments, N entities in the order of the program. The ego keeps its speed and
    lane: nobody drives it."""

    program: Program
    time_s: np.ndarray
    """[T], the last one is the end."""
    x_m: np.ndarray
    """[T, N], as all the others."""
    y_m: np.ndarray
    heading_rad: np.ndarray
    speed_mps: np.ndarray
    visible: np.ndarray
    road: np.ndarray
    s_m: np.ndarray
    lane: np.ndarray
    events: tuple[PlayedEvent, ...]
    limits: tuple[str, ...]
    """Limits of the player that were met."""

    def at(self, time_s: float) -> int:
        """Index of the moment nearest to a time."""
        return int(np.argmin(np.abs(self.time_s - time_s)))

    def entity(self, name: str) -> int:
        """Index of an entity."""
        return [entity.name for entity in self.program.entities].index(name)

    def time_of(self, event: str, *, started: bool = True) -> float | None:
        """When an event first started or ended; None: it did not."""
        times = [e.time_s for e in self.events if e.name == event and e.started == started]
        return times[0] if times else None

    def distance_m(self, one: str, other: str) -> np.ndarray:
        """Between the origins of two entities [T]."""
        a, b = self.entity(one), self.entity(other)
        return np.hypot(self.x_m[:, a] - self.x_m[:, b], self.y_m[:, a] - self.y_m[:, b])


_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps", "visible", "road", "s_m", "lane")


def play_scenario(
    program: Program, *, every: int = 10, until_s: float = TIME_MAX_S
) -> ScenarioPlay:
    """Play a program to its end.

    Args:
        program: what is played.
        every: steps of 10 ms between two moments that are kept.
        until_s: it is not played any longer.
    """
    roads = road_tables(program.network) if program.network is not None else None
    player = StoryboardPlayer([program], roads, 1, step_s=STEP_S)
    player.start(0, 0)
    rows: list[tuple[np.ndarray, ...]] = []
    times: list[float] = []

    def keep() -> None:
        states = player.states()
        times.append(player.steps(0) * STEP_S)
        rows.append(tuple(np.array(getattr(states, name)[0]) for name in _COLUMNS))

    keep()
    while player.running(0) and player.steps(0) * STEP_S < until_s - 0.5 * STEP_S:
        player.step()
        if player.steps(0) % every == 0 and player.running(0):
            keep()
    keep()
    columns = dict(zip(_COLUMNS, (np.stack(column) for column in zip(*rows, strict=True))))
    return ScenarioPlay(
        program, np.array(times), **columns, events=_events(program, player), limits=player.overflows(0)
    )


def _events(program: Program, player: StoryboardPlayer) -> tuple[PlayedEvent, ...]:
    events = []
    for transition in player.transitions(0):
        element = program.elements[transition.element]
        kinds = ElementState.START_TRANSITION, ElementState.END_TRANSITION
        if element.kind is not ElementKind.EVENT or transition.state not in kinds:
            continue
        group = program.elements[program.elements[element.parent].parent]
        started = transition.state is ElementState.START_TRANSITION
        events.append(PlayedEvent(transition.step * STEP_S, element.name, group.name, started))
    return tuple(events)
