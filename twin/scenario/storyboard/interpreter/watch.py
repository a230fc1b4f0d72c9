"""The kernel that looks at entities for all conditions at once, before the storyboard decides."""

from __future__ import annotations

import warp as wp

from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.expressions import entity_holds
from twin.scenario.storyboard.interpreter.triggers import FIRST_VALUE_KIND
from twin.scenario.storyboard.player.columns import (
    ConditionColumn,
    ConditionState,
    ProgramColumn,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.kinds import kind_code
from twin.scenario.storyboard.program.conditions import ElementState, RelativeClearanceCondition

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_CLEARANCE = kind_code(RelativeClearanceCondition)


@wp.func
def keep_truth(
    play: PlayArrays,
    slot: wp.int32,
    c: wp.int32,
    held: wp.int32,
    present: wp.int32,
    every: wp.bool,
    causes: wp.int64,
):
    """Store whether an expression holds that ``held`` of the entities that are there fulfil."""
    truth = wp.where(held > 0, 1, 0)
    if every and held < present:
        truth = 0
    play.conditions[slot, c, ConditionState.TRUTH] = truth
    play.condition_causes[slot, c] = causes


@wp.kernel
def watch_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    step_s: wp.float64,
    # state in
    bodies: BodyArrays,
    # state in and out
    play: PlayArrays,
):
    """Whether expressions on entities hold, one thread per slot and condition.

    Conditions of elements that are complete are left out; those of others may matter, even if
    their element has yet to start in this step. Entities that are not there fulfil nothing and
    keep nobody else from it.
    """
    slot, c = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    if c >= tables.programs[program, ProgramColumn.CONDITIONS]:
        return
    row = tables.programs[program, ProgramColumn.CONDITION] + c
    kind = tables.conditions[row, ConditionColumn.KIND]
    owner = tables.conditions[row, ConditionColumn.OWNER]
    if kind >= FIRST_VALUE_KIND or play.element_states[slot, owner] == ElementState.COMPLETE:
        return
    if kind == _CLEARANCE:
        return  # a kernel of its own looks at free lanes
    base = tables.programs[program, ProgramColumn.ENTITY]
    count = tables.programs[program, ProgramColumn.ENTITIES]
    reals = tables.conditions[row, ConditionColumn.REALS]
    wholes = tables.conditions[row, ConditionColumn.WHOLES]
    first = tables.conditions[row, ConditionColumn.ENTITY]
    entities = tables.conditions[row, ConditionColumn.ENTITIES]
    step = play.slots[slot, SlotColumn.STEP]
    held = wp.int32(0)
    absent = wp.int32(0)
    causes = wp.int64(0)
    for k in range(entities):
        e = tables.wholes[first + k]
        if bodies.wholes[slot, e, Whole.PRESENT] == 0:
            absent += 1
        elif entity_holds(
            tables, bodies, roads, slot, base, count, e, kind, reals, wholes, step, step_s
        ):
            held += 1
            causes = causes | (wp.int64(1) << wp.int64(e))
    every = tables.conditions[row, ConditionColumn.ALL] != 0
    keep_truth(play, slot, c, held, entities - absent, every, causes)
