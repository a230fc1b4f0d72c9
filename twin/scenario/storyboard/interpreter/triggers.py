"""Warp functions: when triggers fire.

ASAM OpenSCENARIO XML 1.3, section 7.6.2: a condition is its expression, or a change of it since the
last step, as it was a delay ago. It counts only while its trigger can fire.
"""

from __future__ import annotations

import warp as wp

from twin.scenario.storyboard.interpreter.arrays import PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.measures import UNDEFINED, compared
from twin.scenario.storyboard.interpreter.transition import CLOSE
from twin.scenario.storyboard.player.columns import (
    HISTORY_MAX,
    ConditionColumn,
    ConditionState,
    Overflow,
    ProgramColumn,
    SlotColumn,
)
from twin.scenario.storyboard.player.kinds import kind_code
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import conditions as records
from twin.scenario.storyboard.program.conditions import ComparisonRule, ConditionEdge

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

FIRST_VALUE_KIND = kind_code(records.SimulationTimeCondition)
"""Conditions of smaller kinds are about entities."""
_TIME = FIRST_VALUE_KIND
_TIME_OF_DAY = kind_code(records.TimeOfDayCondition)
_VARIABLE = kind_code(records.VariableCondition)
_SIGNAL = kind_code(records.TrafficSignalCondition)
_ELEMENT_STATE = whole_column(records.ElementStateCondition, "state")
_VARIABLE_INDEX = whole_column(records.VariableCondition, "variable")
_VARIABLE_RULE = whole_column(records.VariableCondition, "rule")
_SIGNAL_INDEX = whole_column(records.TrafficSignalCondition, "variable")
_TIME_RULE = whole_column(records.SimulationTimeCondition, "rule")
_DAY_RULE = whole_column(records.TimeOfDayCondition, "rule")
_HISTORY_MAX = wp.constant(wp.int32(HISTORY_MAX))

assert real_column(records.SimulationTimeCondition, "value_s") == 0
assert real_column(records.TimeOfDayCondition, "value_s") == 0
assert real_column(records.VariableCondition, "value") == 0
assert real_column(records.TrafficSignalCondition, "value") == 0


@wp.func
def time_of_day(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
) -> wp.float64:
    """The environment's clock [s since 1970]; it runs with the scenario's time."""
    environment = play.slots[slot, SlotColumn.ENVIRONMENT]
    if environment < 0:
        return UNDEFINED
    since = wp.float64(step - play.slots[slot, SlotColumn.ENVIRONMENT_STEP]) * step_s
    clock = tables.programs[program, ProgramColumn.ENVIRONMENT] + environment
    return tables.clocks[clock] + since


@wp.func
def value_holds(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    c: wp.int32,
    kind: wp.int32,
    reals: wp.int32,
    wholes: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
) -> wp.bool:
    """True if an expression without entities holds."""
    first = tables.reals[reals]
    if kind == _TIME:
        return compared(tables.wholes[wholes + _TIME_RULE], wp.float64(step) * step_s, first)
    if kind == _TIME_OF_DAY:
        clock = time_of_day(tables, play, slot, program, step, step_s)
        if clock == UNDEFINED:
            return False
        return compared(tables.wholes[wholes + _DAY_RULE], clock, first)
    if kind == _VARIABLE:
        variable = play.variables[slot, tables.wholes[wholes + _VARIABLE_INDEX]]
        return compared(tables.wholes[wholes + _VARIABLE_RULE], variable, first)
    if kind == _SIGNAL:
        variable = play.variables[slot, tables.wholes[wholes + _SIGNAL_INDEX]]
        return compared(ComparisonRule.EQUAL, variable, first)
    state = tables.wholes[wholes + _ELEMENT_STATE]
    seen = play.conditions[slot, c, ConditionState.SEEN]
    play.conditions[slot, c, ConditionState.SEEN] = 0
    if seen != 0:
        return (seen >> state) & 1 != 0
    return play.conditions[slot, c, ConditionState.LATEST] == state


@wp.func
def delayed(
    play: PlayArrays,
    slot: wp.int32,
    c: wp.int32,
    ring: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
    delay_s: wp.float64,
) -> wp.bool:
    """A condition's value as it was a delay ago; false before it was first evaluated."""
    changes = play.conditions[slot, c, ConditionState.CHANGES]
    held = play.conditions[slot, c, ConditionState.HELD]
    time_s = wp.float64(step) * step_s - delay_s
    for back in range(_HISTORY_MAX):
        if back < changes:
            at = play.histories[slot, ring, (changes - 1 - back) % _HISTORY_MAX]
            if wp.float64(at) * step_s < time_s + CLOSE:
                return (held + back) % 2 == 1
    return False


@wp.func
def held_value(
    play: PlayArrays,
    slot: wp.int32,
    c: wp.int32,
    ring: wp.int32,
    value: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
    delay_s: wp.float64,
) -> wp.bool:
    """What a condition is worth at this step, its value after edges being ``value``."""
    changes = play.conditions[slot, c, ConditionState.CHANGES]
    held = play.conditions[slot, c, ConditionState.HELD]
    if changes == 0 or value != held:
        if ring >= 0:
            oldest = play.histories[slot, ring, changes % _HISTORY_MAX]
            needed = wp.float64(step) * step_s - delay_s + CLOSE
            if changes >= _HISTORY_MAX and wp.float64(oldest) * step_s > needed:
                bits = play.slots[slot, SlotColumn.OVERFLOW]
                play.slots[slot, SlotColumn.OVERFLOW] = bits | wp.int32(Overflow.HISTORY)
            play.histories[slot, ring, changes % _HISTORY_MAX] = step
        play.conditions[slot, c, ConditionState.CHANGES] = changes + 1
        play.conditions[slot, c, ConditionState.HELD] = value
    if ring >= 0:
        return delayed(play, slot, c, ring, step, step_s, delay_s)
    return play.conditions[slot, c, ConditionState.HELD] == 1


@wp.func
def edge_of(edge: wp.int32, last: wp.int32, value: wp.int32) -> wp.int32:
    """1 if an expression's change, or its value, is what a condition waits for."""
    if edge == ConditionEdge.NONE:
        return value
    if last < 0 or last == value:
        return 0
    if edge == ConditionEdge.EITHER:
        return 1
    return wp.where(edge == ConditionEdge.RISING, value, last)


@wp.struct
class Firing:
    """Whether a trigger fires."""

    fired: wp.int32
    causes: wp.int64
    """Entities whose conditions made it, a bit each."""


@wp.func
def fires(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    trigger: wp.int32,
    step: wp.int32,
    step_s: wp.float64,
) -> Firing:
    """Whether a trigger fires, and because of whom.

    All conditions are evaluated, so that their edges and histories do not depend on their order.
    """
    condition0 = tables.programs[program, ProgramColumn.CONDITION]
    row0 = tables.programs[program, ProgramColumn.TRIGGER] + trigger
    first = tables.triggers[row0, 0]
    end = first + tables.triggers[row0, 1]
    fired = wp.int32(0)
    causes = wp.int64(0)
    group = wp.int32(-1)
    group_true = wp.int32(0)
    group_causes = wp.int64(0)
    for c in range(first, end):
        row = condition0 + c
        kind = tables.conditions[row, ConditionColumn.KIND]
        reals = tables.conditions[row, ConditionColumn.REALS]
        wholes = tables.conditions[row, ConditionColumn.WHOLES]
        if tables.conditions[row, ConditionColumn.GROUP] != group:
            group = tables.conditions[row, ConditionColumn.GROUP]
            group_true = 1
            group_causes = wp.int64(0)
        truth = wp.int32(0)
        if kind >= _TIME:
            truth = wp.where(
                value_holds(tables, play, slot, program, c, kind, reals, wholes, step, step_s), 1, 0
            )
        else:
            truth = play.conditions[slot, c, ConditionState.TRUTH]
            group_causes = group_causes | play.condition_causes[slot, c]
        last = play.conditions[slot, c, ConditionState.LAST]
        play.conditions[slot, c, ConditionState.LAST] = truth
        value = edge_of(tables.conditions[row, ConditionColumn.EDGE], last, truth)
        ring = tables.conditions[row, ConditionColumn.RING]
        if not held_value(play, slot, c, ring, value, step, step_s, tables.reals[reals - 1]):
            group_true = 0
        closes = c + 1 == end
        if not closes:
            closes = tables.conditions[row + 1, ConditionColumn.GROUP] != group
        if closes and group_true != 0:
            fired = wp.int32(1)
            causes = causes | group_causes
    if fired != 0:
        for c in range(first, end):
            play.conditions[slot, c, ConditionState.LAST] = -1
    firing = Firing()
    firing.fired = fired
    firing.causes = causes
    return firing
