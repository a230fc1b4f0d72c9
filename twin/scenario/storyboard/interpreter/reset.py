"""Kernels that put a slot at its beginning, and bodies where somebody else says."""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.elements import IDLE, do_global
from twin.scenario.storyboard.interpreter.ground import (
    found_place,
    keep_place,
    place_of,
    posed_place,
    resolved_place,
)
from twin.scenario.storyboard.interpreter.transition import ZERO
from twin.scenario.storyboard.player.columns import (
    ConditionState,
    EntityWhole,
    InstanceColumn,
    InstanceState,
    ProgramColumn,
    Real,
    SlotColumn,
    Whole,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_IDLE = wp.constant(wp.int32(IDLE))
_EVERYONE = wp.constant(wp.int32(7))


@wp.kernel
def reset_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    slot: wp.int32,
    program: wp.int32,
    # state out
    bodies: BodyArrays,
    play: PlayArrays,
):
    """A slot at the beginning of a program; thread i clears the i-th of everything."""
    i = wp.tid()
    if i == 0:
        for column in range(play.slots.shape[1]):
            play.slots[slot, column] = 0
        play.slots[slot, SlotColumn.PROGRAM] = program
        play.slots[slot, SlotColumn.RUNNING] = 1
        play.slots[slot, SlotColumn.ENVIRONMENT] = -1
    if i < play.element_states.shape[1]:
        play.element_states[slot, i] = _IDLE
        play.element_runs[slot, i] = 0
        play.element_causes[slot, i] = wp.int64(0)
        play.element_skips[slot, i] = 0
    if i < play.conditions.shape[1]:
        for column in range(play.conditions.shape[2]):
            play.conditions[slot, i, column] = 0
        play.conditions[slot, i, ConditionState.LAST] = -1
        play.conditions[slot, i, ConditionState.LATEST] = -1
    if i < play.instance_states.shape[1]:
        play.instance_states[slot, i] = wp.int32(InstanceState.IDLE)
    if i < play.variables.shape[1]:
        play.variables[slot, i] = ZERO
        if i < tables.programs[program, ProgramColumn.VARIABLES]:
            first = tables.programs[program, ProgramColumn.VARIABLE]
            play.variables[slot, i] = tables.variables[first + i]
    if i < play.phases.shape[1]:
        play.phases[slot, i] = -1
        play.phase_steps[slot, i] = 0
        play.phase_ways[slot, i] = ZERO
        if i < tables.programs[program, ProgramColumn.CONTROLLERS]:
            controller = tables.programs[program, ProgramColumn.CONTROLLER] + i
            play.phase_ways[slot, i] = -tables.delays[controller, 0]
    if i < bodies.reals.shape[1]:
        for column in range(bodies.reals.shape[2]):
            bodies.reals[slot, i, column] = ZERO
        for column in range(bodies.wholes.shape[2]):
            bodies.wholes[slot, i, column] = -1
        bodies.wholes[slot, i, Whole.VISIBLE] = 0
        bodies.wholes[slot, i, Whole.PRESENT] = 0
        bodies.wholes[slot, i, Whole.CONTROLLED] = 0
        bodies.wholes[slot, i, Whole.IMPOSED] = 0
        bodies.wholes[slot, i, Whole.LIGHTS] = 0
        bodies.wholes[slot, i, Whole.LANE] = 0
        bodies.wholes[slot, i, Whole.JUMPED] = 1
        bodies.wholes[slot, i, Whole.CLAIMED] = 0
        bodies.wholes[slot, i, Whole.CHANGING] = 0
        bodies.wholes[slot, i, Whole.LEAPT] = 0
        row = tables.programs[program, ProgramColumn.ENTITY] + i
        here = i < tables.programs[program, ProgramColumn.ENTITIES]
        if here:
            bodies.wholes[slot, i, Whole.TOWS] = tables.entity_wholes[row, EntityWhole.TOWS]
            bodies.wholes[slot, i, Whole.TRACTOR] = tables.entity_wholes[row, EntityWhole.TRACTOR]
        if here and tables.entity_wholes[row, EntityWhole.PLACED] != 0:
            reals = tables.entity_wholes[row, EntityWhole.START_REALS]
            wholes = tables.entity_wholes[row, EntityWhole.START_WHOLES]
            place = resolved_place(tables, bodies, roads, slot, reals, wholes)
            keep_place(bodies, slot, i, place)
            bodies.wholes[slot, i, Whole.PRESENT] = 1
            bodies.wholes[slot, i, Whole.VISIBLE] = _EVERYONE


@wp.kernel
def open_kernel(
    # model
    tables: ProgramArrays,
    # args
    slot: wp.int32,
    # state in and out
    bodies: BodyArrays,
    play: PlayArrays,
):
    """Global actions of Init at once, all others are to begin."""
    program = play.slots[slot, SlotColumn.PROGRAM]
    base = tables.programs[program, ProgramColumn.INSTANCE]
    for k in range(tables.programs[program, ProgramColumn.INITS]):
        state = wp.int32(InstanceState.STARTING)
        if tables.instances[base + k, InstanceColumn.ACTOR] < 0:
            if do_global(tables, play, bodies, slot, program, k):
                state = wp.int32(InstanceState.DONE)
        play.instance_states[slot, k] = state


@wp.kernel
def close_kernel(
    # args
    slot: wp.int32,
    # state in and out
    bodies: BodyArrays,
):
    """Velocities of the speeds that Init has given, so that conditions see them at time 0."""
    e = wp.tid()
    heading = bodies.reals[slot, e, Real.HEADING]
    speed = bodies.reals[slot, e, Real.SPEED]
    bodies.reals[slot, e, Real.VX] = speed * portable_cos(heading)
    bodies.reals[slot, e, Real.VY] = speed * portable_sin(heading)


@wp.kernel
def impose_kernel(
    # model
    roads: RoadArrays,
    # args
    slot: wp.int32,
    e: wp.int32,
    pose: wp.array(dtype=wp.float64),
    # state in and out
    bodies: BodyArrays,
):
    """Put a body at x, y, z, heading, pitch, roll with a speed until the next step is over."""
    place = place_of(bodies, slot, e)
    place.x = pose[0]
    place.y = pose[1]
    place.z = pose[2]
    place.heading = pose[3]
    place.pitch = pose[4]
    place.roll = pose[5]
    place = found_place(roads, place)
    place = posed_place(roads, place, False)
    keep_place(bodies, slot, e, place)
    bodies.reals[slot, e, Real.SPEED] = pose[6]
    bodies.wholes[slot, e, Whole.IMPOSED] = 1
    if bodies.wholes[slot, e, Whole.PRESENT] == 0:
        bodies.wholes[slot, e, Whole.PRESENT] = 1
        bodies.wholes[slot, e, Whole.VISIBLE] = _EVERYONE


@wp.kernel
def copy_kernel(
    # state in
    bodies: BodyArrays,
    # state out
    before: BodyArrays,
):
    """All bodies as they are now, one thread per slot and body."""
    slot, e = wp.tid()
    for column in range(bodies.reals.shape[2]):
        before.reals[slot, e, column] = bodies.reals[slot, e, column]
    for column in range(bodies.wholes.shape[2]):
        before.wholes[slot, e, column] = bodies.wholes[slot, e, column]
