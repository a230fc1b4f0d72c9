"""Kernels of the storyboard: what starts and stops at a step, and what has come to its end."""

from __future__ import annotations

import warp as wp

from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.elements import (
    IDLE,
    action_over,
    element_at,
    start,
    stop_element,
)
from twin.scenario.storyboard.interpreter.triggers import fires
from twin.scenario.storyboard.player.columns import (
    ElementColumn,
    InstanceColumn,
    InstanceState,
    ProgramColumn,
    SlotColumn,
)
from twin.scenario.storyboard.program.conditions import ElementState

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_IDLE = wp.constant(wp.int32(IDLE))


@wp.kernel
def decide_kernel(
    # model
    tables: ProgramArrays,
    # args
    only: wp.int32,
    step_s: wp.float64,
    # state in and out
    bodies: BodyArrays,
    play: PlayArrays,
):
    """Triggers of all elements in their order, on the states at the beginning of the step.

    A stop trigger counts before a start trigger, and a parent before its children, so what starts
    in a step lets its children start in the same one. An element waits only while its parent runs,
    so those with triggers need not be looked for. ``only`` -1: all slots.
    """
    slot = wp.tid()
    if only >= 0 and slot != only:
        return
    if play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    step = play.slots[slot, SlotColumn.STEP]
    starting = play.element_states[slot, 0] == _IDLE
    first = tables.programs[program, ProgramColumn.VISIT]
    end = first + tables.programs[program, ProgramColumn.VISIT_COUNT]
    for at in range(first, end):
        e = tables.visits[at]
        begins = wp.bool(starting and e == 0)
        causes = wp.int64(0)
        # One call site for each of the large functions.
        for turn in range(2):
            state = play.element_states[slot, e]
            asks = wp.int32(-1)
            if turn == 0:
                if state == ElementState.RUNNING:
                    asks = element_at(tables, program, e, ElementColumn.STOP)
            elif state == ElementState.STANDBY:
                asks = element_at(tables, program, e, ElementColumn.START)
                begins = asks < 0
            if asks >= 0:
                firing = fires(tables, play, slot, program, asks, step, step_s)
                if firing.fired != 0:
                    if turn == 0:
                        stop_element(tables, play, slot, program, e)
                    else:
                        begins = True
                        causes = firing.causes
                elif turn == 1:
                    play.element_skips[slot, e] = 0
        if begins:
            start(tables, play, bodies, slot, program, e, causes)
    if play.element_states[slot, 0] != ElementState.RUNNING:
        play.slots[slot, SlotColumn.RUNNING] = 0


@wp.kernel
def settle_kernel(
    # model
    tables: ProgramArrays,
    # args
    only: wp.int32,
    advance: wp.int32,
    # state in and out
    play: PlayArrays,
):
    """Ends of actions, in the order of the storyboard; then the step is over.

    ``advance``: how many steps the clock goes on, 0 at the run at time 0 that begins a slot.
    """
    slot = wp.tid()
    if only >= 0 and slot != only:
        return
    if play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    base = tables.programs[program, ProgramColumn.INSTANCE]
    for k in range(tables.programs[program, ProgramColumn.INSTANCES]):
        if play.instance_states[slot, k] == InstanceState.FINISHED:
            play.instance_states[slot, k] = wp.int32(InstanceState.DONE)
            element = tables.instances[base + k, InstanceColumn.ELEMENT]
            action_over(tables, play, slot, program, element)
    play.slots[slot, SlotColumn.STEP] = play.slots[slot, SlotColumn.STEP] + advance
