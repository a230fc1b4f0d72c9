"""The render kernel: one thread per pixel, rays against one mesh that all slots share.

Threads run over (slot, 8x4 tile of pixels): a GPU warp is one tile, and a CPU core stays in the
same part of the BVH.
"""

from __future__ import annotations

import warp as wp

from twin.render.air import sky_path, through_air
from twin.render.geometry import Scene, occluded
from twin.render.geometry import trace as trace_ray
from twin.render.lamps import (
    SODIUM,
    WARM_WHITE,
    StreetLamps,
    headlamp_glow,
    headlamp_lux,
    street_lamp_lux,
)
from twin.render.light import SlotLight
from twin.render.noise import draw, normal
from twin.render.precipitation import cover
from twin.render.sky import sky, smooth_sky
from twin.render.surface import surface_at
from twin.render.tone import tone
from twin.world import materials

wp.set_module_options({"enable_backward": False, "fast_math": False})

TILE_COLUMNS, TILE_ROWS = 8, 4
_TILE_COLUMNS = wp.constant(TILE_COLUMNS)
_TILE_ROWS = wp.constant(TILE_ROWS)
_TILE = wp.constant(TILE_COLUMNS * TILE_ROWS)
_FOLIAGE = wp.constant(materials.FOLIAGE)

RANGE_MAX_M = wp.constant(1200.0)
"""Longest camera ray [m]."""

# Signal of a white surface in electrons, and read noise relative to it.
_FULL_WELL = wp.constant(7000.0)
_READ_NOISE = wp.constant(1.2e-3)

BOX_FIELDS = 6
"""Columns of the box accumulator: x min, y min, x max, y max, pixels, nearest distance [0.1 mm]."""


@wp.struct
class Optics:
    """The camera, in the vehicle frame."""

    width: wp.int32
    """[px]"""
    height: wp.int32
    """[px]"""
    tangent: wp.float32
    """Half the image width over the focal length [-]."""
    mount: wp.vec3
    """Position of the camera, x forward of the rear axle, y left, z up [m]."""
    lamps: wp.vec3
    """Middle of the headlamps, same axes [m]."""


@wp.struct
class SlotPose:
    """Pose of a slot's ego: rear axle on the ground."""

    position: wp.vec3
    """[m]"""
    forward: wp.vec3
    left: wp.vec3


@wp.func
def _reflected(
    scene: Scene,
    slot: wp.int32,
    p: wp.vec3,
    direction: wp.vec3,
    light: SlotLight,
    table: wp.array3d(dtype=wp.vec3),
) -> wp.vec3:
    """Luminance that a wet road mirrors: one ray, flat colours."""
    hit = trace_ray(scene, slot, p, direction, 150.0)
    if not hit.found:
        return smooth_sky(direction, slot, light, table)
    color = scene.faces[hit.face].color
    lit = wp.cw_mul(color, light.sky_rgb) * 0.12
    return through_air(lit, light.air_rgb, light.extinction, hit.t)


@wp.func
def _irradiance(
    scene: Scene,
    slot: wp.int32,
    lamps: StreetLamps,
    optics: Optics,
    pose: SlotPose,
    p: wp.vec3,
    n: wp.vec3,
    retro: wp.float32,
    light: SlotLight,
) -> wp.vec3:
    """Light falling on a point: sky, sun unless shadowed, street lamps, the ego's lamps [lx]."""
    upward = 0.5 + 0.5 * n[2]
    total = light.sky_rgb * (0.78 * upward * upward + 0.05)
    total += light.sun_rgb * (0.06 * (1.0 - upward))  # sun bounced off the ground
    facing = wp.dot(n, light.sun_direction)
    if light.shadows != 0 and facing > 0.0:
        start = p + n * 0.02
        if not occluded(scene, slot, start, light.sun_direction, 400.0):
            total += light.sun_rgb * facing
    if light.lamps_on > 0.0:
        total += SODIUM * street_lamp_lux(p, n, lamps)
    if light.low_beam + light.high_beam + light.fog_lamp > 0.0:
        ray = p - pose.position
        x = wp.dot(ray, pose.forward)
        y = wp.dot(ray, pose.left)
        local = wp.vec3(x, y, ray[2]) - optics.lamps
        to_lamp = wp.normalize(
            pose.forward * -local[0] + pose.left * -local[1] + wp.vec3(0.0, 0.0, -local[2])
        )
        total += WARM_WHITE * (retro * headlamp_lux(local, wp.dot(to_lamp, n), light))
    return total


@wp.func
def _to_vehicle(v: wp.vec3, pose: SlotPose) -> wp.vec3:
    return wp.vec3(wp.dot(v, pose.forward), wp.dot(v, pose.left), v[2])


@wp.kernel
def place_kernel(
    # state in
    pose_m: wp.array2d(dtype=wp.float64),
    # out
    pose_out: wp.array(dtype=SlotPose),
):
    """Ego pose [S, 3] (x, y [m], yaw [rad]) -> axes for the rays."""
    slot = wp.tid()
    pose = SlotPose()
    c = wp.float32(wp.cos(pose_m[slot, 2]))
    s = wp.float32(wp.sin(pose_m[slot, 2]))
    pose.position = wp.vec3(wp.float32(pose_m[slot, 0]), wp.float32(pose_m[slot, 1]), 0.0)
    pose.forward = wp.vec3(c, s, 0.0)
    pose.left = wp.vec3(-s, c, 0.0)
    pose_out[slot] = pose


@wp.kernel
def camera_kernel(
    # model
    scene: Scene,
    lamps: StreetLamps,
    optics: Optics,
    table: wp.array(dtype=wp.uint8),
    # state in
    lights: wp.array(dtype=SlotLight),
    sky_table: wp.array3d(dtype=wp.vec3),
    poses: wp.array(dtype=SlotPose),
    # out
    image_out: wp.array4d(dtype=wp.uint8),
    boxes_out: wp.array3d(dtype=wp.int32),
):
    """Render image [S, H, W, 3] and gather the pixels of every instance in boxes [S, I, 6]."""
    thread = wp.tid()
    tiles_x = (optics.width + _TILE_COLUMNS - 1) / _TILE_COLUMNS
    tiles_y = (optics.height + _TILE_ROWS - 1) / _TILE_ROWS
    tile = thread / _TILE
    inside = thread - tile * _TILE
    slot = tile / (tiles_x * tiles_y)
    tile = tile - slot * tiles_x * tiles_y
    row = tile / tiles_x * _TILE_ROWS + inside / _TILE_COLUMNS
    column = (tile - tile / tiles_x * tiles_x) * _TILE_COLUMNS + inside % _TILE_COLUMNS
    if row >= optics.height or column >= optics.width:
        return
    light = lights[slot]
    if light.active == 0:
        return
    pose = poses[slot]

    # Camera frame: x right, y down, z forward, square pixels.
    scale = 2.0 * optics.tangent / wp.float32(optics.width)
    right = (wp.float32(column) + 0.5 - 0.5 * wp.float32(optics.width)) * scale
    down = (wp.float32(row) + 0.5 - 0.5 * wp.float32(optics.height)) * scale
    direction = wp.normalize(pose.forward - pose.left * right + wp.vec3(0.0, 0.0, -down))
    mount = optics.mount
    eye = pose.position + pose.forward * mount[0] + pose.left * mount[1]
    eye += wp.vec3(0.0, 0.0, mount[2])

    color = wp.vec3(0.0, 0.0, 0.0)
    distance = float(RANGE_MAX_M)
    hit = trace_ray(scene, slot, eye, direction, RANGE_MAX_M)
    if hit.found:
        distance = hit.t
        face = scene.faces[hit.face]
        if hit.instance >= 0:
            i = hit.instance
            wp.atomic_min(boxes_out, slot, i, 0, column)
            wp.atomic_min(boxes_out, slot, i, 1, row)
            wp.atomic_max(boxes_out, slot, i, 2, column)
            wp.atomic_max(boxes_out, slot, i, 3, row)
            wp.atomic_add(boxes_out, slot, i, 4, 1)
            wp.atomic_min(boxes_out, slot, i, 5, wp.int32(distance * 10000.0))
        n = hit.normal
        p = eye + direction * distance
        s = surface_at(face, p, n, distance, light)
        if face.material == _FOLIAGE:  # leaves face every way
            n = wp.normalize(n + s.ruffle)
        lux = _irradiance(scene, slot, lamps, optics, pose, p, n, s.retro, light)
        color = wp.cw_mul(s.albedo, lux) * 0.31830989 + s.emission
        if s.mirror > 0.0:
            cosine = -wp.dot(n, direction)
            grazing = 1.0 - wp.min(1.0, cosine)
            square = grazing * grazing
            fresnel = (
                s.mirror + (wp.min(1.0, s.mirror * 25.0) - s.mirror) * square * square * grazing
            )
            bounce = direction + n * (2.0 * cosine)
            if light.wetness > 0.5 and n[2] > 0.9 and p[2] < 0.3:
                color += _reflected(scene, slot, p + n * 0.02, bounce, light, sky_table) * fresnel
            elif bounce[2] > 0.0:
                color += smooth_sky(bounce, slot, light, sky_table) * fresnel
            else:
                color += light.sky_rgb * (0.03 * fresnel)
        color = through_air(color, light.air_rgb, light.extinction, distance)
    else:
        color = sky(direction, slot, light, sky_table)
        path = sky_path(light.extinction, direction[2])
        color = through_air(color, light.air_rgb, light.extinction, path)
    from_lamps = mount - optics.lamps
    glow = headlamp_glow(from_lamps, _to_vehicle(direction, pose), distance, light)
    color += WARM_WHITE * glow
    if light.rain + light.snow > 0.0:
        height = wp.float32(optics.height)
        hidden = cover(wp.float32(column) / height, wp.float32(row) / height, light)
        # Drops and flakes are as bright as the air, and at night as what the lamps light up.
        flake = wp.max(light.air_rgb * 1.25 + WARM_WHITE * (glow * 3.0), color)
        color = color * (1.0 - hidden) + flake * hidden

    signal = color * light.exposure
    pixel = (row * optics.width + column) * 3
    for channel in range(3):
        x = signal[channel]
        if light.noise != 0:
            sigma = wp.sqrt(wp.max(x, 0.0) / _FULL_WELL + _READ_NOISE * _READ_NOISE)
            x += sigma * normal(draw(light.key, light.tick, pixel + channel))
        image_out[slot, row, column, channel] = tone(x, table)
