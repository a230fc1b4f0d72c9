"""The player: slots that run storyboard programs in steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from twin.road.tables.road_tables import RoadTables, flat_tables
from twin.road.walk.road_arrays import road_arrays
from twin.scenario.storyboard.interpreter.advance import INIT_PHASE, STORY_PHASE, advance_kernel
from twin.scenario.storyboard.interpreter.arrays import (
    BodyArrays,
    body_arrays,
    play_arrays,
    program_arrays,
)
from twin.scenario.storyboard.interpreter.begin import begin_kernel
from twin.scenario.storyboard.interpreter.decide import decide_kernel, settle_kernel
from twin.scenario.storyboard.interpreter.drivers import drivers_kernel
from twin.scenario.storyboard.interpreter.reset import (
    close_kernel,
    copy_kernel,
    impose_kernel,
    open_kernel,
    reset_kernel,
)
from twin.scenario.storyboard.interpreter.seldom.signals import signals_kernel
from twin.scenario.storyboard.interpreter.seldom.towing import tow_kernel
from twin.scenario.storyboard.interpreter.seldom.watch_lanes import lanes_kernel
from twin.scenario.storyboard.interpreter.watch import watch_kernel
from twin.scenario.storyboard.player.columns import (
    HISTORY_MAX,
    TRANSITIONS_MAX,
    ConditionState,
    Overflow,
    Real,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.kinds import lasts, tows, watches_lanes
from twin.scenario.storyboard.player.tables import pack_programs
from twin.scenario.storyboard.program.conditions import ElementState
from twin.scenario.storyboard.program.program import Program
from twin.world.relaunch import Relaunch

KERNELS = (reset_kernel, begin_kernel, watch_kernel, decide_kernel, advance_kernel, drivers_kernel)
"""One of each module that every storyboard needs."""


@dataclass(frozen=True, slots=True)
class Transition:
    """What became of an element at a step."""

    step: int
    """Its time is that of the state at the beginning of the step, ``step * step_s``."""
    element: int
    state: ElementState
    """One of the transitions."""


@dataclass(frozen=True, slots=True)
class EntityStates:
    """States of all entities, arrays [S, N]; what a slot has less entities is zero."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    heading_rad: np.ndarray
    """In (-pi, pi]."""
    pitch_rad: np.ndarray
    roll_rad: np.ndarray
    speed_mps: np.ndarray
    """Negative: backwards."""
    acceleration_mps2: np.ndarray
    """Forwards."""
    visible: np.ndarray
    """Bits: 1 graphics, 2 sensors, 4 traffic; 0: not there."""
    road: np.ndarray
    """-1: on none."""
    s_m: np.ndarray
    t_m: np.ndarray
    lane: np.ndarray
    """0: on none."""


class StoryboardPlayer:
    """Storyboard programs in slots, each from its own beginning.

    Time is counted in steps: a state after n steps is that at ``n * step_s``. A step reads the
    states at its beginning, starts and stops elements, begins and steps actions, and moves bodies.
    At time 0 the storyboard runs once more, without time, when a slot is started.
    """

    def __init__(
        self,
        programs: Sequence[Program],
        roads: RoadTables | None,
        slots: int,
        *,
        step_s: float = 0.01,
        device: str = "cpu",
    ) -> None:
        """Slots that run nothing yet.

        Args:
            programs: any of which a slot may run.
            roads: on which they run; None: open ground.
            slots: S.
            step_s: the step.
            device: cpu or cuda:N.

        Raises:
            UsageError: a program is larger than a limit.
        """
        self.programs = tuple(programs)
        self.slots = slots
        self.step_s = step_s
        self.device = wp.get_device(device)
        self.tables = pack_programs(self.programs)
        most = self.tables.most
        self.entities = most["entities"]
        """Entities N of the program that has most."""
        self._levels = most["levels"]
        self._widest = max(most[name] for name in _CLEARED)
        self._programs = program_arrays(self.tables, self.device)
        self._roads = road_arrays(roads if roads is not None else flat_tables(), self.device)
        self._play = play_arrays(slots, most, self.device)
        self.bodies: BodyArrays = body_arrays(slots, self.entities, self.device)
        """States on the device, updated in place: columns ``Real`` and ``Whole``."""
        self._before = body_arrays(slots, self.entities, self.device)
        self._graph: Any = None
        self._look_at_programs()

    def _look_at_programs(self) -> None:
        """What a step has to do because of the programs; whenever they have changed."""
        self._again = Relaunch(self.device)
        self._init_lasts = any(lasts(init.action) for p in self.programs for init in p.init)
        self._drivers = any(program.models for program in self.programs)
        self._signals = any(program.controllers for program in self.programs)
        self._lanes = any(watches_lanes(program) for program in self.programs)
        self._tows = any(tows(program) for program in self.programs)

    def start(self, slot: int, program_index: int) -> None:
        """Put a slot at time 0 of a program, after Init and a run of its storyboard."""
        assert 0 <= slot < self.slots
        assert 0 <= program_index < len(self.programs)
        model = [self._programs, self._roads]
        self._launch_once(
            reset_kernel, self._widest, [*model, slot, program_index, self.bodies, self._play]
        )
        self._switch(slot)
        self._launch_once(open_kernel, 1, [self._programs, slot, self.bodies, self._play])
        for level in range(self._levels):
            self._copy()
            self._launch_once(
                begin_kernel,
                (self.slots, self.entities),
                [*model, slot, level, self._before, self.bodies, self._play],
            )
        self._launch_once(close_kernel, self.entities, [slot, self.bodies])
        self._tow(slot, 1, 0.0)
        self._run(slot, 0)

    def step(self) -> None:
        """One step of all slots that run; on a GPU as one graph, which is made at the first."""
        if self._graph is None and self.device.is_cuda:
            self._run(_ALL, 1)  # loads the kernels
            with wp.ScopedCapture(self.device) as capture:
                self._run(_ALL, 1)
            self._graph = capture.graph
        elif self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._run(_ALL, 1)

    def _run(self, only: int, steps: int) -> None:
        """The storyboard and all bodies; at its beginning a slot runs once without time."""
        model = [self._programs, self._roads]
        everyone = (self.slots, self.entities)
        step_s = self.step_s * steps
        conditions = (self.slots, self.tables.most["conditions"])
        self._switch(only)
        self._launch(watch_kernel, conditions, [*model, only, self.step_s, self.bodies, self._play])
        if self._lanes:
            self._launch(lanes_kernel, conditions, [*model, only, self.bodies, self._play])
        storyboard = [self._programs, only, self.step_s, self.bodies, self._play]
        self._launch(decide_kernel, self.slots, storyboard)
        self._copy()
        self._launch(
            begin_kernel, everyone, [*model, only, _ALL, self._before, self.bodies, self._play]
        )
        # When a slot begins, actions of Init are all stepped once.
        init = steps == 0 or self._init_lasts
        for phase in (INIT_PHASE, STORY_PHASE) if init else (STORY_PHASE,):
            self._copy()
            if phase == STORY_PHASE and self._drivers:
                self._launch(
                    drivers_kernel,
                    everyone,
                    [*model, only, step_s, self._before, self._play, self.bodies],
                )
            self._launch(
                advance_kernel,
                everyone,
                [*model, only, phase, step_s, self._before, self.bodies, self._play],
            )
        self._tow(only, 0, step_s)
        self._launch(settle_kernel, self.slots, [self._programs, only, steps, self._play])

    def _switch(self, only: int) -> None:
        """Phases of traffic signals that begin now."""
        if self._signals:
            told = [self._programs, only, self.step_s, self._play]
            self._launch(signals_kernel, self.slots, told)

    def _tow(self, only: int, opening: int, step_s: float) -> None:
        """Trailers, after their tractors have moved."""
        if self._tows:
            told = [only, opening, step_s, self._play, self.bodies]
            self._launch(tow_kernel, self.slots, [self._programs, self._roads, *told])

    def running(self, slot: int) -> bool:
        """True until a slot's storyboard has stopped."""
        return bool(self._slot(slot)[SlotColumn.RUNNING])

    def steps(self, slot: int) -> int:
        """How many steps a slot has made since it was started."""
        return int(self._slot(slot)[SlotColumn.STEP])

    def states(self) -> EntityStates:
        """The states of all entities, copied from the device."""
        reals, wholes = np.array(self.bodies.reals.numpy()), np.array(self.bodies.wholes.numpy())
        return EntityStates(
            x_m=reals[:, :, Real.X],
            y_m=reals[:, :, Real.Y],
            z_m=reals[:, :, Real.Z],
            heading_rad=reals[:, :, Real.HEADING],
            pitch_rad=reals[:, :, Real.PITCH],
            roll_rad=reals[:, :, Real.ROLL],
            speed_mps=reals[:, :, Real.SPEED],
            acceleration_mps2=reals[:, :, Real.ACCELERATION],
            visible=wholes[:, :, Whole.VISIBLE],
            road=wholes[:, :, Whole.ROAD],
            s_m=reals[:, :, Real.S],
            t_m=reals[:, :, Real.T],
            lane=wholes[:, :, Whole.LANE],
        )

    def transitions(self, slot: int) -> list[Transition]:
        """Transitions of a slot's elements since it was started, in their order."""
        count = min(int(self._slot(slot)[SlotColumn.TRANSITIONS]), TRANSITIONS_MAX)
        rows = self._play.transitions[slot].numpy()[:count].tolist()
        return [Transition(step, element, ElementState(state)) for step, element, state in rows]

    def ended_by(self, slot: int) -> str:
        """Names of the conditions that stopped a slot's storyboard; empty: it runs, or has none."""
        program = self.programs[int(self._slot(slot)[SlotColumn.PROGRAM])]
        trigger = program.elements[0].stop
        if self.running(slot) or trigger is None:
            return ""
        states = self._play.conditions[slot].numpy()
        held = states[:, ConditionState.HELD] == 1
        # What counted with a delay may be over again.
        was = states[:, ConditionState.CHANGES] > 0
        first = 0  # the storyboard's conditions are the first of a program
        for group in trigger.groups:
            rows = range(first, first + len(group))
            if all(held[k] or (one.delay_s and was[k]) for k, one in zip(rows, group, strict=True)):
                return " and ".join(
                    f"{one.name} (+{one.delay_s:g} s)" if one.delay_s else one.name for one in group
                )
            first += len(group)
        return ""

    def overflows(self, slot: int) -> tuple[str, ...]:
        """Limits that a slot has met since it was started, each in words."""
        bits = int(self._slot(slot)[SlotColumn.OVERFLOW])
        return tuple(words for bit, words in _OVERFLOWS.items() if bits & bit)

    def variables(self, slot: int) -> dict[str, float]:
        """Values of a slot's variables by name."""
        program = self.programs[int(self._slot(slot)[SlotColumn.PROGRAM])]
        values = self._play.variables[slot].numpy().tolist()
        return {
            variable.name: value for variable, value in zip(program.variables, values, strict=False)
        }

    def impose(
        self,
        slot: int,
        entity: int,
        x_m: float,
        y_m: float,
        z_m: float,
        heading_rad: float,
        pitch_rad: float,
        roll_rad: float,
        speed_mps: float,
    ) -> None:
        """Say where an entity is that something else drives; its place on the road follows.

        It keeps this pose until the next call, and actions that would move it do nothing.
        """
        pose = np.array([x_m, y_m, z_m, heading_rad, pitch_rad, roll_rad, speed_mps])
        told: wp.array[Any] = wp.array(pose, dtype=wp.float64, device=self.device)
        self._launch_once(impose_kernel, 1, [self._roads, slot, entity, told, self.bodies])

    def _slot(self, slot: int) -> np.ndarray:
        row: np.ndarray = self._play.slots[slot].numpy()
        return row

    def _copy(self) -> None:
        self._launch(copy_kernel, (self.slots, self.entities), [self.bodies, self._before])

    def _launch(self, kernel: wp.Kernel, dim: int | tuple[int, int], inputs: list[object]) -> None:
        """Launch what a step launches: always the same, ten times in 10 ms of sim time."""
        if self.device.is_cuda:  # once, into the graph
            self._launch_once(kernel, dim, inputs)
        else:
            self._again(kernel, dim, inputs, [], _BLOCK)

    def _launch_once(
        self, kernel: wp.Kernel, dim: int | tuple[int, int], inputs: list[object]
    ) -> None:
        wp.launch(kernel, dim=dim, inputs=inputs, device=self.device, block_dim=_BLOCK)


_ALL = -1
_BLOCK = 8
"""Threads of a block: they go different ways and wait for memory, so a GPU's processors should have
few each."""
_CLEARED = ("entities", "elements", "conditions", "instances", "variables", "controllers")
_OVERFLOWS = {
    int(Overflow.TRANSITIONS): (
        f"transitions: the first {TRANSITIONS_MAX} are remembered (TRANSITIONS_MAX)"
    ),
    int(Overflow.HISTORY): (
        f"a delayed condition changed more than {HISTORY_MAX} times within its delay (HISTORY_MAX)"
    ),
}
