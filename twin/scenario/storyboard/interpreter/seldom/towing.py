"""The kernel that pulls trailers behind their tractors.

A trailer's origin is the middle of its axle (or of its axles), which moves along its own heading
only; its coupler is where the tractor's hitch is. While the hitch goes straight on by d, the angle
phi between trailer and way follows d phi / d s = -sin(phi) / L, with L from axle to coupler, so

    tan(phi / 2) = tan(phi_0 / 2) exp(-d / L)

(the tractrix; single-track model of a trailer). A step of the hitch counts as straight.

A tractor that is put somewhere has its trailer straight behind it, unless the trailer is put
somewhere, too: then it keeps that heading. A trailer that is coupled turns to the hitch from where
it stands, and is pulled or pushed there at once. Connections are ASAM OpenSCENARIO XML 1.3
``ConnectTrailerAction`` and ``DisconnectTrailerAction``; the standard names no motion.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan2, portable_cos, portable_exp, portable_sin
from twin.road.walk.road_arrays import RoadArrays
from twin.scenario.storyboard.interpreter.advance import measure
from twin.scenario.storyboard.interpreter.arrays import BodyArrays, PlayArrays, ProgramArrays
from twin.scenario.storyboard.interpreter.ground import (
    BodyPlace,
    found_place,
    keep_place,
    place_of,
    posed_place,
    wrapped,
)
from twin.scenario.storyboard.interpreter.transition import HALF, TWO, ZERO
from twin.scenario.storyboard.player.columns import (
    EntityColumn,
    ProgramColumn,
    Real,
    SlotColumn,
    Whole,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

_EVERYONE = wp.constant(wp.int32(7))
_STANDS_M = wp.constant(wp.float64(1e-9))
"""A hitch that moves by less has no direction [m]: sums of what stands still differ by 1e-16."""


@wp.func
def pulled_heading(
    heading: wp.float64, dx: wp.float64, dy: wp.float64, length: wp.float64
) -> wp.float64:
    """Heading of a trailer of that length whose coupler has moved straight by dx, dy."""
    way = wp.sqrt(dx * dx + dy * dy)
    if way < _STANDS_M:
        return heading
    towards = portable_atan2(dy, dx)
    half = HALF * wrapped(heading - towards)
    less = portable_exp(-(way / length))
    angle = TWO * portable_atan2(portable_sin(half) * less, portable_cos(half))
    return wrapped(towards + angle)


@wp.func
def settle_couplings(now: BodyArrays, slot: wp.int32, count: wp.int32) -> wp.int64:
    """What tractors tow becomes what tows trailers; who is coupled now, a bit each.

    A trailer hangs on one hitch, the last that took it, and nobody tows a tractor of his own.
    """
    coupled = wp.int64(0)
    for e in range(count):
        trailer = now.wholes[slot, e, Whole.TOWS]
        if trailer >= 0 and now.wholes[slot, trailer, Whole.TRACTOR] != e:
            at = wp.int32(e)
            for _back in range(count):
                if at >= 0 and at != trailer:
                    at = now.wholes[slot, at, Whole.TRACTOR]
            if at == trailer:
                now.wholes[slot, e, Whole.TOWS] = -1
            else:
                other = now.wholes[slot, trailer, Whole.TRACTOR]
                if other >= 0:
                    now.wholes[slot, other, Whole.TOWS] = -1
                now.wholes[slot, trailer, Whole.TRACTOR] = e
                coupled = coupled | (wp.int64(1) << wp.int64(trailer))
    for e in range(count):
        tractor = now.wholes[slot, e, Whole.TRACTOR]
        if tractor >= 0:
            if now.wholes[slot, tractor, Whole.TOWS] != e:
                now.wholes[slot, e, Whole.TRACTOR] = -1
    return coupled


@wp.func
def tow_depth(now: BodyArrays, slot: wp.int32, e: wp.int32, count: wp.int32) -> wp.int32:
    """How many tractors are before a body in its train."""
    depth = wp.int32(0)
    at = now.wholes[slot, e, Whole.TRACTOR]
    while at >= 0 and depth <= count:
        depth += 1
        at = now.wholes[slot, at, Whole.TRACTOR]
    return depth


@wp.func
def towed_place(
    tables: ProgramArrays,
    now: BodyArrays,
    slot: wp.int32,
    base: wp.int32,
    e: wp.int32,
    coupled: wp.bool,
) -> BodyPlace:
    """Where a trailer is now that its tractor has moved; its height is still the tractor's."""
    tractor = now.wholes[slot, e, Whole.TRACTOR]
    ahead = place_of(now, slot, tractor)
    place = place_of(now, slot, e)
    hitch = tables.entity_reals[base + tractor, EntityColumn.HITCH]
    length = tables.entity_reals[base + e, EntityColumn.COUPLER]
    hitch_x = ahead.x + hitch * portable_cos(ahead.heading)
    hitch_y = ahead.y + hitch * portable_sin(ahead.heading)
    leapt = now.wholes[slot, tractor, Whole.JUMPED] + now.wholes[slot, tractor, Whole.LEAPT]
    heading = wp.float64(place.heading)
    if now.wholes[slot, e, Whole.PRESENT] == 0 or place.road < 0:
        place.road = ahead.road
        place.s = ahead.s
    if coupled:
        heading = portable_atan2(hitch_y - place.y, hitch_x - place.x)
    elif now.wholes[slot, e, Whole.PRESENT] == 0:
        heading = ahead.heading
    elif now.wholes[slot, e, Whole.JUMPED] == 0:
        if leapt != 0:
            heading = ahead.heading
        else:
            dx = hitch_x - place.x - length * portable_cos(heading)
            dy = hitch_y - place.y - length * portable_sin(heading)
            heading = pulled_heading(heading, dx, dy, length)
    place.heading = heading
    place.x = hitch_x - length * portable_cos(heading)
    place.y = hitch_y - length * portable_sin(heading)
    place.z = ahead.z
    return place


@wp.func
def on_surface(roads: RoadArrays, place: BodyPlace) -> BodyPlace:
    """A place with the height, pitch and roll of the road below it, if there is one."""
    place = found_place(roads, place)
    level = BodyPlace()
    for turn in range(2):
        level = place
        if turn == 1:
            level = posed_place(roads, place, True)
        else:
            place = posed_place(roads, place, False)
    if place.road >= 0:
        place.z = level.z
        place.pitch = level.pitch
        place.roll = level.roll
    return place


@wp.kernel
def tow_kernel(
    # model
    tables: ProgramArrays,
    roads: RoadArrays,
    # args
    only: wp.int32,
    opening: wp.int32,
    step_s: wp.float64,
    # state in
    play: PlayArrays,
    # state in and out
    now: BodyArrays,
):
    """Put trailers where their tractors' hitches are, one thread per slot, tractors first.

    ``opening`` 1: Init has just put tractors somewhere, and there is no motion yet.
    """
    slot = wp.tid()
    if (only >= 0 and slot != only) or play.slots[slot, SlotColumn.RUNNING] == 0:
        return
    program = play.slots[slot, SlotColumn.PROGRAM]
    base = tables.programs[program, ProgramColumn.ENTITY]
    count = tables.programs[program, ProgramColumn.ENTITIES]
    after = play.slots[slot, SlotColumn.STEP] + 1
    coupled = settle_couplings(now, slot, count)
    deepest = wp.int32(0)
    for e in range(count):
        deepest = wp.max(deepest, tow_depth(now, slot, e, count))
    for at in range(deepest * count):
        depth, e = at // count + 1, at % count
        towed = now.wholes[slot, e, Whole.TRACTOR] >= 0
        if towed and tow_depth(now, slot, e, count) == depth:
            tractor = now.wholes[slot, e, Whole.TRACTOR]
            if now.wholes[slot, tractor, Whole.PRESENT] != 0:
                taken = (coupled >> wp.int64(e)) & wp.int64(1) != wp.int64(0)
                place = towed_place(tables, now, slot, base, e, taken)
                place = on_surface(roads, place)
                leapt = now.wholes[slot, tractor, Whole.LEAPT]
                if taken or leapt != 0 or now.wholes[slot, e, Whole.PRESENT] == 0:
                    now.wholes[slot, e, Whole.JUMPED] = 1
                keep_place(now, slot, e, place)
                if now.wholes[slot, e, Whole.PRESENT] == 0:
                    now.wholes[slot, e, Whole.PRESENT] = 1
                    now.wholes[slot, e, Whole.VISIBLE] = _EVERYONE
                turned = place.heading - now.reals[slot, tractor, Real.HEADING]
                speed = now.reals[slot, tractor, Real.SPEED] * portable_cos(turned)
                if now.wholes[slot, e, Whole.JUMPED] == 0 and step_s > ZERO:
                    dx = place.x - now.reals[slot, e, Real.OLD_X]
                    dy = place.y - now.reals[slot, e, Real.OLD_Y]
                    along = dx * portable_cos(place.heading) + dy * portable_sin(place.heading)
                    speed = along / step_s
                if opening == 0:
                    measure(now, slot, e, place, speed, True, False, after, step_s)
                else:
                    now.reals[slot, e, Real.SPEED] = speed
