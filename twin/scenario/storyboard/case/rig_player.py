"""A player whose slots take programs one by one, while others run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from twin.road.tables.road_tables import RoadTables
from twin.scenario.storyboard.case.impose import impose_egos_kernel
from twin.scenario.storyboard.interpreter.arrays import (
    BodyArrays,
    PlayArrays,
    body_arrays,
    play_arrays,
    program_arrays,
)
from twin.scenario.storyboard.player.columns import TRANSITIONS_MAX, SlotColumn, Whole
from twin.scenario.storyboard.player.joining import join_tables
from twin.scenario.storyboard.player.storyboard_player import KERNELS, StoryboardPlayer
from twin.scenario.storyboard.player.tables import pack_programs
from twin.scenario.storyboard.program.conditions import ElementState
from twin.scenario.storyboard.program.program import Program
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import put_row, row_of


@dataclass(frozen=True, slots=True)
class SlotsNow:
    """What the slots of a player are at, arrays [S]."""

    running: np.ndarray
    """bool: the storyboard has not ended, held or not."""
    transitions: np.ndarray
    """How many there were."""
    steps: np.ndarray
    """How many there were."""
    full: np.ndarray
    """bool: a limit was met, :meth:`RigPlayer.overflows` says which."""


class RigPlayer(StoryboardPlayer):
    """Slots of a rig: a program that no slot runs gives its place to the next new one.

    A slot's bytes are those it has alone: tables only grow, and a slot reads its own rows.
    """

    def __init__(
        self, program: Program, roads: RoadTables | None, slots: int, step_s: float, device: str
    ) -> None:
        """``program``: any that a slot may run."""
        super().__init__([program], roads, slots, step_s=step_s, device=device)
        self._parts = [self.tables]
        """The tables of each program alone."""
        self._sizes = dict(self.tables.most)
        self._run_by: list[int] = [-1] * slots
        """Program of each slot; -1: none."""
        self._held = np.zeros(slots, np.int32)
        """What RUNNING was when a slot was held; -1: it is not held."""
        self._held[...] = -1
        self._egos = np.full(slots, -1, np.int32)

    def prepare(self, ego: int) -> None:
        """Have all kernels compiled before the first case; ``ego``: entity of the program."""
        load_kernels(self.device, [*KERNELS, impose_egos_kernel])
        self.begin(0, self.programs[0], ego)
        self.impose_egos(np.zeros((self.slots, 7)), np.zeros(self.slots, np.bool_))
        self.step()
        self.end(0)

    def begin(self, slot: int, program: Program, ego: int) -> None:
        """Put a slot at time 0 of a program, whose entity ``ego`` others drive from then on.

        Raises:
            UsageError: the program is larger than a limit.
        """
        self.end(slot)
        index = self._place(program)
        self._run_by[slot], self._egos[slot] = index, ego
        self.start(slot, index)

    def end(self, slot: int) -> None:
        """Nothing runs in a slot any more."""
        self._run_by[slot], self._egos[slot], self._held[slot] = -1, -1, -1
        self._set_running(slot, 0)

    def hold(self, slot: int, *, held: bool) -> None:
        """A slot stands still, or goes on."""
        if held == (self._held[slot] >= 0):
            return
        if held:
            self._held[slot] = self._play.slots.numpy()[slot, SlotColumn.RUNNING]
            self._set_running(slot, 0)
        else:
            self._set_running(slot, int(self._held[slot]))
            self._held[slot] = -1

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """What the program of a slot has come to, copied."""
        return {f"{struct}.{name}": row_of(array, slot) for struct, name, array in self._arrays()}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with that, in a slot in which the same program has just begun. Tables may have
        room for other programs, and the program another index."""
        for struct, name, array in self._arrays():
            row, values = row_of(array, slot), saved[f"{struct}.{name}"]
            both = tuple(slice(min(sizes)) for sizes in zip(row.shape, values.shape, strict=True))
            index = row[0, SlotColumn.PROGRAM] if name == "slots" else 0
            row[both] = values[both]
            if name == "slots":
                row[0, SlotColumn.PROGRAM] = index
            put_row(array, slot, row)

    def _arrays(self) -> Iterator[tuple[str, str, Any]]:
        """Everything that changes while a slot runs."""
        for struct, values in ((PlayArrays, self._play), (BodyArrays, self.bodies)):
            for name in struct.__annotations__:
                yield struct.__name__, name, getattr(values, name)

    def impose_egos(self, poses: np.ndarray, led: np.ndarray) -> None:
        """Say where the egos of all slots are: x, y, z [m], heading, pitch, roll [rad] and speed
        [m/s] of each, [S, 7]; of slots that are held they count for nothing, nor of those that the
        storyboard itself leads, ``led`` bool [S]."""
        egos = np.where((self._held < 0) & ~led, self._egos, -1).astype(np.int32)
        if not (egos >= 0).any():
            return
        inputs: list[Any] = [
            self._roads,
            wp.array(egos, dtype=wp.int32, device=self.device),
            wp.array(poses, dtype=wp.float64, device=self.device),
            self.bodies,
        ]
        wp.launch(impose_egos_kernel, dim=self.slots, inputs=inputs, device=self.device)

    def jump(self, slot: int, entity: int) -> None:
        """An entity was put somewhere: the way to there is none that it drove."""
        self._set_whole(slot, entity, Whole.JUMPED, 1)

    def release(self, slot: int, entity: int) -> None:
        """Nothing else says any more where an entity is: it goes on from there as its program
        says."""
        self._set_whole(slot, entity, Whole.IMPOSED, 0)

    def _set_whole(self, slot: int, entity: int, column: Whole, value: int) -> None:
        rows = self.bodies.wholes.numpy().copy()
        rows[slot, entity, column] = value
        self.bodies.wholes.assign(rows)

    def now(self) -> SlotsNow:
        """What the slots are at."""
        slots = self._play.slots.numpy()
        running = np.where(self._held >= 0, self._held, slots[:, SlotColumn.RUNNING]) != 0
        return SlotsNow(
            running,
            slots[:, SlotColumn.TRANSITIONS].copy(),
            slots[:, SlotColumn.STEP].copy(),
            slots[:, SlotColumn.OVERFLOW] != 0,
        )

    def values_of(self, slot: int) -> np.ndarray:
        """Values of the variables of a slot's program, a view [V]."""
        values: np.ndarray = self._play.variables.numpy()[slot]
        return values

    def begun(self, slot: int, first: int) -> list[tuple[int, int]]:
        """Step and element of the starts in a slot from transition ``first`` on."""
        rows = self._play.transitions[slot].numpy()[:TRANSITIONS_MAX]
        count = int(self._play.slots.numpy()[slot, SlotColumn.TRANSITIONS])
        started = int(ElementState.START_TRANSITION)
        return [
            (step, element) for step, element, state in rows[first:count].tolist()
            if state == started
        ]  # fmt: skip

    def _set_running(self, slot: int, value: int) -> None:
        rows = self._play.slots.numpy().copy()
        if rows[slot, SlotColumn.RUNNING] != value:
            rows[slot, SlotColumn.RUNNING] = value
            self._play.slots.assign(rows)

    def _place(self, program: Program) -> int:
        """Index of a program, which is put among those that are known."""
        for index, known in enumerate(self.programs):
            if known is program:
                return index
        free = (index for index in range(len(self.programs)) if index not in self._run_by)
        index = next(free, len(self.programs))
        programs = [*self.programs]
        programs[index : index + 1] = [program]
        parts = [*self._parts]
        parts[index : index + 1] = [pack_programs([program])]
        tables = join_tables(parts)
        self.programs, self.tables, self._parts = tuple(programs), tables, parts
        self._programs = program_arrays(tables, self.device)
        self._look_at_programs()
        self._graph = None  # the one that was recorded has the arrays of before
        sizes = {name: max(size, tables.most[name]) for name, size in self._sizes.items()}
        if sizes != self._sizes:
            self._grow(sizes)
        return index

    def _grow(self, sizes: dict[str, int]) -> None:
        """Make room for a larger program; what slots hold stays."""
        play, bodies = self._play, self.bodies
        self._sizes, self.entities = sizes, sizes["entities"]
        self._levels = sizes["levels"]
        self._widest = max(sizes[name] for name in _WIDE)
        self._play = play_arrays(self.slots, sizes, self.device)
        self.bodies = body_arrays(self.slots, self.entities, self.device)
        self._before = body_arrays(self.slots, self.entities, self.device)
        for struct, old, new in (
            (PlayArrays, play, self._play),
            (BodyArrays, bodies, self.bodies),
        ):
            for name in struct.__annotations__:
                _copy_into(getattr(old, name), getattr(new, name))


_WIDE = ("entities", "elements", "conditions", "instances", "variables", "controllers")


def _copy_into(old: Any, new: Any) -> None:
    values = new.numpy().copy()
    values[tuple(slice(size) for size in old.shape)] = old.numpy()
    new.assign(values)
