"""Warp functions: the state machine of storyboard elements (ASAM OpenSCENARIO XML 1.3, 7.3).

Elements lie in depth-first order, so the descendants of one are those up to its ``END``, and loops
go over ranges instead of calling themselves. An element is idle (-1) until its parent starts.

Two places where the standard leaves room follow esmini: an action of an actor that begins ends
others of this actor in the same domain, and an event whose trigger is true while it must be
skipped stays in standby without that this counts as an execution.
"""

from __future__ import annotations

import warp as wp

from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.seldom.signals import put_into_phase
from twin.scenario.storyboard.player.columns import (
    TRANSITIONS_MAX,
    ConditionState,
    Domain,
    ElementColumn,
    InstanceColumn,
    InstanceState,
    Overflow,
    ProgramColumn,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.kinds import action_code
from twin.scenario.storyboard.player.layout import real_column, whole_column
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.conditions import ElementState
from twin.scenario.storyboard.program.program import ElementKind, EventPriority

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

IDLE = -1
"""State of an element whose parent has not started."""
_IDLE = wp.constant(wp.int32(IDLE))
_TRANSITIONS_MAX = wp.constant(wp.int32(TRANSITIONS_MAX))

_ENVIRONMENT = action_code(records.EnvironmentAction)
_ADD = action_code(records.AddEntityAction)
_DELETE = action_code(records.DeleteEntityAction)
_SET = action_code(records.SetVariableAction)
_MODIFY = action_code(records.ModifyVariableAction)
_ADD_ENTITY = whole_column(records.AddEntityAction, "entity")
_DELETE_ENTITY = whole_column(records.DeleteEntityAction, "entity")
_ENVIRONMENT_INDEX = whole_column(records.EnvironmentAction, "environment")
_SET_VARIABLE = whole_column(records.SetVariableAction, "variable")
_SET_VALUE = real_column(records.SetVariableAction, "value")
_MODIFY_VARIABLE = whole_column(records.ModifyVariableAction, "variable")
_MODIFY_FACTOR = real_column(records.ModifyVariableAction, "factor")
_MODIFY_ADDEND = real_column(records.ModifyVariableAction, "addend")
_PHASE = action_code(records.SignalPhaseAction)
_PHASE_CONTROLLER = whole_column(records.SignalPhaseAction, "controller")
_PHASE_INDEX = whole_column(records.SignalPhaseAction, "phase")
_LAMP = whole_column(records.LightAction, "light")


@wp.func
def element_at(tables: ProgramArrays, program: wp.int32, e: wp.int32, column: wp.int32) -> wp.int32:
    """A column of an element of a program."""
    return tables.elements[tables.programs[program, ProgramColumn.ELEMENT] + e, column]


@wp.func
def enter(
    tables: ProgramArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    state: wp.int32,
    transition: wp.int32,
):
    """Put an element into a state; ``transition`` -1: nobody is told of one."""
    play.element_states[slot, e] = state
    if transition >= 0:
        count = play.slots[slot, SlotColumn.TRANSITIONS]
        play.slots[slot, SlotColumn.TRANSITIONS] = count + 1
        if count < _TRANSITIONS_MAX:
            play.transitions[slot, count, 0] = play.slots[slot, SlotColumn.STEP]
            play.transitions[slot, count, 1] = e
            play.transitions[slot, count, 2] = transition
        else:
            bits = play.slots[slot, SlotColumn.OVERFLOW]
            play.slots[slot, SlotColumn.OVERFLOW] = bits | wp.int32(Overflow.TRANSITIONS)
    first = tables.programs[program, ProgramColumn.STATES]
    end = first + tables.programs[program, ProgramColumn.STATE_COUNT]
    for row in range(first, end):
        if tables.watchers[row, 1] == e:
            c = tables.watchers[row, 0]
            seen = play.conditions[slot, c, ConditionState.SEEN] | (1 << state)
            if transition >= 0:
                seen = seen | (1 << transition)
            play.conditions[slot, c, ConditionState.SEEN] = seen
            play.conditions[slot, c, ConditionState.LATEST] = state


@wp.func
def forget_trigger(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, trigger: wp.int32
):
    """Conditions of a trigger as if they had never been evaluated."""
    if trigger < 0:
        return
    row = tables.programs[program, ProgramColumn.TRIGGER] + trigger
    first = tables.triggers[row, 0]
    end = first + tables.triggers[row, 1]
    for c in range(first, end):
        play.conditions[slot, c, ConditionState.LAST] = -1
        play.conditions[slot, c, ConditionState.CHANGES] = 0
        play.conditions[slot, c, ConditionState.HELD] = 0
        play.conditions[slot, c, ConditionState.SEEN] = 0


@wp.func
def finish(tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32):
    """End an element all of whose children are complete; groups and events may run again."""
    kind = element_at(tables, program, e, ElementColumn.KIND)
    repeats = kind == ElementKind.GROUP or kind == ElementKind.EVENT
    runs = play.element_runs[slot, e]
    if not repeats or runs >= element_at(tables, program, e, ElementColumn.RUNS_MAX):
        enter(tables, play, slot, program, e, ElementState.COMPLETE, ElementState.END_TRANSITION)
        return
    enter(tables, play, slot, program, e, ElementState.STANDBY, ElementState.END_TRANSITION)
    end = element_at(tables, program, e, ElementColumn.END)
    for below in range(e, end):
        forget_trigger(
            tables, play, slot, program, element_at(tables, program, below, ElementColumn.START)
        )
        forget_trigger(
            tables, play, slot, program, element_at(tables, program, below, ElementColumn.STOP)
        )
        play.element_skips[slot, below] = 0
        if below != e:
            play.element_states[slot, below] = _IDLE
            play.element_runs[slot, below] = 0


@wp.func
def children_complete(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32
) -> wp.bool:
    """True if all children of an element are complete."""
    child = e + 1
    end = element_at(tables, program, e, ElementColumn.END)
    while child < end:
        if play.element_states[slot, child] != ElementState.COMPLETE:
            return False
        child = element_at(tables, program, child, ElementColumn.END)
    return True


@wp.func
def tell_parents(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32
):
    """End those above an element that is complete whose children all are; never the storyboard."""
    parent = element_at(tables, program, e, ElementColumn.PARENT)
    while parent > 0:
        if play.element_states[slot, parent] == ElementState.COMPLETE:
            return
        if not children_complete(tables, play, slot, program, parent):
            return
        finish(tables, play, slot, program, parent)
        parent = element_at(tables, program, parent, ElementColumn.PARENT)


@wp.func
def action_over(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32
):
    """End an action element of which no actor's instance runs any more."""
    if e < 0 or play.element_states[slot, e] != ElementState.RUNNING:
        return
    first = element_at(tables, program, e, ElementColumn.INSTANCE)
    end = first + element_at(tables, program, e, ElementColumn.INSTANCES)
    for k in range(first, end):
        state = play.instance_states[slot, k]
        if state != InstanceState.IDLE and state != InstanceState.DONE:
            return
    enter(tables, play, slot, program, e, ElementState.COMPLETE, ElementState.END_TRANSITION)
    tell_parents(tables, play, slot, program, e)


@wp.func
def stop(tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32):
    """Stop an element and all below it, children first."""
    end = element_at(tables, program, e, ElementColumn.END)
    for back in range(end - e):
        below = end - 1 - back
        state = play.element_states[slot, below]
        if state == ElementState.STANDBY or state == ElementState.RUNNING:
            enter(
                tables,
                play,
                slot,
                program,
                below,
                ElementState.COMPLETE,
                ElementState.STOP_TRANSITION,
            )
            first = element_at(tables, program, below, ElementColumn.INSTANCE)
            last = first + element_at(tables, program, below, ElementColumn.INSTANCES)
            for k in range(first, last):
                play.instance_states[slot, k] = wp.int32(InstanceState.DONE)
        elif state == _IDLE:
            play.element_states[slot, below] = wp.int32(ElementState.COMPLETE)


@wp.func
def stop_element(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, e: wp.int32
):
    """Stop an element and tell those above it."""
    stop(tables, play, slot, program, e)
    tell_parents(tables, play, slot, program, e)


@wp.func
def end_conflicts(
    tables: ProgramArrays, play: PlayArrays, slot: wp.int32, program: wp.int32, k: wp.int32
):
    """End actions of the same actor in a domain that instance ``k`` takes."""
    base = tables.programs[program, ProgramColumn.INSTANCE]
    actor = tables.instances[base + k, InstanceColumn.ACTOR]
    domains = tables.instances[base + k, InstanceColumn.DOMAINS]
    if actor < 0 or domains == 0:
        return
    row = tables.programs[program, ProgramColumn.ENTITY] + actor
    first = tables.entity_wholes[row, 5]
    end = first + tables.entity_wholes[row, 6]
    for at in range(first, end):
        other = tables.actor_instances[at]
        state = play.instance_states[slot, other]
        if other != k and (state == InstanceState.RUNNING or state == InstanceState.STARTING):
            shared = tables.instances[base + other, InstanceColumn.DOMAINS] & domains
            if shared == Domain.LIGHTS:
                lamp = tables.wholes[tables.instances[base + k, InstanceColumn.WHOLES] + _LAMP]
                if (
                    lamp
                    != (
                        tables.wholes[tables.instances[base + other, InstanceColumn.WHOLES] + _LAMP]
                    )
                ):
                    shared = 0
            if shared != 0:
                play.instance_states[slot, other] = wp.int32(InstanceState.DONE)
                element = tables.instances[base + other, InstanceColumn.ELEMENT]
                action_over(tables, play, slot, program, element)


@wp.func
def do_global(
    tables: ProgramArrays,
    play: PlayArrays,
    bodies: BodyArrays,
    slot: wp.int32,
    program: wp.int32,
    k: wp.int32,
) -> wp.bool:
    """Do a global action at once; False of one that places an entity, which comes later."""
    row = tables.programs[program, ProgramColumn.INSTANCE] + k
    kind = tables.instances[row, InstanceColumn.KIND]
    reals = tables.instances[row, InstanceColumn.REALS]
    wholes = tables.instances[row, InstanceColumn.WHOLES]
    if kind == _SET:
        play.variables[slot, tables.wholes[wholes + _SET_VARIABLE]] = tables.reals[
            reals + _SET_VALUE
        ]
    elif kind == _MODIFY:
        variable = tables.wholes[wholes + _MODIFY_VARIABLE]
        play.variables[slot, variable] = (
            play.variables[slot, variable] * tables.reals[reals + _MODIFY_FACTOR]
            + tables.reals[reals + _MODIFY_ADDEND]
        )
    elif kind == _ENVIRONMENT:
        environment = tables.wholes[wholes + _ENVIRONMENT_INDEX]
        clock = tables.programs[program, ProgramColumn.ENVIRONMENT] + environment
        if not wp.isnan(tables.clocks[clock]):
            play.slots[slot, SlotColumn.ENVIRONMENT] = environment
            play.slots[slot, SlotColumn.ENVIRONMENT_STEP] = play.slots[slot, SlotColumn.STEP]
    elif kind == _DELETE:
        entity = tables.wholes[wholes + _DELETE_ENTITY]
        bodies.wholes[slot, entity, Whole.PRESENT] = 0
        bodies.wholes[slot, entity, Whole.VISIBLE] = 0
    elif kind == _PHASE:
        put_into_phase(
            tables,
            play,
            slot,
            program,
            tables.wholes[wholes + _PHASE_CONTROLLER],
            tables.wholes[wholes + _PHASE_INDEX],
        )
    elif kind == _ADD:
        return False
    return True


@wp.func
def start_event(
    tables: ProgramArrays,
    play: PlayArrays,
    bodies: BodyArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    causes: wp.int64,
):
    """Start an event as its priority allows, and its actions."""
    parent = element_at(tables, program, e, ElementColumn.PARENT)
    priority = element_at(tables, program, e, ElementColumn.PRIORITY)
    sibling = parent + 1
    last = element_at(tables, program, parent, ElementColumn.END)
    while sibling < last and priority != EventPriority.PARALLEL:
        if sibling != e and play.element_states[slot, sibling] == ElementState.RUNNING:
            if priority == EventPriority.SKIP:
                if play.element_skips[slot, e] == 0:
                    state = wp.int32(ElementState.STANDBY)
                    enter(tables, play, slot, program, e, state, ElementState.SKIP_TRANSITION)
                play.element_skips[slot, e] = 1
                return
            stop(tables, play, slot, program, sibling)
        sibling = element_at(tables, program, sibling, ElementColumn.END)
    play.element_skips[slot, e] = 0
    play.element_causes[slot, e] = causes
    play.element_runs[slot, e] = play.element_runs[slot, e] + 1
    enter(tables, play, slot, program, e, ElementState.RUNNING, ElementState.START_TRANSITION)
    base = tables.programs[program, ProgramColumn.INSTANCE]
    action = e + 1
    end = element_at(tables, program, e, ElementColumn.END)
    if action == end:
        finish(tables, play, slot, program, e)
        tell_parents(tables, play, slot, program, e)
        return
    while action < end:
        enter(
            tables,
            play,
            slot,
            program,
            action,
            ElementState.RUNNING,
            ElementState.START_TRANSITION,
        )
        first = element_at(tables, program, action, ElementColumn.INSTANCE)
        behind = first + element_at(tables, program, action, ElementColumn.INSTANCES)
        for k in range(first, behind):
            actor = tables.instances[base + k, InstanceColumn.ACTOR]
            play.instance_states[slot, k] = wp.int32(InstanceState.DONE)
            chosen = tables.instances[base + k, InstanceColumn.ALWAYS] != 0
            if not chosen:
                chosen = (causes >> wp.int64(actor)) & wp.int64(1) != wp.int64(0)
            if chosen:
                end_conflicts(tables, play, slot, program, k)
                state = wp.int32(InstanceState.STARTING)
                if actor < 0 and do_global(tables, play, bodies, slot, program, k):
                    state = wp.int32(InstanceState.FINISHED)
                play.instance_states[slot, k] = state
        action = element_at(tables, program, action, ElementColumn.END)
    action = e + 1
    while action < end:
        action_over(tables, play, slot, program, action)
        action = element_at(tables, program, action, ElementColumn.END)


@wp.func
def start(
    tables: ProgramArrays,
    play: PlayArrays,
    bodies: BodyArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    causes: wp.int64,
):
    """Start an element and, down to events, all below it that has no trigger to wait for."""
    at = e
    end = element_at(tables, program, e, ElementColumn.END)
    while at < end:
        after = element_at(tables, program, at, ElementColumn.END)
        begins = at == e
        if not begins:
            parent = element_at(tables, program, at, ElementColumn.PARENT)
            begins = play.element_states[slot, parent] == ElementState.RUNNING
        if begins and at != e and element_at(tables, program, at, ElementColumn.START) >= 0:
            enter(tables, play, slot, program, at, ElementState.STANDBY, -1)
            begins = False
        if begins:
            if element_at(tables, program, at, ElementColumn.KIND) == ElementKind.EVENT:
                start_event(tables, play, bodies, slot, program, at, causes)
            else:
                play.element_runs[slot, at] = play.element_runs[slot, at] + 1
                enter(
                    tables,
                    play,
                    slot,
                    program,
                    at,
                    ElementState.RUNNING,
                    ElementState.START_TRANSITION,
                )
                after = at + 1
        at = after
