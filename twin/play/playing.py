"""Programs played from beginning to end: poses at given steps, and the transitions of elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from schemas.escape import escape
from twin.road.tables.road_tables import RoadTables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer, Transition
from twin.scenario.storyboard.program.program import Program

SLOTS_MAX = 64
"""Programs that are played beside one another."""

Imposed = Callable[[int, int], Sequence[tuple[int, tuple[float, ...]]]]
"""Poses of entities that something else drives, by slot and step: index and ``x_m, y_m, z_m,
heading_rad, pitch_rad, roll_rad, speed_mps``."""


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Where an entity was at a time."""

    time_s: float
    entity: str
    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    """In [0, 2 pi)."""
    speed_mps: float


@dataclass(slots=True)
class PlayedScenario:
    """What happened in one program."""

    program: Program
    rows: list[PoseRow] = field(default_factory=list)
    """Poses after Init and at every n-th step, up to the state in which the storyboard stopped."""
    transitions: list[Transition] = field(default_factory=list)
    overflows: tuple[str, ...] = ()
    steps: int = 0
    finished: bool = False
    """False: it was still running when playing ended."""
    ended_by: str = ""
    """Names of the conditions that stopped it; empty: it is not known."""


def play_programs(
    programs: Sequence[Program],
    roads: RoadTables | None,
    *,
    step_s: float,
    every: int,
    until_s: float,
    device: str = "cpu",
    imposed: Imposed | None = None,
    done: Callable[[int], None] | None = None,
) -> list[PlayedScenario]:
    """Play programs on the same roads, each until its storyboard stops.

    Args:
        programs: what is played.
        roads: on which; None: open ground.
        step_s: the step [s].
        every: poses are kept after Init and then every so many steps.
        until_s: longest time of a storyboard [s].
        device: cpu or cuda:N.
        imposed: poses of entities that something else drives, by number of the program and step.
        done: told how many programs have ended.

    Raises:
        UsageError: a program is larger than a limit.
    """
    played = [PlayedScenario(program) for program in programs]
    slots = min(len(programs), SLOTS_MAX)
    player = StoryboardPlayer(programs, roads, slots, step_s=step_s, device=device)
    waiting = list(range(len(programs)))[::-1]
    active: dict[int, int] = {}
    """Number of the program that a slot plays."""
    ended = 0
    while waiting or active:
        begun = [slot for slot in range(slots) if slot not in active][: len(waiting)]
        for slot in begun:
            active[slot] = waiting.pop()
            player.start(slot, active[slot])
        _keep(player, {slot: played[active[slot]] for slot in begun}, step_s)
        for slot, number in active.items():
            for entity, pose in imposed(number, played[number].steps) if imposed else ():
                player.impose(slot, entity, *pose)
        player.step()
        for slot, number in active.items():
            played[number].finished = not player.running(slot)
            played[number].steps += not played[number].finished
        due = {slot: played[number] for slot, number in active.items()}
        _keep(
            player,
            {k: r for k, r in due.items() if not r.finished and r.steps % every == 0},
            step_s,
        )
        for slot, record in due.items():
            if record.finished or (record.steps + 1) * step_s > until_s + 1e-9:
                record.transitions = player.transitions(slot)
                record.overflows = player.overflows(slot)
                record.ended_by = escape(player.ended_by(slot))
                del active[slot]
                ended += 1
                if done is not None:
                    done(ended)
    return played


def _keep(player: StoryboardPlayer, due: Mapping[int, PlayedScenario], step_s: float) -> None:
    """Keep the poses of all entities that are there, in the slots that are due."""
    if not due:
        return
    states = player.states()
    heading_rad = np.mod(states.heading_rad, 2.0 * np.pi)
    for slot, record in due.items():
        time_s = record.steps * step_s
        for index, entity in enumerate(record.program.entities):
            if not states.visible[slot, index]:
                continue
            values = (states.x_m, states.y_m, states.z_m, heading_rad, states.speed_mps)
            x, y, z, heading, speed = (float(column[slot, index]) for column in values)
            record.rows.append(PoseRow(time_s, entity.name, x, y, z, heading, speed))
