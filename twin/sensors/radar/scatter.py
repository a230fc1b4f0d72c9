"""Echoes of bodies: a thread per bright point of what stands and of what moves.

Whether a point is seen is decided by a ray to it. The road adds a second way to every point: with
the path difference d and the road's reflection coefficient r the field is 1 + r e^{-jkd} out and
back again, so the echo is multiplied by its square (two-ray model). r is Fresnel's for vertical
polarisation and the permittivity of asphalt, 4, or of a film of water, rounded off by a roughness
of s: e^{-2 (k s sin psi)^2} (Ament 1953). A point that is hidden may still be seen by the road
alone, below the vehicle that stands between.
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from twin.base.portable_math import portable_cos, portable_exp, portable_sin
from twin.render.build import Features
from twin.render.trace.geometry import ObjectPose, RayScene, rays_of
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
# Where the way below a vehicle meets the road: above the shade that is painted there.
_CLEAR_M = wp.constant(wp.float64(0.04))
_FOOT_SKIN_M = wp.constant(0.02)
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
def road_reflection(state: RadarSlot, wavelength: wp.float64, sine: wp.float64) -> wp.float64:
    """Reflection coefficient of the road at a grazing angle with ``sine`` [-]."""
    permittivity = _DRY + (_FILM - _DRY) * state.wetness
    root = wp.sqrt(permittivity - _ONE + sine * sine)
    reflected = (permittivity * sine - root) / (permittivity * sine + root)
    rough = _TWO_PI / wavelength * _ROUGH_M * (_ONE - _HALF * state.wetness) * sine
    return reflected * portable_exp(-_TWO * rough * rough)


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
    reflected = road_reflection(state, wavelength, total / longer)
    second = phasor(-more / wavelength) * wp.float32(reflected)
    return wp.vec2(1.0 + second[0], second[1])


@wp.struct
class BodyPoint:
    """A bright point where it is and as it moves."""

    at: wp.vec3d
    """World [m]."""
    velocity: wp.vec3d
    """World [m/s]."""
    normal: wp.vec2d
    """Where its lobe points, world."""
    skin: wp.float32
    """A ray to it ends so far before, because it lies inside the body [m]."""


@wp.func
def point_that_stands(item: Scatterer, ground: wp.float64) -> BodyPoint:
    """A point of what stands in the world; its velocity is measured, but it stays."""
    body = BodyPoint()
    body.at = item.at + wp.vec3d(_ZERO, _ZERO, ground)
    body.velocity = wp.vec3d(item.swing[0], item.swing[1], _ZERO)
    body.normal = item.normal
    body.skin = _SKIN_M
    return body


@wp.func
def point_of_body(item: Scatterer, thing: ObjectPose) -> BodyPoint:
    """A point of a movable object."""
    c = wp.float64(thing.cosine)
    s = wp.float64(thing.sine)
    speed = c * wp.float64(thing.velocity[0]) + s * wp.float64(thing.velocity[1])
    travelled = c * wp.float64(thing.position[0]) + s * wp.float64(thing.position[1])
    along = item.at[0] + item.share[0] * wp.float64(thing.half[0])
    left = item.at[1] + item.share[1] * wp.float64(thing.half[1])
    up = item.at[2]
    faster = _ZERO
    rising = _ZERO
    body = BodyPoint()
    body.skin = _SKIN_M
    if item.motion != 0:
        body.skin = _SKIN_SMALL_M
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
    position = wp.vec3d(
        wp.float64(thing.position[0]), wp.float64(thing.position[1]), wp.float64(thing.position[2])
    )
    body.at = position + arm
    yaw_rate = wp.float64(thing.yaw_rate)
    body.velocity = wp.vec3d(
        wp.float64(thing.velocity[0]) - yaw_rate * arm[1] + c * faster,
        wp.float64(thing.velocity[1]) + yaw_rate * arm[0] + s * faster,
        wp.float64(thing.velocity[2]) + rising,
    )
    nx = item.normal[0]
    ny = item.normal[1]
    body.normal = wp.vec2d(c * nx - s * ny, s * nx + c * ny)
    return body


@cache
def scatter_kernel_of(features: Features) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    _, occluded = rays_of(features)

    @wp.func
    def hidden(
        scene: RayScene, slot: wp.int32, start: wp.vec3d, end: wp.vec3d, skin: wp.float32
    ) -> wp.bool:
        """Whether something stands between two points, up to ``skin`` [m] before the end."""
        way = end - start
        distance = wp.length(way)
        unit = way / distance
        origin = wp.vec3(wp.float32(start[0]), wp.float32(start[1]), wp.float32(start[2]))
        ahead = wp.vec3(wp.float32(unit[0]), wp.float32(unit[1]), wp.float32(unit[2]))
        return occluded(scene, slot, origin, ahead, wp.float32(distance) - skin)

    @wp.func
    def echo_from_below(
        model: RadarModel,
        scene: RayScene,
        state: RadarSlot,
        pose: RadarPose,
        slot: wp.int32,
        body: BodyPoint,
        seen: wp.float64,
    ) -> RadarEcho:
        """Echo of a hidden point by the road alone: below a vehicle that stands between."""
        empty = RadarEcho()
        low = pose.origin[2] - pose.ground
        high = body.at[2] - pose.ground
        if state.multipath == 0 or low <= _CLEAR_M or high <= _CLEAR_M:
            return empty
        way = body.at - pose.origin
        foot = pose.origin + way * (low / (low + high))
        foot[2] = pose.ground + _CLEAR_M
        if hidden(scene, slot, pose.origin, foot, _FOOT_SKIN_M):
            return empty
        if hidden(scene, slot, foot, body.at, body.skin):
            return empty
        image = wp.vec3d(way[0], way[1], -(low + high))
        longer = wp.length(image)
        reflected = road_reflection(state, model.wavelength, (low + high) / longer)
        reflected = reflected * reflected
        at = wp.transpose(pose.rotation) * image
        power = power_of(model, state, at, seen) * reflected * reflected
        if wp.float32(power) <= FAINT:
            return empty
        radial = wp.dot(body.velocity - pose.velocity, way) / wp.length(way)
        return echo_of(model, power, at, radial, _ZERO)

    @wp.func
    def echo_at(
        model: RadarModel,
        scene: RayScene,
        state: RadarSlot,
        pose: RadarPose,
        slot: wp.int32,
        item: Scatterer,
        body: BodyPoint,
    ) -> RadarEcho:
        """Echo of one scatterer."""
        empty = RadarEcho()
        way = body.at - pose.origin
        distance = wp.length(way)
        if distance < _HALF:
            return empty
        unit = way / distance
        seen = cross_section(item.shape, item.size, body.normal, -unit, distance, model.wavelength)
        at = wp.transpose(pose.rotation) * way
        power = power_of(model, state, at, seen)
        if wp.float32(power) <= FAINT:
            return empty
        if hidden(scene, slot, pose.origin, body.at, body.skin):
            return echo_from_below(model, scene, state, pose, slot, body, seen)
        echo = echo_of(model, power, at, wp.dot(body.velocity - pose.velocity, unit), _ZERO)
        if state.multipath != 0:
            flat = wp.sqrt(way[0] * way[0] + way[1] * way[1])
            low = pose.origin[2] - pose.ground
            factor = road_factor(state, model.wavelength, flat, low, body.at[2] - pose.ground)
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
            body = point_that_stands(item, pose.ground)
            echo = echo_at(model, scene, state, pose, slot, item, body)
        else:
            m = (number - count) / _ROWS
            thing = scene.objects[slot, m]
            if thing.root != 0 and thing.half[0] > 0.0:  # what lies flat has no hull
                item = templates[classes[thing.instance], (number - count) - m * _ROWS]
                if item.shape >= 0:
                    body = point_of_body(item, thing)
                    echo = echo_at(model, scene, state, pose, slot, item, body)
        echoes_out[slot, number] = echo

    return scatter_kernel
