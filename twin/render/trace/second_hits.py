"""What second rays meet, on a GPU: a kernel that traces them, apart from the one that shades.

A traversal needs few registers, so more rays are under way at once than in a kernel that shades as
well (:mod:`twin.render.mirror`). What is found waits in memory by its place on the list of pixels,
and goes on to :mod:`twin.render.light.second_light`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from twin.base.portable.quick import ahead_of, dot, of_axes, unit
from twin.render.build import NONE, Features, KernelOptions
from twin.render.light.light import SlotLight
from twin.render.look_pixels import kept_albedo, with_kept_look
from twin.render.look_surface import bent_normal, bounced, smooth_point
from twin.render.noise import value_noise
from twin.render.shading import fresnel_of, place_of, surface_functions
from twin.render.trace.geometry import RayHit, RayScene, rays_of
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.visibility import (
    DETAILED,
    LIT,
    NOTHING,
    PixelsSeen,
    list_is_done,
    next_of_list,
    pixel_of,
    put_on_list,
    threads,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RANGE_M = wp.constant(100.0)
"""Length of second rays [m]."""
SHELL_M = wp.constant(0.10)
"""A pane that lies on a closed body shows a dark cabin, not the paint behind it [m]."""
RIPPLE = wp.constant(0.025)
"""Added to the normal of water at most [-]."""
LEFT = wp.constant(-2)
"""Face of a pixel with a pane that one looks through: both its rays are left to
:func:`twin.render.mirror.mirror_kernel`."""

HIT_BYTES_PER_PIXEL = 24
"""Size of a pixel of :class:`SecondHits` [bytes]."""
DETAIL_HIT_BYTES_PER_PIXEL = 8
"""What is added where materials come from files [bytes]."""


@wp.struct
class SecondHits:
    """What mirrored rays meet, by the places of their pixels on the list of second rays."""

    t: wp.array(dtype=wp.float32)
    """Length of the ray [m]."""
    u: wp.array(dtype=wp.float32)
    """Weight of the first corner."""
    v: wp.array(dtype=wp.float32)
    """Weight of the second one."""
    face: wp.array(dtype=wp.int32)
    """Face; -1: the sky; :data:`LEFT`."""
    flags: wp.array(dtype=wp.int32)
    """Object + 1, and whether the sun gets there, as in :class:`PixelsSeen`."""
    left: wp.array(dtype=wp.int32)
    """Threads whose pixels are left to the kernel that traces and shades, in any order."""
    left_count: wp.array(dtype=wp.int32)
    """Number of these, and how many have been given out, as in :class:`PixelsSeen` [2]."""
    plain: wp.array(dtype=wp.int32)
    """Places whose rays meet faces without details or the sky, in any order; empty where no face
    has any."""
    plain_count: wp.array(dtype=wp.int32)
    """The same of these [2]; where no face has details, what is given out is the first list."""
    detailed: wp.array(dtype=wp.int32)
    """Places whose rays meet faces with details, in any order."""
    detailed_count: wp.array(dtype=wp.int32)
    """The same of these [2]."""
    counts: wp.array(dtype=wp.int32)
    """All of these numbers [6]."""


def allocate_hits(
    slots: int, height: int, width: int, device: wp.Device, features: Features = NONE
) -> SecondHits:
    """Buffers for ``slots`` at once."""
    count = threads(slots, height, width)
    hits = SecondHits()
    for name in ("t", "u", "v"):
        setattr(hits, name, wp.empty(count, dtype=wp.float32, device=device))
    for name in ("face", "flags", "left"):
        setattr(hits, name, wp.empty(count, dtype=wp.int32, device=device))
    sorted_places = count if features.looks else 1
    hits.plain = wp.empty(sorted_places, dtype=wp.int32, device=device)
    hits.detailed = wp.empty(sorted_places, dtype=wp.int32, device=device)
    hits.counts = counts = wp.zeros(6, dtype=wp.int32, device=device)
    hits.left_count, hits.plain_count, hits.detailed_count = counts[0:2], counts[2:4], counts[4:6]
    return hits


def left_pixels(seen: PixelsSeen, hits: SecondHits) -> PixelsSeen:
    """``seen`` with the pixels that are left for its list of second rays."""
    left = PixelsSeen()
    for name in PixelsSeen.vars:
        setattr(left, name, getattr(seen, name))
    left.listed, left.listed_count = hits.left, hits.left_count
    return left


@wp.struct
class Aim:
    """Where a pixel's second rays go."""

    p: wp.vec3
    """Place that the pixel sees [m]."""
    n: wp.vec3
    """Normal of the face there, on the side of the viewer."""
    distance: wp.float32
    """From the camera [m]."""
    ahead: wp.vec3
    """Direction of the mirrored ray."""
    mirror: wp.float32
    """Share that is mirrored [-]; 0: nothing is."""
    clear: wp.float32
    """Share of the rest that passes [-]; 0: opaque."""
    tint: wp.vec3
    """Colour of the mirror part, where materials come from files."""


@wp.func
def rippled(n: wp.vec3, p: wp.vec3, wetness: wp.float32) -> wp.vec3:
    """Normal that mirrors where a face has the normal ``n``: water is never quite level."""
    bent = n
    if n[2] > 0.9 and wetness > 0.0:
        x = value_noise(p[0] * 5.0, p[1] * 5.0, 21) - 0.5
        y = value_noise(p[0] * 5.0, p[1] * 5.0, 22) - 0.5
        bent = unit(n + wp.vec3(x, y, 0.0) * RIPPLE)
    return bent


@cache
def aim_function(features: Features) -> Any:
    """``aim_of`` for worlds with such ``features``."""
    looks = features.looks
    surface_of, _ = surface_functions(features)

    @wp.func
    def aim_of(
        scene: RayScene,
        slot: wp.int32,
        optics: Optics,
        seen: PixelsSeen,
        thread: wp.int32,
        pose: SlotPose,
        direction: wp.vec3,
        light: SlotLight,
    ) -> Aim:
        """Second rays of a thread's pixel, seen along ``direction``."""
        at = place_of(scene, slot, seen, thread, pose.eye, direction)
        own = wp.vec4(0.0, 0.0, 0.0, 0.0)
        if wp.static(looks):
            flags = seen.flags[thread]
            if (flags & DETAILED) != 0:
                own = kept_albedo(seen.look, thread)
        albedo = wp.vec3(own[0], own[1], own[2])
        s = surface_of(scene, slot, optics, at, direction, light, albedo)
        if wp.static(looks):
            s = with_kept_look(s, seen.look, thread, flags, own[3], at.n, light)
        aim = Aim()
        aim.p = at.p
        aim.n = at.n
        aim.distance = at.distance
        if s.mirror > 0.0:
            n = rippled(at.n, at.p, light.wetness)
            if wp.static(looks):
                n = bent_normal(n, s)
            cosine = wp.clamp(-dot(n, direction), 0.0, 1.0)
            aim.mirror = fresnel_of(s.mirror, cosine)  # Schlick (1994)
            aim.clear = s.clear
            aim.ahead = direction + n * (2.0 * cosine)
            if wp.static(looks):
                aim.ahead = bounced(direction, n, at.n)
                aim.tint = s.tint
        return aim

    return aim_of


@cache
def hits_kernel(build: KernelOptions, features: Features = NONE) -> wp.Kernel:
    """The kernel, compiled as ``build`` says for worlds with such ``features``."""
    looks = features.looks
    trace, occluded = rays_of(features)
    aim_of = aim_function(features)

    @wp.kernel(**build.arguments())
    def second_hits_kernel(
        # model
        scene: RayScene,
        optics: Optics,
        rays: wp.array2d(dtype=wp.vec3),
        # state in
        lights: wp.array(dtype=SlotLight),
        poses: wp.array(dtype=SlotPose),
        seen: PixelsSeen,
        # args
        first_slot: wp.int32,
        # out
        hits: SecondHits,
    ):
        """Trace mirrored rays of the pixels on the list; the launch may be shorter than it."""
        count = seen.listed_count[0]
        while True:
            place = next_of_list(seen.listed_count)
            if list_is_done(place, count):
                break
            if place >= count:
                continue
            thread = seen.listed[place]
            pixel = pixel_of(thread, first_slot, optics)
            slot = pixel.slot
            ray = rays[pixel.row, pixel.column]
            direction = of_axes(ray, poses[slot].right, poses[slot].down, poses[slot].ahead)
            aim = aim_of(scene, slot, optics, seen, thread, poses[slot], direction, lights[slot])
            hit = RayHit()
            # One loop over both rays, so that the code of a ray stands there once.
            turn = wp.int32(2)
            if aim.mirror > 0.0:
                turn = wp.where(aim.clear > 0.0, 0, 1)
            left = wp.bool(False)
            while turn < 2:
                start = aim.p - aim.n * 0.004
                ahead = direction
                reach = SHELL_M
                if turn == 1:
                    start = ahead_of(aim.p, aim.n, 0.02)
                    ahead = aim.ahead
                    reach = RANGE_M
                hit = trace(scene, slot, start, ahead, 0.0, reach)
                if turn == 0 and not hit.found:  # one looks through the pane
                    left = True
                    turn = 2
                turn += 1
            if left:
                hits.face[place] = LEFT
                put_on_list(hits.left, hits.left_count, thread)
                continue
            detailed = wp.bool(False)
            face = wp.int32(NOTHING)
            if hit.found:
                face = hit.face
                flags = hit.object + 1
                p = ahead_of(ahead_of(aim.p, aim.n, 0.02), aim.ahead, hit.t)
                facing = hit.normal
                if wp.static(looks):
                    detailed = scene.faces[hit.face].uv_per_m < 0.0
                    if detailed:
                        smooth = smooth_point(
                            scene, slot, hit.face, hit.object, hit.u, hit.v, hit.normal
                        )
                        facing = smooth.n
                        p = p + smooth.lift
                sun = lights[slot].sun_direction
                if lights[slot].shadows != 0 and dot(facing, sun) > 0.0:
                    p = p + hit.normal * 0.02
                    if not occluded(scene, slot, p, sun, RANGE_M):
                        flags = flags | LIT
                hits.t[place] = hit.t
                hits.u[place] = hit.u
                hits.v[place] = hit.v
                hits.flags[place] = flags
            hits.face[place] = face
            if wp.static(looks):
                if detailed:
                    put_on_list(hits.detailed, hits.detailed_count, place)
                else:
                    put_on_list(hits.plain, hits.plain_count, place)

    return second_hits_kernel
