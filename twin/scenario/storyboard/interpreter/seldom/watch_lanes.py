"""The kernel that looks at free lanes; apart, as few programs ask and its code is large."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.seldom.clearance import clear_beside
from twin.scenario.storyboard.interpreter.watch import keep_truth
from twin.scenario.storyboard.player.columns import (
    ConditionColumn,
    ProgramColumn,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.kinds import kind_code
from twin.scenario.storyboard.program.conditions import ElementState, RelativeClearanceCondition

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_CLEARANCE = kind_code(RelativeClearanceCondition)


@wp.kernel
def lanes_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    # state in
    bodies: BodyArrays,
    # state in and out
    play: PlayArrays,
):
    """Whether lanes are free of whom they must be, one thread per slot and condition; otherwise as
    :func:`twin.scenario.storyboard.interpreter.watch.watch_kernel`."""
    slot, c = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    if c >= tables.programs[program, ProgramColumn.CONDITIONS]:
        return
    row = tables.programs[program, ProgramColumn.CONDITION] + c
    owner = tables.conditions[row, ConditionColumn.OWNER]
    if tables.conditions[row, ConditionColumn.KIND] != _CLEARANCE:
        return
    if play.element_states[slot, owner] == ElementState.COMPLETE:
        return
    base = tables.programs[program, ProgramColumn.ENTITY]
    count = tables.programs[program, ProgramColumn.ENTITIES]
    reals = tables.conditions[row, ConditionColumn.REALS]
    wholes = tables.conditions[row, ConditionColumn.WHOLES]
    first = tables.conditions[row, ConditionColumn.ENTITY]
    held = wp.int32(0)
    present = wp.int32(0)
    causes = wp.int64(0)
    for k in range(tables.conditions[row, ConditionColumn.ENTITIES]):
        e = tables.wholes[first + k]
        if bodies.wholes[slot, e, Whole.PRESENT] != 0:
            present += 1
            if clear_beside(tables, bodies, roads, slot, base, count, e, reals, wholes):
                held += 1
                causes = causes | (wp.int64(1) << wp.int64(e))
    every = tables.conditions[row, ConditionColumn.ALL] != 0
    keep_truth(play, slot, c, held, present, every, causes)
