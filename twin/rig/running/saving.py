"""A slot saved between two ticks, to go on in another one, perhaps elsewhere and as a fork."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np
from msgspec import UNSET

from schemas.case import Case
from schemas.identity import rig_key
from schemas.messages import Command, Lights
from schemas.sections.fork import Fork
from twin.rig.command_delay import Delays
from twin.rig.running.case_run import CaseRun
from twin.scenario.protocol import ScenarioRun

Saved = dict[str, Any]
"""Copies on the host: arrays, numbers, and what is made of them."""


class Keeps(Protocol):
    """A part of an engine that remembers something of a slot."""

    def save(self, slot: int) -> Saved:
        """What it remembers of an active slot, copied.

        Raises:
            ValueError: it cannot; one line.
        """

    def restore(self, slot: int, saved: Saved) -> None:
        """Remember that, in a slot in which the same case has just begun."""


@dataclass(frozen=True, slots=True)
class SavedSlot:
    """A case between two ticks."""

    case: Case
    tick: int
    """The one that comes next."""
    sim_time_ns: int
    parts: Mapping[str, Saved]
    scenario: ScenarioRun
    pending: deque[tuple[int, Command]]
    delays: Delays
    lights: Lights
    carried: bool


class Begins(Protocol):
    """An engine, as far as it begins cases."""

    active: np.ndarray
    tick: np.ndarray
    sim_time_ns: np.ndarray
    refill_every: int

    @property
    def state(self) -> np.ndarray: ...

    def reset(self, slot: int, case: Case) -> None: ...

    def apply_environment(self, slot: int) -> None: ...


class SlotSaver:
    """Saves slots of an engine and restores them; between :meth:`Engine.step` and ``sense``."""

    def __init__(
        self, engine: Begins, runs: list[CaseRun | None], parts: Mapping[str, Keeps]
    ) -> None:
        """``parts``: all that remembers something, rows before forks."""
        self._engine, self._runs, self._parts = engine, runs, parts

    def save(self, slot: int) -> SavedSlot:
        """The case of a slot as it is.

        Raises:
            ValueError: a part of it cannot be saved; one line.
        """
        run = self._runs[slot]
        assert run is not None, f"slot {slot} has no case"
        assert self._engine.active[slot], f"slot {slot} is held"
        _ = self._engine.state  # measured, if it has just been placed
        return SavedSlot(
            case=run.case,
            tick=int(self._engine.tick[slot]),
            sim_time_ns=int(self._engine.sim_time_ns[slot]),
            parts={name: part.save(slot) for name, part in self._parts.items()},
            scenario=_copied(run.scenario, run),
            pending=deque(run.pending),
            delays=copy.deepcopy(run.delays),
            lights=run.lights,
            carried=run.carried,
        )

    def restore(self, slot: int, saved: SavedSlot, case: Case | None = None) -> None:
        """Go on with a saved case, whose bytes are from there on those it had in its own slot.

        Args:
            slot: an empty one; those that are active must be due for their sensors with it.
            saved: of the same rig.
            case: a fork of the saved case that goes its own way later; None: the case itself.

        Raises:
            ValueError: it is no such fork, or of another rig; one line.
        """
        engine, case = self._engine, case or saved.case
        if mistake := _no_fork(case, saved):
            raise ValueError(f"case {case.id}: {mistake}")
        phase = engine.tick[engine.active] % engine.refill_every
        assert (phase == saved.tick % engine.refill_every).all(), "not due for sensors together"
        engine.reset(slot, case)
        _ = engine.state  # what a start is measured with is overwritten below
        engine.tick[slot], engine.sim_time_ns[slot] = saved.tick, saved.sim_time_ns
        for name, part in self._parts.items():
            part.restore(slot, saved.parts[name])
        engine.apply_environment(slot)
        run = self._runs[slot]
        assert run is not None
        run.scenario = _copied(saved.scenario, run)
        run.pending, run.delays = deque(saved.pending), copy.deepcopy(saved.delays)
        run.lights, run.carried = saved.lights, saved.carried


def names_of(case: Case) -> list[Fork]:
    """Whose random numbers a case has, in order; without forks, its own."""
    forks = case.variation.forks
    return [Fork(case=case.id)] if forks is UNSET else forks


def _no_fork(case: Case, saved: SavedSlot) -> str:
    """Why a case does not go on from a saved one, or nothing."""
    if rig_key(case) != rig_key(saved.case):
        return f"is of another rig than {saved.case.id}"
    plain = [
        msgspec.structs.replace(one.variation, id="", forks=UNSET) for one in (case, saved.case)
    ]
    before, after = names_of(saved.case), names_of(case)
    if plain[0] != plain[1] or after[: len(before)] != before:
        return f"is no fork of {saved.case.id}"
    if any(_moment(fork, saved) < saved.tick for fork in after[len(before) :]):
        return f"forks from {saved.case.id} before tick {saved.tick}"
    return ""


def _moment(fork: Fork, saved: SavedSlot) -> int:
    """Tick at which a saved case would have forked; if it has not so far, the next one."""
    if not fork.column:
        return fork.tick
    rows = saved.parts["rows"]
    values = rows["values"][fork.column]
    valid = rows["valid"].get(fork.column, np.ones(len(values), np.bool_))
    passed = [fork.margin_of(float(value)) < fork.margin for value in values] & valid
    first = int(np.argmax(passed)) if passed.any() else len(values)
    return max(fork.tick, first + 1)


def _copied(scenario: ScenarioRun, run: CaseRun) -> ScenarioRun:
    """A copy of what a family remembers; what it looks at is that of ``run``."""
    shared = {id(thing): thing for thing in (run.ground, run.ground.lane)}
    return copy.deepcopy(scenario, shared)
