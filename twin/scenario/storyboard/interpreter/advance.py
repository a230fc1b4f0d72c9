"""The kernel that moves bodies by one step: running actions, then the default controller.

The default controller keeps speed, lane and offset (ASAM OpenSCENARIO XML 1.3, section 6.6.1);
it moves by the new speed times the step, measured at the body's own t, and keeps the body's
heading relative to the road. A body that has no road moves along its heading.

A step has two phases. Actions of Init come first, so that actions of the storyboard see what those
have moved in the same step: in esmini a trajectory of Init has moved its follower when a
synchronisation of the storyboard looks at it (speeds of NCAP CPNA differ by 0.02 m/s otherwise).
Within a phase every body sees the others as they were at its beginning.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_cos, portable_sin
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import (
    BodyPlace,
    controlled_by,
    found_place,
    keep_place,
    moved_place,
    place_of,
    posed_place,
    snapped_lane,
)
from twin.scenario.storyboard.interpreter.laterals import LANE
from twin.scenario.storyboard.interpreter.motions import (
    FREE,
    ON_ROAD,
    STAYS,
    BodyMotion,
    step_action,
)
from twin.scenario.storyboard.interpreter.transition import CLOSE, ZERO
from twin.scenario.storyboard.player.columns import (
    Domain,
    EntityWhole,
    InstanceState,
    ProgramColumn,
    Real,
    SlotColumn,
    Whole,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

INIT_PHASE = 0
STORY_PHASE = 1
_STILL_MPS = wp.constant(wp.float64(1e-3))
"""Bodies that are slower stand still [m/s]."""
_MOVED = wp.constant(wp.int32(64))
"""Bit of ``CLAIMED``: the body was moved along its road."""
_AT_END = wp.constant(wp.int32(128))
"""Bit of ``CLAIMED``: it met the end of the road."""


@wp.func
def measure(
    now: BodyArrays,
    slot: wp.int32,
    e: wp.int32,
    place: BodyPlace,
    speed: wp.float64,
    driven: wp.bool,
    moved: wp.bool,
    after: wp.int32,
    step_s: wp.float64,
):
    """Velocity, acceleration and what lasts, from the places at both ends of a step."""
    dx = place.x - now.reals[slot, e, Real.OLD_X]
    dy = place.y - now.reals[slot, e, Real.OLD_Y]
    dz = place.z - now.reals[slot, e, Real.OLD_Z]
    cosine, sine = portable_cos(place.heading), portable_sin(place.heading)
    vx, vy = speed * cosine, speed * sine
    vz = wp.float64(0.0)
    jumped = now.wholes[slot, e, Whole.JUMPED] != 0 or step_s == ZERO
    if not jumped and driven:
        vx = dx / step_s
        vy = dy / step_s
        vz = dz / step_s
    ax = wp.float64(0.0)
    ay = wp.float64(0.0)
    az = wp.float64(0.0)
    if not jumped:
        ax = (vx - now.reals[slot, e, Real.VX]) / step_s
        ay = (vy - now.reals[slot, e, Real.VY]) / step_s
        az = (vz - now.reals[slot, e, Real.VZ]) / step_s
        way = wp.sqrt(dx * dx + dy * dy)
        now.reals[slot, e, Real.TRAVELED] = now.reals[slot, e, Real.TRAVELED] + way
    now.reals[slot, e, Real.VX] = vx
    now.reals[slot, e, Real.VY] = vy
    now.reals[slot, e, Real.VZ] = vz
    now.reals[slot, e, Real.AX] = ax
    now.reals[slot, e, Real.AY] = ay
    now.reals[slot, e, Real.AZ] = az
    now.reals[slot, e, Real.ACCELERATION] = ax * cosine + ay * sine
    now.reals[slot, e, Real.SPEED] = speed
    now.reals[slot, e, Real.OLD_X] = place.x
    now.reals[slot, e, Real.OLD_Y] = place.y
    now.reals[slot, e, Real.OLD_Z] = place.z
    now.wholes[slot, e, Whole.LEAPT] = now.wholes[slot, e, Whole.JUMPED]
    now.wholes[slot, e, Whole.JUMPED] = 0
    still = wp.abs(speed) < _STILL_MPS
    off = place.road >= 0 and place.lane == 0
    lasting(now, slot, e, Whole.STILL_SINCE, still, after)
    lasting(now, slot, e, Whole.OFF_SINCE, off, after)
    if moved:
        lasting(now, slot, e, Whole.END_SINCE, place.at_end != 0, after)


@wp.func
def lasting(
    now: BodyArrays, slot: wp.int32, e: wp.int32, column: wp.int32, true: wp.bool, after: wp.int32
):
    """Since which step something is true, -1: it is not."""
    if not true:
        now.wholes[slot, e, column] = -1
    elif now.wholes[slot, e, column] < 0:
        now.wholes[slot, e, column] = after


@wp.func
def move_body(
    tables: ProgramArrays,
    roads: RoadArrays,
    now: BodyArrays,
    play: PlayArrays,
    slot: wp.int32,
    program: wp.int32,
    e: wp.int32,
    motion: BodyMotion,
) -> BodyMotion:
    """The place of a body after its motion."""
    if motion.mode == ON_ROAD:
        span = wp.vec2i(0, 0)
        route = now.wholes[slot, e, Whole.ROUTE]
        if route >= 0:
            row = tables.programs[program, ProgramColumn.ROUTE] + route
            first = tables.routes[row, 0]
            span = wp.vec2i(first, first + tables.routes[row, 1])
        place = moved_place(roads, tables.leg_roads, span, motion.place, motion.ahead, ZERO)
        if wp.abs(motion.ahead) > ZERO:
            motion.claimed = motion.claimed | _MOVED
        if place.at_end != 0:
            motion.claimed = motion.claimed | _AT_END
        if motion.changing >= 0:
            play.instance_wholes[slot, motion.changing, LANE] = place.lane
        if now.wholes[slot, e, Whole.CHANGING] != 0:
            now.wholes[slot, e, Whole.CHANGING] = place.lane
        if motion.changing >= 0 or now.wholes[slot, e, Whole.CHANGING] != 0:
            place = snapped_lane(roads, place)
        motion.place = place
    elif motion.mode == FREE:
        motion.place = found_place(roads, motion.place)
    if motion.mode != STAYS:
        motion.place = posed_place(roads, motion.place, motion.mode == ON_ROAD)
        keep_place(now, slot, e, motion.place)
    return motion


@wp.kernel
def advance_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    phase: wp.int32,
    step_s: wp.float64,
    # state in
    before: BodyArrays,
    # state in and out
    now: BodyArrays,
    play: PlayArrays,
):
    """Move bodies, one thread per slot and body; others are read from ``before``."""
    slot, e = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    if e >= tables.programs[program, ProgramColumn.ENTITIES]:
        return
    if now.wholes[slot, e, Whole.PRESENT] == 0:
        return
    step = play.slots[slot, SlotColumn.STEP]
    row = tables.programs[program, ProgramColumn.ENTITY] + e
    first = tables.entity_wholes[row, EntityWhole.LIST]
    end = first + tables.entity_wholes[row, EntityWhole.LIST_COUNT]
    inits = tables.programs[program, ProgramColumn.INITS]
    # Who is let go in this step rolls on at once.
    tractor = now.wholes[slot, e, Whole.TRACTOR]
    towed = wp.bool(False)
    if tractor >= 0:
        towed = now.wholes[slot, tractor, Whole.TOWS] == e
    imposed = towed or now.wholes[slot, e, Whole.IMPOSED] != 0
    controlled = controlled_by(now, slot, e)
    motion = BodyMotion()
    motion.place = place_of(now, slot, e)
    motion.speed = now.reals[slot, e, Real.SPEED]
    motion.mode = wp.int32(STAYS)
    motion.changing = -1
    motion.claimed = 0
    if phase == STORY_PHASE:
        motion.claimed = now.wholes[slot, e, Whole.CLAIMED]
    for at in range(first, end):
        k = tables.actor_instances[at]
        of_init = k < inits
        mine = of_init == (phase == INIT_PHASE)
        if mine and play.instance_states[slot, k] == InstanceState.RUNNING:
            motion = step_action(
                tables, before, now, roads, play, slot, program, e, k, motion, controlled, step,
                step_s,
            )  # fmt: skip
            if motion.over != 0:
                play.instance_states[slot, k] = wp.int32(InstanceState.FINISHED)
    if phase == STORY_PHASE:
        # A driver model says how fast; the way is the default controller's all the same.
        # Who was put somewhere in this step drives on from there in the next, as in esmini.
        taken = motion.claimed & wp.int32(Domain.LONGITUDINAL)
        if now.wholes[slot, e, Whole.JUMPED] != 0:
            taken = wp.int32(Domain.LONGITUDINAL)
        if taken == 0 and not imposed and wp.abs(motion.speed) > CLOSE:
            motion.ahead = motion.ahead + motion.speed * step_s
            if motion.mode == STAYS:
                motion.mode = wp.int32(ON_ROAD)
        if now.wholes[slot, e, Whole.CHANGING] != 0 and motion.mode == STAYS:
            motion.mode = wp.int32(ON_ROAD)
    if imposed:
        motion.mode = wp.int32(STAYS)
    motion = move_body(tables, roads, now, play, slot, program, e, motion)
    if phase == INIT_PHASE:
        now.reals[slot, e, Real.SPEED] = motion.speed
        now.wholes[slot, e, Whole.CLAIMED] = motion.claimed
        return
    now.wholes[slot, e, Whole.CLAIMED] = 0
    if towed:
        return  # its tractor's new place says where it goes
    place = motion.place
    place.at_end = motion.claimed & _AT_END
    moved = motion.claimed & _MOVED != 0
    measure(now, slot, e, place, motion.speed, not imposed, moved, step + 1, step_s)
    if place.at_end != 0:
        now.reals[slot, e, Real.SPEED] = ZERO
