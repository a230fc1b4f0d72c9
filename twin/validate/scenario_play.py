"""One scenario, played with nobody at the ego's wheel: where everybody is, what happens when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.play.playing import play_programs
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import Transition
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
    """The first of those whose event it is; empty: nobody's."""
    started: bool
    belongs: bool = False
    """It is part of an event of the file, such as the stop at the end of a path."""


@dataclass(frozen=True, slots=True)
class ScenarioPlay:
    """What happened; T moments, N entities in the order of the program; NaN: not there."""

    program: Program
    time_s: np.ndarray
    """[T], the last one is the end."""
    x_m: np.ndarray
    """Of their origins [T, N]."""
    y_m: np.ndarray
    """[T, N]."""
    heading_rad: np.ndarray
    """[T, N]."""
    speed_mps: np.ndarray
    """[T, N]."""
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

    def middle(self, name: str) -> np.ndarray:
        """x and y of the middle of an entity's box [T, 2]."""
        index = self.entity(name)
        ahead = self.program.entities[index].box.centre_x_m
        heading = self.heading_rad[:, index]
        x = self.x_m[:, index] + ahead * np.cos(heading)
        return np.stack([x, self.y_m[:, index] + ahead * np.sin(heading)], axis=1)


_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps")


def play_scenario(
    program: Program, *, every: int = 10, until_s: float = TIME_MAX_S
) -> ScenarioPlay:
    """Play a program to its end; the ego keeps its speed and lane, for nobody drives it.

    Args:
        program: what is played.
        every: steps of 10 ms between two moments that are kept.
        until_s: it is not played any longer.

    Raises:
        UsageError: the program is larger than a limit.
    """
    roads = road_tables(program.network) if program.network is not None else None
    (record,) = play_programs([program], roads, step_s=STEP_S, every=every, until_s=until_s)
    times = sorted({row.time_s for row in record.rows})
    moments = {time_s: index for index, time_s in enumerate(times)}
    numbers = {entity.name: index for index, entity in enumerate(program.entities)}
    columns = {name: np.full((len(times), len(numbers)), np.nan) for name in _COLUMNS}
    for row in record.rows:
        for name, values in columns.items():
            values[moments[row.time_s], numbers[row.entity]] = getattr(row, name)
    return ScenarioPlay(
        program,
        np.array(times),
        **columns,
        events=_events(program, record.transitions),
        limits=record.overflows,
    )


def _events(program: Program, transitions: list[Transition]) -> tuple[PlayedEvent, ...]:
    events = []
    for transition in transitions:
        element = program.elements[transition.element]
        started = transition.state is ElementState.START_TRANSITION
        ended = transition.state is ElementState.END_TRANSITION
        if element.kind is ElementKind.EVENT and (started or ended):
            group = program.elements[program.elements[element.parent].parent]
            time_s = transition.step * STEP_S
            # Scenario files have one event in a maneuver, of the same name; what follows is ours.
            belongs = element.name.startswith(f"{program.elements[element.parent].name} ")
            actor = program.entities[group.actors[0]].name if group.actors else ""
            events.append(PlayedEvent(time_s, element.name, actor, started, belongs))
    return tuple(events)
