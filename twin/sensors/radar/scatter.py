"""Echoes of bodies: a thread per bright point of what stands and of what moves.

Whether a point is seen is decided by a ray to it. The road adds a second way to every point: with
the path difference d and the road's reflection coefficient r the field is 1 + r e^{-jkd} out and
back again, so the echo is multiplied by its square (two-ray model). r is Fresnel's for vertical
polarisation and the permittivity of asphalt, 4, or of a film of water, rounded off by a roughness
of s: e^{-2 (k s sin psi)^2} (Ament 1953).
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from twin.base.portable_math import portable_cos, portable_exp, portable_sin
from twin.render.build import Features
from twin.render.trace.geometry import RayScene, rays_of
from twin.sensors.radar.bodies import LIMB, RIM, TEMPLATE_ROWS, Scatterer
from twin.sensors.radar.cross_section import cross_section
from twin.sensors.radar.echo import (
    FAINT,
    RadarEcho,
    RadarModel,
    RadarPose,
    RadarSlot,
    complex_product,
    echo_of,
    phasor,
    power_of,
)
from twin.vehicle.columns import COLUMN

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LIMB, _RIM, _ROWS = (wp.constant(n) for n in (LIMB, RIM, TEMPLATE_ROWS))
_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_TWO_PI = wp.constant(wp.float64(2.0 * math.pi))
_SKIN_M = wp.constant(0.5)
_SKIN_SMALL_M = wp.constant(0.3)
_DRY, _FILM = (wp.constant(wp.float64(e)) for e in (4.0, 15.0))
_ROUGH_M = wp.constant(wp.float64(0.4e-3))

_X, _Y, _Z = (wp.constant(COLUMN[name]) for name in ("x_m", "y_m", "z_m"))
_COM = wp.constant(COLUMN["com_x_m"])
_TURN = wp.constant(COLUMN["orientation_x"])
_VELOCITY = wp.constant(COLUMN["velocity_x_mps"])
_RATE = wp.constant(COLUMN["rate_x_radps"])


@wp.func
def _columns(rows: wp.array2d(dtype=wp.float64), slot: wp.int32, first: wp.int32) -> wp.vec3d:
    return wp.vec3d(rows[slot, first], rows[slot, first + 1], rows[slot, first + 2])


@wp.kernel
def pose_kernel(
    # state in
    slots: wp.array(dtype=RadarSlot),
    vehicles: wp.array2d(dtype=wp.float64),
    # out
    pose_out: wp.array(dtype=RadarPose),
):
    """Where the radars are [S], of vehicle states [S, T]."""
    slot = wp.tid()
    state = slots[slot]
    if state.active == 0:
        return
    turn = wp.quatd(
        vehicles[slot, _TURN],
        vehicles[slot, _TURN + 1],
        vehicles[slot, _TURN + 2],
        vehicles[slot, _TURN + 3],
    )
    reference = wp.vec3d(vehicles[slot, _X], vehicles[slot, _Y], vehicles[slot, _Z])
    pose = RadarPose()
    pose.origin = reference + wp.quat_rotate(turn, state.position)
    pose.ground = reference[2]
    body = wp.quat_to_matrix(turn)
    c = state.yaw[0]
    s = state.yaw[1]
    pose.rotation = body * wp.mat33d(c, -s, _ZERO, s, c, _ZERO, _ZERO, _ZERO, _ONE)
    rate = wp.quat_rotate(turn, _columns(vehicles, slot, _RATE))
    arm = pose.origin - _columns(vehicles, slot, _COM)
    pose.velocity = _columns(vehicles, slot, _VELOCITY) + wp.cross(rate, arm)
    pose_out[slot] = pose


@wp.func
def road_factor(
    state: RadarSlot, wavelength: wp.float64, flat: wp.float64, low: wp.float64, high: wp.float64
) -> wp.vec2:
    """Factor of the field, one way, by the second way over the road; ``flat``: distance along the
    road, ``low`` and ``high``: heights of both ends above it [m]."""
    if low <= _ZERO or high <= _ZERO:
        return wp.vec2(1.0, 0.0)
    total = low + high
    apart = high - low
    longer = wp.sqrt(flat * flat + total * total)
    more = longer - wp.sqrt(flat * flat + apart * apart)
    sine = total / longer
    permittivity = _DRY + (_FILM - _DRY) * state.wetness
    root = wp.sqrt(permittivity - _ONE + sine * sine)
    reflected = (permittivity * sine - root) / (permittivity * sine + root)
    rough = _TWO_PI / wavelength * _ROUGH_M * (_ONE - _HALF * state.wetness) * sine
    reflected = reflected * portable_exp(-_TWO * rough * rough)
    second = phasor(-more / wavelength) * wp.float32(reflected)
    return wp.vec2(1.0 + second[0], second[1])


@cache
def scatter_kernel_of(features: Features) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    _, occluded = rays_of(features)

    @wp.func
    def echo_at(
        model: RadarModel,
        scene: RayScene,
        state: RadarSlot,
        pose: RadarPose,
        slot: wp.int32,
        point: wp.vec3d,
        velocity: wp.vec3d,
        item: Scatterer,
        normal: wp.vec2d,
        skin: wp.float32,
    ) -> RadarEcho:
        """Echo of one scatterer at ``point``; the ray to it ends ``skin`` [m] before."""
        empty = RadarEcho()
        way = point - pose.origin
        distance = wp.length(way)
        if distance < _HALF:
            return empty
        unit = way / distance
        seen = cross_section(item.shape, item.size, normal, -unit, distance, model.wavelength)
        at = wp.transpose(pose.rotation) * way
        power = power_of(model, state, at, seen)
        if wp.float32(power) <= FAINT:
            return empty
        origin = wp.vec3(
            wp.float32(pose.origin[0]), wp.float32(pose.origin[1]), wp.float32(pose.origin[2])
        )
        ahead = wp.vec3(wp.float32(unit[0]), wp.float32(unit[1]), wp.float32(unit[2]))
        if occluded(scene, slot, origin, ahead, wp.float32(distance) - skin):
            return empty
        echo = echo_of(model, power, at, wp.dot(velocity - pose.velocity, unit), _ZERO)
        if state.multipath != 0:
            flat = wp.sqrt(way[0] * way[0] + way[1] * way[1])
            low = pose.origin[2] - pose.ground
            factor = road_factor(state, model.wavelength, flat, low, point[2] - pose.ground)
            factor = complex_product(factor, factor)
            echo.signal = complex_product(echo.signal, factor)
            echo.power = echo.power * wp.dot(factor, factor)
        return echo

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def scatter_kernel(
        # model
        model: RadarModel,
        scene: RayScene,
        templates: wp.array2d(dtype=Scatterer),
        standing: wp.array(dtype=Scatterer),
        classes: wp.array(dtype=wp.int32),
        # state in
        slots: wp.array(dtype=RadarSlot),
        poses: wp.array(dtype=RadarPose),
        # out
        echoes_out: wp.array2d(dtype=RadarEcho),
    ):
        """Echoes of what stands [N], then of every movable object [M x rows]."""
        slot, number = wp.tid()
        state = slots[slot]
        if state.active == 0:
            return
        echo = RadarEcho()
        count = standing.shape[0]
        pose = poses[slot]
        if number < count:
            item = standing[number]
            point = item.at + wp.vec3d(_ZERO, _ZERO, pose.ground)
            velocity = wp.vec3d(item.swing[0], item.swing[1], _ZERO)
            echo = echo_at(
                model, scene, state, pose, slot, point, velocity, item, item.normal, _SKIN_M
            )
        else:
            m = (number - count) / _ROWS
            thing = scene.objects[slot, m]
            if thing.root != 0:
                item = templates[classes[thing.instance], (number - count) - m * _ROWS]
                if item.shape >= 0:
                    c = wp.float64(thing.cosine)
                    s = wp.float64(thing.sine)
                    speed = c * wp.float64(thing.velocity[0]) + s * wp.float64(thing.velocity[1])
                    travelled = c * wp.float64(thing.position[0]) + s * wp.float64(
                        thing.position[1]
                    )
                    along = item.at[0] + item.share[0] * wp.float64(thing.half[0])
                    left = item.at[1] + item.share[1] * wp.float64(thing.half[1])
                    up = item.at[2]
                    faster = _ZERO
                    rising = _ZERO
                    skin = _SKIN_M
                    if item.motion != 0:
                        skin = _SKIN_SMALL_M
                    if item.motion == _LIMB:
                        turns = travelled / item.swing[1] + item.swing[2]
                        angle = _TWO_PI * (turns - wp.floor(turns))
                        along += item.swing[0] * item.swing[1] / _TWO_PI * portable_sin(angle)
                        faster = item.swing[0] * speed * portable_cos(angle)
                    if item.motion == _RIM:
                        turns = travelled / (_TWO_PI * item.swing[1]) + item.swing[2]
                        angle = _TWO_PI * (turns - wp.floor(turns))
                        along += item.swing[1] * portable_sin(angle)
                        up += item.swing[1] * portable_cos(angle)
                        faster = speed * portable_cos(angle)
                        rising = -speed * portable_sin(angle)
                    arm = wp.vec3d(c * along - s * left, s * along + c * left, up)
                    point = (
                        wp.vec3d(
                            wp.float64(thing.position[0]),
                            wp.float64(thing.position[1]),
                            wp.float64(thing.position[2]),
                        )
                        + arm
                    )
                    yaw_rate = wp.float64(thing.yaw_rate)
                    velocity = wp.vec3d(
                        wp.float64(thing.velocity[0]) - yaw_rate * arm[1] + c * faster,
                        wp.float64(thing.velocity[1]) + yaw_rate * arm[0] + s * faster,
                        wp.float64(thing.velocity[2]) + rising,
                    )
                    nx = item.normal[0]
                    ny = item.normal[1]
                    normal = wp.vec2d(c * nx - s * ny, s * nx + c * ny)
                    echo = echo_at(
                        model, scene, state, pose, slot, point, velocity, item, normal, skin
                    )
        echoes_out[slot, number] = echo

    return scatter_kernel
