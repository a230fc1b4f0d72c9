"""Ghosts: bodies that the radar sees once more by a wall or a guard rail beside it.

An upright smooth face mirrors a body at the image point behind it. The signal may go to the body
and back by the wall (an echo from the image), or by the wall one way only (two echoes at the mean
of both ways, one from the image's direction, one from the body's). Each reflection costs the face's
reflectance. Few rays look for one face on each side of the radar; others are left out.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from twin.render.build import Features
from twin.render.trace.geometry import RayScene, rays_of
from twin.sensors.radar.bodies import TEMPLATE_ROWS, Scatterer
from twin.sensors.radar.cross_section import cross_section
from twin.sensors.radar.echo import (
    FAINT,
    RadarEcho,
    RadarModel,
    RadarPose,
    RadarSlot,
    echo_of,
    phasor,
    power_of,
)
from twin.sensors.radar.scatter import BodyPoint, point_of_body, point_that_stands

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SIDES, ECHOES = 2, 3
"""Faces of a slot, left and right; and echoes by one of them."""
PROBES = 12
"""Rays that look for faces."""

_SIDES, _ECHOES, _PROBES = (wp.constant(n) for n in (SIDES, ECHOES, PROBES))
_ROWS = wp.constant(TEMPLATE_ROWS)
_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_FAR_M = wp.constant(100.0)
_TURNS = wp.constant(wp.float64(0.21))
_UPRIGHT = wp.constant(0.3)
_BESIDE = wp.constant(wp.float64(0.7))
_NEAR_M = wp.constant(wp.float64(0.2))
_SKIN_M = wp.constant(0.2)


@wp.struct
class RadarWall:
    """An upright face that mirrors; reflectance 0: there is none."""

    normal: wp.vec3d
    """Level, towards the radar."""
    away: wp.float64
    """Of the radar from it [m]."""
    reflectance: wp.float64
    """Of power [-]."""


@wp.func
def _as_float(v: wp.vec3d) -> wp.vec3:
    return wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))


@cache
def wall_kernel_of(features: Features) -> wp.Kernel:
    """The kernel that looks for faces in worlds with such ``features``."""
    trace, _ = rays_of(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def wall_kernel(
        # model
        scene: RayScene,
        parked: wp.int32,
        surface: wp.array(dtype=wp.vec4d),
        # state in
        slots: wp.array(dtype=RadarSlot),
        poses: wp.array(dtype=RadarPose),
        # out
        walls_out: wp.array2d(dtype=RadarWall),
    ):
        """The nearest face to the left and to the right of each radar [S, 2]."""
        slot = wp.tid()
        state = slots[slot]
        if state.active == 0:
            return
        pose = poses[slot]
        left = RadarWall()
        right = RadarWall()
        if state.multipath != 0:
            for probe in range(_PROBES):
                # From straight to the left to straight to the right, closer together ahead.
                share = (wp.float64(probe) + _HALF) / wp.float64(_PROBES) * _TWO - _ONE
                at = phasor(_TURNS * share * wp.abs(share))
                level = wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), _ZERO)
                ray = _as_float(pose.rotation * level)
                hit = trace(scene, slot, _as_float(pose.origin), ray, 0.0, _FAR_M)
                stands = hit.instance < 0 or hit.instance >= parked
                if hit.found and hit.object < 0 and stands and wp.abs(hit.normal[2]) < _UPRIGHT:
                    row = surface[wp.min(scene.faces[hit.face].material, surface.shape[0] - 1)]
                    facing = wp.vec3d(wp.float64(hit.normal[0]), wp.float64(hit.normal[1]), _ZERO)
                    facing = facing / wp.length(facing)
                    own = wp.transpose(pose.rotation) * facing
                    wall = RadarWall()
                    wall.normal = facing
                    along = wp.vec3d(wp.float64(ray[0]), wp.float64(ray[1]), _ZERO)
                    wall.away = -wp.dot(facing, along) * wp.float64(hit.t)
                    wall.reflectance = row[1]
                    good = row[1] > _ZERO and wall.away > _NEAR_M and wp.abs(own[0]) < _BESIDE
                    on_left = own[1] < _ZERO
                    to_left = left.reflectance <= _ZERO or wall.away < left.away
                    to_right = right.reflectance <= _ZERO or wall.away < right.away
                    if good and on_left and to_left:
                        left = wall
                    if good and not on_left and to_right:
                        right = wall
        walls_out[slot, 0] = left
        walls_out[slot, 1] = right

    return wall_kernel


@cache
def ghost_kernel_of(features: Features) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    _, occluded = rays_of(features)

    @wp.func
    def free(
        scene: RayScene, slot: wp.int32, start: wp.vec3d, end: wp.vec3d, skin: wp.float32
    ) -> wp.bool:
        """Whether nothing stands between two points, up to ``skin`` [m] before the end."""
        way = end - start
        distance = wp.length(way)
        ray = _as_float(way / distance)
        return not occluded(scene, slot, _as_float(start), ray, wp.float32(distance) - skin)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def ghost_kernel(
        # model
        model: RadarModel,
        scene: RayScene,
        templates: wp.array2d(dtype=Scatterer),
        standing: wp.array(dtype=Scatterer),
        classes: wp.array(dtype=wp.int32),
        # state in
        slots: wp.array(dtype=RadarSlot),
        poses: wp.array(dtype=RadarPose),
        walls: wp.array2d(dtype=RadarWall),
        # args
        reflectors: wp.int32,
        first: wp.int32,
        # out
        echoes_out: wp.array2d(dtype=RadarEcho),
    ):
        """Echoes by walls [S, first + points x 2 x 3], of the last ``reflectors`` of what stands,
        then of every movable object; threads over (slot, point, side)."""
        slot, number, side = wp.tid()
        state = slots[slot]
        if state.active == 0:
            return
        place = first + (number * _SIDES + side) * _ECHOES
        nothing = RadarEcho()
        for k in range(_ECHOES):
            echoes_out[slot, place + k] = nothing
        wall = walls[slot, side]
        if wall.reflectance <= _ZERO:
            return
        pose = poses[slot]
        item = Scatterer()
        body = BodyPoint()
        if number < reflectors:
            item = standing[standing.shape[0] - reflectors + number]
            body = point_that_stands(item, pose.ground)
        else:
            m = (number - reflectors) / _ROWS
            thing = scene.objects[slot, m]
            if thing.root == 0 or thing.half[0] <= 0.0:
                return
            item = templates[classes[thing.instance], number - reflectors - m * _ROWS]
            if item.shape < 0:
                return
            body = point_of_body(item, thing)
        origin = pose.origin
        direct = body.at - origin
        beyond = wall.away + wp.dot(wall.normal, direct)
        if beyond < _NEAR_M:
            return
        image = direct - _TWO * beyond * wall.normal
        far = wp.length(image)
        near = wp.length(direct)
        unit = image / far
        mirror = origin + image * (wall.away / (wall.away + beyond))
        back = mirror - body.at
        by_wall = cross_section(
            item.shape, item.size, body.normal, back / wp.length(back), far, model.wavelength
        )
        turned = wp.transpose(pose.rotation)
        at = turned * image
        double = power_of(model, state, at, by_wall) * wall.reflectance * wall.reflectance
        straight = cross_section(
            item.shape, item.size, body.normal, -direct / near, near, model.wavelength
        )
        single = power_of(model, state, at, by_wall)
        single = single * power_of(model, state, turned * direct, straight)
        single = wp.sqrt(single) * wall.reflectance
        if wp.float32(double) <= FAINT and wp.float32(single) <= FAINT:
            return
        # The face is where the way meets it, and both legs are free.
        if free(scene, slot, origin, mirror, -_SKIN_M):
            return
        if not free(scene, slot, origin, mirror, _SKIN_M):
            return
        if not free(scene, slot, mirror + _NEAR_M * wall.normal, body.at, body.skin):
            return
        mirrored = body.velocity - _TWO * wp.dot(wall.normal, body.velocity) * wall.normal
        by_image = wp.dot(mirrored - pose.velocity, unit)
        if wp.float32(double) > FAINT:
            echoes_out[slot, place] = echo_of(model, double, at, by_image, _ZERO)
        if wp.float32(single) > FAINT and free(scene, slot, origin, body.at, body.skin):
            by_body = wp.dot(body.velocity - pose.velocity, direct / near)
            speed = _HALF * (by_image + by_body)
            middle = _HALF * (far + near)
            ahead = turned * (direct / near) * middle
            echoes_out[slot, place + 1] = echo_of(model, single, ahead, speed, _HALF)
            beside = at / far * middle
            echoes_out[slot, place + 2] = echo_of(model, single, beside, speed, _HALF)

    return ghost_kernel
