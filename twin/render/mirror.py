"""Second rays: what smooth surfaces mirror, and what is seen through glass.

A kernel of its own between visibility and shading, over a list of the few pixels that need it: the
threads of a warp are all busy, and the other pixels are not held up.
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
from twin.render.light.second_light import CABIN, HALF_MAX
from twin.render.light.sky import smooth_sky, sun_through_clouds
from twin.render.look_pixels import kept_albedo, with_kept_look
from twin.render.look_surface import (
    LookPoint,
    bent_normal,
    bounced,
    look_ruffle,
    smooth_point,
    with_look,
)
from twin.render.shading import (
    PI_INVERSE,
    ShadedPoint,
    fresnel_of,
    look_of,
    place_of,
    surface_functions,
)
from twin.render.trace.geometry import RayHit, RayScene, rays_of
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.second_hits import RANGE_M, SHELL_M, rippled
from twin.render.trace.visibility import DETAILED, MIRRORED, PixelsSeen, pixel_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

STRIDE = 1 << 17
"""Threads of a launch on a GPU at most: about two to every place for one."""


@cache
def _light_functions(features: Features, shell_first: bool) -> tuple[Any, Any]:
    """``surface_of`` and ``far_light`` for worlds with such ``features``.

    ``shell_first``: as of :class:`twin.render.build.KernelOptions`.
    """
    looks = features.looks
    trace, occluded = rays_of(features)
    surface_of, matt_light = surface_functions(features)
    far_surface_of = surface_functions(features, 1)[0] if looks else surface_of

    @wp.func
    def far_light(
        scene: RayScene,
        slot: wp.int32,
        lamps: StreetLamps,
        beams: wp.array2d(dtype=LampBeams),
        optics: Optics,
        pose: SlotPose,
        start: wp.vec3,
        direction: wp.vec3,
        before: wp.float32,
        glass: wp.bool,
        light: SlotLight,
        table: wp.array3d(dtype=wp.vec3),
    ) -> wp.vec3:
        """What comes along a ray that is mirrored, or passes ``glass`` [cd/m^2].

        ``before``: length of the way to its start [m].
        """
        if wp.static(shell_first):
            hit = RayHit()
            reach = wp.where(glass, SHELL_M, RANGE_M)
            while reach > 0.0:
                hit = trace(scene, slot, start, direction, 0.0, reach)
                reach = wp.where(hit.found or reach == RANGE_M, 0.0, RANGE_M)
        else:
            hit = trace(scene, slot, start, direction, 0.0, RANGE_M)
        if not hit.found:
            return smooth_sky(direction, slot, light, table)
        if glass and hit.t < SHELL_M:
            return wp.cw_mul(CABIN, light.sky_rgb) * PI_INVERSE
        at = ShadedPoint()
        at.p = ahead_of(start, direction, hit.t)
        at.n = hit.normal
        at.face = hit.face
        at.object = hit.object
        at.u = hit.u
        at.v = hit.v
        at.distance = before + hit.t
        facing = at.n
        place = at.p
        own = LookPoint()
        ruffle = wp.vec3(0.0, 0.0, 0.0)
        if wp.static(looks):
            detailed = scene.faces[at.face].uv_per_m < 0.0
            if detailed:
                smooth = smooth_point(scene, slot, at.face, at.object, at.u, at.v, at.n)
                facing = smooth.n
                place = place + smooth.lift
        if light.shadows != 0 and dot(facing, light.sun_direction) > 0.0:
            dark = occluded(scene, slot, place + at.n * 0.02, light.sun_direction, RANGE_M)
            at.lit = wp.where(dark, 0.0, sun_through_clouds(at.p, light))
        if wp.static(looks):  # noqa: SIM102 (resolved before the kernel is compiled)
            if detailed:  # after the ray to the sun, which would hold all of it in registers
                own = look_of(scene, optics, at, direction)
                ruffle = look_ruffle(
                    scene,
                    slot,
                    at.face,
                    at.object,
                    at.n,
                    facing,
                    at.u,
                    at.v,
                    own.bump,
                    direction,
                )
        s = far_surface_of(scene, slot, optics, at, direction, light, own.albedo)
        if wp.static(looks):  # noqa: SIM102 (resolved before the kernel is compiled)
            if detailed:
                s = with_look(s, own, ruffle, at.n, light)
        color = matt_light(scene, slot, lamps, beams, optics, pose, at, s, light)
        return through_air(color, light.air_rgb, light.extinction, hit.t)

    return surface_of, far_light


@cache
def mirror_kernel(build: KernelOptions, features: Features = NONE) -> wp.Kernel:
    """The kernel, compiled as ``build`` says for worlds with such ``features``.

    What it does to a pixel stands in the kernel itself: a function of this size is not inlined, and
    a call copies the whole scene's handle.
    """
    looks = features.looks
    surface_of, far_light = _light_functions(features, build.shell_first)

    @wp.kernel(**build.arguments())
    def second_kernel(
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
        # args
        first_slot: wp.int32,
        stride: wp.int32,
        # out
        seen: PixelsSeen,
    ):
        """Follow second rays of the pixels on the list; the launch may be shorter than it."""
        at_list = wp.tid()
        while at_list < seen.listed_count[0]:
            thread = seen.listed[at_list]
            at_list += stride
            pixel = pixel_of(thread, first_slot, optics)
            slot = pixel.slot
            light = lights[slot]
            pose = poses[slot]
            ray = rays[pixel.row, pixel.column]
            direction = of_axes(ray, pose.right, pose.down, pose.ahead)
            at = place_of(scene, slot, seen, thread, pose.eye, direction)
            color = wp.vec3(0.0, 0.0, 0.0)
            own = wp.vec4(0.0, 0.0, 0.0, 0.0)
            if wp.static(looks):
                flags = seen.flags[thread]
                if (flags & DETAILED) != 0:
                    own = kept_albedo(seen.look, thread)
            albedo = wp.vec3(own[0], own[1], own[2])
            s = surface_of(scene, slot, optics, at, direction, light, albedo)
            if wp.static(looks):
                s = with_kept_look(s, seen.look, thread, flags, own[3], at.n, light)
            if s.mirror > 0.0:
                n = rippled(at.n, at.p, light.wetness)
                if wp.static(looks):
                    n = bent_normal(n, s)
                cosine = wp.clamp(-dot(n, direction), 0.0, 1.0)
                fresnel = fresnel_of(s.mirror, cosine)  # Schlick (1994)
                # One loop over both rays, so that the code of a ray stands there once.
                count = wp.int32(1)
                if s.clear > 0.0:
                    count = 2
                ahead = direction + n * (2.0 * cosine)
                if wp.static(looks):
                    ahead = bounced(direction, n, at.n)
                start = ahead_of(at.p, at.n, 0.02)
                weight = fresnel
                glass = wp.bool(False)
                for i in range(count):
                    if i == 1:
                        ahead = direction
                        start = at.p - at.n * 0.004
                        weight = s.clear * (1.0 - fresnel)
                        glass = True
                    far = weight * far_light(
                        scene,
                        slot,
                        lamps,
                        beams,
                        optics,
                        pose,
                        start,
                        ahead,
                        at.distance,
                        glass,
                        light,
                        sky_table,
                    )
                    if wp.static(looks):
                        far = wp.cw_mul(far, wp.where(glass, wp.vec3(1.0, 1.0, 1.0), s.tint))
                    color += far
            for k in range(3):
                seen.second[thread, k] = wp.float16(wp.min(color[k], HALF_MAX))
            seen.flags[thread] = seen.flags[thread] | MIRRORED

    return second_kernel
