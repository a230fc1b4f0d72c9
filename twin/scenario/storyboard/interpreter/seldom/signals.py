"""Controllers of traffic signals: which phase they are in (ASAM OpenSCENARIO XML 1.3, 6.11).

Phases follow one another by their durations, the first after the last. A phase that begins gives
its signals their states; what actions set them to in the meantime stays until the next phase.
Controller B with a delay behind A is in its first phase a delay after A is: with the same length of
the cycle B is, at any time, where A was a delay ago, also at time 0 ("virtually" in the standard).
An action that puts a controller into a phase moves its cycle and no other's.
"""

from __future__ import annotations

import warp as wp

from twin.scenario.storyboard.interpreter.arrays import PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.transition import CLOSE, FAR
from twin.scenario.storyboard.player.columns import ControllerColumn, ProgramColumn, SlotColumn

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.func
def show_phase(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    controller: wp.int32,
    phase: wp.int32,
):
    """Give the signals of a phase their states, and the controller's variable its name."""
    row = tables.programs[program, ProgramColumn.CONTROLLER] + controller
    at = tables.controllers[row, ControllerColumn.PHASE] + phase
    play.phases[slot, controller] = phase
    play.variables[slot, tables.controllers[row, ControllerColumn.VARIABLE]] = tables.phase_ends[
        at, 0
    ]
    first = tables.phases[at, 0]
    for signal in range(first, first + tables.phases[at, 1]):
        play.variables[slot, tables.signals[signal, 0]] = tables.shown[signal, 0]


@wp.func
def put_into_phase(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    controller: wp.int32,
    phase: wp.int32,
):
    """Begin a phase now; the others follow it."""
    row = tables.programs[program, ProgramColumn.CONTROLLER] + controller
    first = tables.controllers[row, ControllerColumn.PHASE]
    way = wp.float64(0.0)
    if phase > 0:
        way = tables.phase_ends[first + phase - 1, 1]
    play.phase_steps[slot, controller] = play.slots[slot, SlotColumn.STEP]
    play.phase_ways[slot, controller] = way
    show_phase(tables, play, slot, program, controller, phase)


@wp.func
def phase_at(tables: ProgramArrays, row: wp.int32, way: wp.float64) -> wp.int32:
    """The phase of a controller so long after its cycle began; -1: before one that never ends."""
    first = tables.controllers[row, ControllerColumn.PHASE]
    count = tables.controllers[row, ControllerColumn.PHASES]
    cycle = tables.delays[row, 1]
    at = wp.float64(way)
    if cycle < FAR:
        at = way - wp.floor((way + CLOSE) / cycle) * cycle
    elif way < -CLOSE:
        return -1
    for phase in range(count):
        if at < tables.phase_ends[first + phase, 1] - CLOSE:
            return phase
    return count - 1


@wp.kernel
def signals_kernel(
    # model
    tables: ProgramArrays,
    # args
    only: wp.int32,
    step_s: wp.float64,
    # state in and out
    play: PlayArrays,
):
    """Phases that begin at this step, one thread per slot; ``only`` -1: all slots."""
    slot = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    first = tables.programs[program, ProgramColumn.CONTROLLER]
    for controller in range(tables.programs[program, ProgramColumn.CONTROLLERS]):
        steps = play.slots[slot, SlotColumn.STEP] - play.phase_steps[slot, controller]
        way = wp.float64(steps) * step_s + play.phase_ways[slot, controller]
        phase = phase_at(tables, first + controller, way)
        if phase >= 0 and phase != play.phases[slot, controller]:
            show_phase(tables, play, slot, program, controller, phase)
