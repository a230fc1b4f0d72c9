"""Light of what second rays have met: the kernels behind :mod:`twin.render.trace.second_hits`.

Rays that meet faces with details are shaded by a kernel of their own, so that all others carry
neither its registers nor its code.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from twin.base.portable.quick import ahead_of, dot, of_axes
from twin.render.build import NONE, Features, KernelOptions
from twin.render.light.air import through_air
from twin.render.light.lamps import LampBeams, StreetLamps
from twin.render.light.light import SlotLight
from twin.render.light.sky import smooth_sky, sun_through_clouds
from twin.render.look_surface import look_ruffle, smooth_point, with_look
from twin.render.shading import PI_INVERSE, ShadedPoint, look_of, surface_functions
from twin.render.trace.geometry import RayScene, out_of_object
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.second_hits import LEFT, Aim, SecondHits, aim_function
from twin.render.trace.visibility import (
    LIT,
    MIRRORED,
    OBJECT_MASK,
    PixelsSeen,
    list_is_done,
    next_of_list,
    pixel_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CABIN = wp.constant(wp.vec3(0.012, 0.013, 0.014))
"""Reflectance of what is seen through a pane of a closed body [-]."""
HALF_MAX = wp.constant(60000.0)


@wp.func
def met_at(
    scene: RayScene, slot: wp.int32, aim: Aim, hits: SecondHits, place: wp.int32, light: SlotLight
) -> ShadedPoint:
    """What the ray of a place has met; its face is below 0 if nothing."""
    at = ShadedPoint()
    at.face = hits.face[place]
    at.object = -1
    if at.face < 0:
        return at
    flags = hits.flags[place]
    at.object = (flags & OBJECT_MASK) - 1
    t = hits.t[place]
    at.p = ahead_of(ahead_of(aim.p, aim.n, 0.02), aim.ahead, t)
    at.u = hits.u[place]
    at.v = hits.v[place]
    at.distance = aim.distance + t
    at.n = scene.faces[at.face].normal
    if at.object >= 0:
        at.n = out_of_object(at.n, scene.objects[slot, at.object])
    if dot(at.n, aim.ahead) > 0.0:
        at.n = -at.n
    if (flags & LIT) != 0:
        at.lit = sun_through_clouds(at.p, light)
    return at


@cache
def _far_light(features: Features, detailed: bool) -> Any:
    """The function of what comes along a mirrored ray."""
    surface_of, matt_light = surface_functions(features, 1)

    @wp.func
    def far_light(
        scene: RayScene,
        slot: wp.int32,
        lamps: StreetLamps,
        beams: wp.array2d(dtype=LampBeams),
        optics: Optics,
        pose: SlotPose,
        at: ShadedPoint,
        direction: wp.vec3,
        t: wp.float32,
        light: SlotLight,
        table: wp.array3d(dtype=wp.vec3),
    ) -> wp.vec3:
        """What comes along ``direction`` from a place ``t`` away that was met [cd/m^2]."""
        if at.face < 0:
            return smooth_sky(direction, slot, light, table)
        if wp.static(detailed):
            own = look_of(scene, optics, at, direction)
            smooth = smooth_point(scene, slot, at.face, at.object, at.u, at.v, at.n)
            ruffle = look_ruffle(
                scene, slot, at.face, at.object, at.n, smooth.n, at.u, at.v, own.bump, direction
            )
            s = surface_of(scene, slot, optics, at, direction, light, own.albedo)
            s = with_look(s, own, ruffle, at.n, light)
        else:
            none = wp.vec3(0.0, 0.0, 0.0)
            s = surface_of(scene, slot, optics, at, direction, light, none)
        color = matt_light(scene, slot, lamps, beams, optics, pose, at, s, light)
        return through_air(color, light.air_rgb, light.extinction, t)

    return far_light


@cache
def second_light_kernel(
    build: KernelOptions, features: Features = NONE, detailed: bool = False
) -> wp.Kernel:
    """The kernel, compiled as ``build`` says for worlds with such ``features``; ``detailed``: for
    rays that have met faces with details."""
    looks = features.looks
    aim_of = aim_function(features)
    far_light = _far_light(features, detailed)

    @wp.kernel(**build.arguments())
    def second_light_kernel(
        # model
        scene: RayScene,
        lamps: StreetLamps,
        optics: Optics,
        rays: wp.array2d(dtype=wp.vec3),
        # state in
        lights: wp.array(dtype=SlotLight),
        sky_table: wp.array3d(dtype=wp.vec3),
        poses: wp.array(dtype=SlotPose),
        beams: wp.array2d(dtype=LampBeams),
        hits: SecondHits,
        # args
        first_slot: wp.int32,
        # out
        seen: PixelsSeen,
    ):
        """Shade what was met; the launch may be shorter than the list."""
        count = seen.listed_count[0]
        if wp.static(looks):
            count = hits.plain_count[0]
            if wp.static(detailed):
                count = hits.detailed_count[0]
        while True:
            if wp.static(detailed):
                place = next_of_list(hits.detailed_count)
            else:
                place = next_of_list(hits.plain_count)
            if list_is_done(place, count):
                break
            if place >= count:
                continue
            if wp.static(looks):
                if wp.static(detailed):
                    place = hits.detailed[place]
                else:
                    place = hits.plain[place]
            if hits.face[place] == LEFT:
                continue
            thread = seen.listed[place]
            pixel = pixel_of(thread, first_slot, optics)
            slot = pixel.slot
            light = lights[slot]
            pose = poses[slot]
            ray = rays[pixel.row, pixel.column]
            direction = of_axes(ray, pose.right, pose.down, pose.ahead)
            aim = aim_of(scene, slot, optics, seen, thread, pose, direction, light)
            color = wp.vec3(0.0, 0.0, 0.0)
            if aim.mirror > 0.0:
                at = met_at(scene, slot, aim, hits, place, light)
                far = aim.mirror * far_light(
                    scene,
                    slot,
                    lamps,
                    beams,
                    optics,
                    pose,
                    at,
                    aim.ahead,
                    hits.t[place],
                    light,
                    sky_table,
                )
                if wp.static(looks):
                    far = wp.cw_mul(far, aim.tint)
                color += far
                if aim.clear > 0.0:
                    dark = wp.cw_mul(CABIN, light.sky_rgb) * PI_INVERSE
                    color += aim.clear * (1.0 - aim.mirror) * dark
            for k in range(3):
                seen.second[thread, k] = wp.float16(wp.min(color[k], HALF_MAX))
            seen.flags[thread] = seen.flags[thread] | MIRRORED

    return second_light_kernel
