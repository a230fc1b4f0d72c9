"""The shading kernel: from what the pixels see to a picture and whatever else is asked for."""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from twin.base.portable.quick import dot, of_axes, reciprocal
from twin.render.boxes import gather_box
from twin.render.build import NONE, Features, KernelOptions
from twin.render.flow import PosesBefore, Projection, flow_at
from twin.render.light.air import sky_path, through_air
from twin.render.light.lamps import WARM_WHITE, LampBeams, StreetLamps, headlamp_glow, lamps_glow
from twin.render.light.light import SlotLight
from twin.render.light.precipitation import cover
from twin.render.light.sky import sky, smooth_sky, sun_through_clouds
from twin.render.look_pixels import kept_albedo, with_kept_look
from twin.render.look_surface import bent_normal, bounced
from twin.render.outputs import Buffers, Wanted
from twin.render.sensor_noise import sensor_noise
from twin.render.shading import ShadedPoint, fresnel_of, place_of, surface_functions
from twin.render.surface import SurfacePoint
from twin.render.tile_tone import Signals, tone_tile
from twin.render.tone import tone
from twin.render.trace.geometry import DECAL_TAG, RayScene
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.visibility import (
    DETAILED,
    MIRRORED,
    OUTSIDE,
    TILE_COLUMNS,
    TILE_ROWS,
    PixelsSeen,
    pixel_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PARTS = ("surface", "sky", "air", "tone")
"""Parts of the kernel that can be left out."""
_HALF_MAX = wp.constant(60000.0)
_TILE_COLUMNS = wp.constant(TILE_COLUMNS)


@wp.func
def air_light(
    color: wp.vec3,
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
    lamps: StreetLamps,
    beams: wp.array2d(dtype=LampBeams),
    optics: Optics,
    pose: SlotPose,
    direction: wp.vec3,
    distance: wp.float32,
    light: SlotLight,
) -> wp.vec3:
    """What lamps light up in the air before the surface, and drops and flakes."""
    from_lamps = optics.mount - optics.lamps
    ahead = wp.vec3(
        dot(direction, pose.forward), dot(direction, pose.left), dot(direction, pose.up)
    )
    glow = headlamp_glow(from_lamps, ahead, distance, light)
    total = color + WARM_WHITE * glow
    total += lamps_glow(pose.eye, direction, distance, slot, lamps, beams, light)
    if light.rain + light.snow > 0.0:
        share = reciprocal(wp.float32(optics.height))
        u, v = wp.float32(column) * share, wp.float32(row) * share
        hidden = cover(u, v, pose.right, light)
        # Drops and flakes are as bright as the air, and at night as what the lamps light up.
        flake = wp.max(light.air_rgb * 1.25 + WARM_WHITE * (glow * 3.0), total)
        total = total * (1.0 - hidden) + flake * hidden
    return total


@wp.func
def sky_share(bounce: wp.vec3) -> wp.float32:
    """Share of the sky that is seen along a mirrored ray whose surroundings are not traced [-].

    A street hides the sky near the horizon: nothing is left below it, all from 50 deg on.
    """
    return wp.clamp(bounce[2] * 1.3 + 0.05, 0.0, 1.0)


@wp.func
def _instance_of(scene: RayScene, slot: wp.int32, at: ShadedPoint) -> wp.int32:
    instance = wp.int32(-1)
    if at.object >= 0:
        if scene.faces[at.face].tag != DECAL_TAG:
            instance = scene.objects[slot, at.object].instance
    elif at.face >= 0:
        instance = scene.faces[at.face].instance
    return instance


@wp.func
def _semantic_of(scene: RayScene, at: ShadedPoint) -> wp.uint8:
    kind = wp.int32(0)
    if at.face >= 0:
        kind = scene.faces[at.face].semantic
    return wp.uint8(kind)


@wp.func
def _facing(at: ShadedPoint, pose: SlotPose) -> wp.vec3:
    """Normal of what is seen in the camera's axes; zero where nothing is seen."""
    n = wp.vec3(0.0, 0.0, 0.0)
    if at.face >= 0:
        n = wp.vec3(dot(at.n, pose.right), dot(at.n, pose.down), dot(at.n, pose.ahead))
    return n


@cache
def _mirrored_sky(features: Features) -> Any:
    """The function of what a place mirrors whose second rays are not followed [cd/m^2]."""
    looks = features.looks

    @wp.func
    def mirrored_sky(
        at: ShadedPoint,
        s: SurfacePoint,
        direction: wp.vec3,
        slot: wp.int32,
        light: SlotLight,
        sky_table: wp.array3d(dtype=wp.vec3),
    ) -> wp.vec3:
        cosine = wp.clamp(-dot(at.n, direction), 0.0, 1.0)
        bounce = direction + at.n * (2.0 * cosine)
        if wp.static(looks):
            n = bent_normal(at.n, s)
            cosine = wp.clamp(-dot(n, direction), 0.0, 1.0)
            bounce = bounced(direction, n, at.n)
        back = smooth_sky(bounce, slot, light, sky_table)
        if wp.static(looks):
            back = wp.cw_mul(back, s.tint)
        return back * (fresnel_of(s.mirror, cosine) * sky_share(bounce))

    return mirrored_sky


@cache
def picture_kernel(
    wanted: Wanted,
    build: KernelOptions,
    without: frozenset[str] = frozenset(),
    features: Features = NONE,
) -> wp.Kernel:
    """The kernel that writes what is ``wanted`` of worlds with such ``features``; compiled once for
    every set.

    ``without``: parts of :data:`PARTS` that are left out to see what they cost.
    """
    pixels = build.pixels
    surfaces, skies = "surface" not in without, "sky" not in without
    second, looks = wanted.second, features.looks
    lamp_air, tones_on = "air" not in without, "tone" not in without
    hdr, depth, instance = wanted.hdr, wanted.depth, wanted.instance
    # A thread that has a whole tile makes bytes of all its pixels at once.
    tiles = tones_on and not hdr and pixels == TILE_COLUMNS * TILE_ROWS
    semantic, normal, flow = wanted.semantic, wanted.normal, wanted.flow
    surface_of, matt_light = surface_functions(features)
    mirrored_sky = _mirrored_sky(features)

    @wp.kernel(**build.arguments())
    def camera_kernel(
        # model
        scene: RayScene,
        lamps: StreetLamps,
        optics: Optics,
        lens: Projection,
        rays: wp.array2d(dtype=wp.vec3),
        tones: wp.array(dtype=wp.uint8),
        # state in
        lights: wp.array(dtype=SlotLight),
        sky_table: wp.array3d(dtype=wp.vec3),
        poses: wp.array(dtype=SlotPose),
        before: PosesBefore,
        beams: wp.array2d(dtype=LampBeams),
        seen: PixelsSeen,
        # args
        first_slot: wp.int32,
        # out
        out: Buffers,
    ):
        """Shade the slots from ``first_slot`` on."""
        first = wp.tid() * wp.static(pixels)
        corner = pixel_of(first, first_slot, optics)
        if not corner.inside:  # nor is what follows in its tile
            return
        slot = corner.slot
        light = lights[slot]  # what all pixels of a thread share is read once
        if light.active == 0:
            return
        pose = poses[slot]
        if wp.static(tiles):
            signals = Signals()
        place = wp.int32(0)
        while place < wp.static(pixels):
            thread = first + place
            row = corner.row + place / _TILE_COLUMNS
            column = corner.column + place % _TILE_COLUMNS
            place += 1
            if row >= optics.height or column >= optics.width:
                continue
            ray = rays[row, column]
            direction = of_axes(ray, pose.right, pose.down, pose.ahead)
            at = place_of(scene, slot, seen, thread, pose.eye, direction)
            tag = _instance_of(scene, slot, at)
            if tag >= 0:
                gather_box(out.boxes, slot, tag, row, column, wp.int32(at.distance * 10000.0))
            if wp.static(depth):
                out.depth[slot, row, column] = wp.where(at.face >= 0, at.distance * ray[2], wp.inf)
            if wp.static(instance):
                out.instance[slot, row, column] = tag
            if wp.static(semantic):
                out.semantic[slot, row, column] = _semantic_of(scene, at)
            if wp.static(normal):
                facing = _facing(at, pose)
                for k in range(3):
                    out.normal[slot, row, column, k] = facing[k]
            if wp.static(flow):
                way = wp.vec2(0.0, 0.0)
                if at.face != OUTSIDE:
                    way = flow_at(scene, slot, at, lens, row, column, direction, pose, before)
                out.flow[slot, row, column, 0] = way[0]
                out.flow[slot, row, column, 1] = way[1]
            color = wp.vec3(0.0, 0.0, 0.0)
            if at.face != OUTSIDE:
                far = optics.far
                if at.face >= 0:
                    far = at.distance
                    if at.lit > 0.0:
                        at.lit = sun_through_clouds(at.p, light)
                    s = SurfacePoint()
                    if wp.static(surfaces):
                        # The rest of what a material says waits in memory meanwhile.
                        own = wp.vec4(0.0, 0.0, 0.0, 0.0)
                        if wp.static(looks):
                            flags = seen.flags[thread]
                            if (flags & DETAILED) != 0:
                                own = kept_albedo(seen.look, thread)
                        albedo = wp.vec3(own[0], own[1], own[2])
                        s = surface_of(scene, slot, optics, at, direction, light, albedo)
                        if wp.static(looks):
                            s = with_kept_look(s, seen.look, thread, flags, own[3], at.n, light)
                        color = matt_light(scene, slot, lamps, beams, optics, pose, at, s, light)
                    followed = wp.bool(False)
                    if wp.static(second):
                        followed = (seen.flags[thread] & MIRRORED) != 0
                    if followed:
                        color = color * (1.0 - 0.8 * wp.min(1.0, s.clear * 2.0)) + wp.vec3(
                            wp.float32(seen.second[thread, 0]),
                            wp.float32(seen.second[thread, 1]),
                            wp.float32(seen.second[thread, 2]),
                        )
                    if s.mirror > 0.0 and not followed:
                        color += mirrored_sky(at, s, direction, slot, light, sky_table)
                    color = through_air(color, light.air_rgb, light.extinction, far)
                else:
                    if wp.static(skies):
                        color = sky(direction, slot, light, sky_table)
                    path = sky_path(light.extinction, direction[2])
                    color = through_air(color, light.air_rgb, light.extinction, path)
                if wp.static(lamp_air):
                    color = air_light(
                        color, slot, row, column, lamps, beams, optics, pose, direction, far, light
                    )
            signal = color * light.exposure
            for channel in range(3):
                x = signal[channel]
                if wp.static(hdr):
                    out.hdr[slot, row, column, channel] = wp.float16(wp.min(x, _HALF_MAX))
                elif wp.static(tiles):
                    signals[(place - 1) * 3 + channel] = x
                else:
                    if light.noise != 0:
                        element = (row * optics.width + column) * 3 + channel
                        x = sensor_noise(x, light.key, light.tick, element)
                    if wp.static(tones_on):
                        out.image[slot, row, column, channel] = tone(x, tones)
                    else:
                        out.image[slot, row, column, channel] = wp.uint8(x)
        if wp.static(tiles):
            tone_tile(out.image, tones, signals, corner, optics, light)

    return camera_kernel
