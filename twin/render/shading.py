"""Light that comes from a point that a ray has met."""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from twin.base.portable.quick import ahead_of, dot, quotient, unit
from twin.render.build import Features
from twin.render.light.lamps import (
    SODIUM,
    WARM_WHITE,
    LampBeams,
    StreetLamps,
    headlamp_lux,
    street_lamp_lux,
    vehicles_lux,
)
from twin.render.light.light import SlotLight
from twin.render.look_surface import LookPoint, bent_normal, look_point
from twin.render.surface import SurfacePoint, surface_at
from twin.render.texture import texture_at
from twin.render.trace import traverse
from twin.render.trace.geometry import Face, RayScene, into_object, out_of_object
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.visibility import LIT, OBJECT_MASK, PixelsSeen
from twin.world.meshes import materials
from twin.world.meshes.mesh import UV_METRES

_UV_METRES = wp.constant(UV_METRES)
_FOLIAGE = wp.constant(materials.FOLIAGE)
_SIGNAL_LAMP = wp.constant(materials.SIGNAL_LAMP)
PI_INVERSE = wp.constant(0.31830989)
# An object's underside is this much over the road, at which height its shadow fades out [m].
_CLEARANCE_M = wp.constant(0.55)


@wp.struct
class ShadedPoint:
    """A point of a surface in the world."""

    p: wp.vec3
    n: wp.vec3
    """Unit, on the side of the viewer."""
    face: wp.int32
    object: wp.int32
    u: wp.float32
    v: wp.float32
    distance: wp.float32
    """Distance from the camera along the way of the light [m]."""
    lit: wp.float32
    """Share of the sun that gets there [-]."""


@wp.func
def place_of(
    scene: RayScene,
    slot: wp.int32,
    seen: PixelsSeen,
    thread: wp.int32,
    eye: wp.vec3,
    direction: wp.vec3,
) -> ShadedPoint:
    """What the pixel of a thread sees; its face is below 0 if nothing."""
    at = ShadedPoint()
    at.face = seen.face[thread]
    at.object = -1
    if at.face < 0:
        return at
    flags = seen.flags[thread]
    at.object = (flags & OBJECT_MASK) - 1
    if (flags & LIT) != 0:
        at.lit = 1.0
    at.distance = seen.t[thread]
    at.p = ahead_of(eye, direction, at.distance)
    bary = seen.bary[thread]
    at.u = wp.float32((bary >> 16) & 65535) * 1.5259022e-5
    at.v = wp.float32(bary & 65535) * 1.5259022e-5
    at.n = scene.faces[at.face].normal
    if at.object >= 0:
        at.n = out_of_object(at.n, scene.objects[slot, at.object])
    if dot(at.n, direction) > 0.0:
        at.n = -at.n
    return at


@wp.func
def look_of(scene: RayScene, optics: Optics, at: ShadedPoint, direction: wp.vec3) -> LookPoint:
    """What the material of a face with details says of a place seen along ``direction``."""
    slope = wp.max(0.2, wp.abs(dot(at.n, direction)))
    footprint = quotient(at.distance * optics.pixel, slope) * -scene.faces[at.face].uv_per_m
    uv = uv_at(scene, at.face, at.u, at.v)
    return look_point(scene, at.face, at.u, at.v, uv, footprint)


@wp.func
def fresnel_of(normal: wp.float32, cosine: wp.float32) -> wp.float32:
    """Share that is mirrored at an angle, from that at ``normal`` incidence (Schlick 1994)."""
    grazing = 1.0 - cosine
    square = grazing * grazing
    top = wp.min(1.0, normal * 25.0)
    return normal + (top - normal) * square * square * grazing


@wp.func
def uv_at(scene: RayScene, row: wp.int32, u: wp.float32, v: wp.float32) -> wp.vec2:
    """Texture coordinates at weights ``u``, ``v`` of the first two corners of a face."""
    first = 3 * row
    return scene.uv[first] * u + scene.uv[first + 1] * v + scene.uv[first + 2] * (1.0 - u - v)


@wp.func
def albedo_at(
    scene: RayScene, face: Face, row: wp.int32, u: wp.float32, v: wp.float32, footprint: wp.float32
) -> wp.vec3:
    """Colour of a face, times its image if it has one; ``footprint``: width of the pixel [m]."""
    if face.texture < 0:
        return face.color
    at = uv_at(scene, row, u, v)
    texel = texture_at(scene.textures, face.texture, at, footprint * face.uv_per_m)
    return wp.cw_mul(face.color, texel)


@wp.func
def _ambient(scene: RayScene, at: ShadedPoint) -> wp.float32:
    """Share of the sky that the point sees [-], baked."""
    row = 3 * at.face
    share = scene.ambient[row] * at.u + scene.ambient[row + 1] * at.v
    return share + scene.ambient[row + 2] * (1.0 - at.u - at.v)


@wp.func
def _contact(scene: RayScene, slot: wp.int32, at: ShadedPoint) -> wp.float32:
    """Share of the sky that objects standing on the ground leave to it [-].

    The further below the hull the darker: full at its middle, gone a hand beyond its edge.
    """
    share = wp.float32(1.0)
    if at.n[2] < 0.7 or at.object >= 0:
        return share
    up = wp.vec3(0.0, 0.0, 1.0)
    for block in range(scene.spheres.shape[1]):
        mask = traverse.spheres_entered(scene.spheres, slot, block, at.p, up, _CLEARANCE_M)
        while mask != 0:
            m = block * 8 + traverse.lowest_bit(mask)
            mask = mask & (mask - 1)
            pose = scene.objects[slot, m]
            local = into_object(at.p - pose.position, pose)
            beyond = wp.max(wp.abs(local[0]) - pose.half[0], wp.abs(local[1]) - pose.half[1])
            cover = wp.clamp(0.45 - beyond * (1.0 / 0.7), 0.0, 0.9)
            share = share * (1.0 - cover)
    return share


@wp.func
def irradiance(
    scene: RayScene,
    slot: wp.int32,
    lamps: StreetLamps,
    beams: wp.array2d(dtype=LampBeams),
    optics: Optics,
    pose: SlotPose,
    at: ShadedPoint,
    n: wp.vec3,
    retro: wp.float32,
    light: SlotLight,
) -> wp.vec3:
    """Light falling on a point: sky, sun, lamps of streets, of the ego, of others [lx]."""
    upward = 0.5 + 0.5 * n[2]
    open_sky = _ambient(scene, at) * _contact(scene, slot, at)
    total = light.sky_rgb * ((0.78 * upward * upward + 0.05) * open_sky)
    total += light.sun_rgb * (0.06 * (1.0 - upward) * open_sky)  # sun bounced off the ground
    if at.lit > 0.0:
        facing = dot(n, light.sun_direction)
        if facing > 0.0:
            total += light.sun_rgb * (facing * at.lit)
    if light.lamps_on > 0.0:
        total += SODIUM * street_lamp_lux(at.p, n, lamps)
        total += vehicles_lux(at.p, n, slot, beams)
    if light.low_beam + light.high_beam + light.fog_lamp > 0.0:
        ray = at.p - pose.position
        local = wp.vec3(dot(ray, pose.forward), dot(ray, pose.left), dot(ray, pose.up))
        local = local - optics.lamps
        to_lamp = unit(pose.forward * -local[0] + pose.left * -local[1] + pose.up * -local[2])
        total += WARM_WHITE * (retro * headlamp_lux(local, dot(to_lamp, n), light))
    return total


@wp.func
def _lamps_of(scene: RayScene, slot: wp.int32, m: wp.int32, face: Face) -> wp.vec3:
    """Whether an object's lamps, its brake lamps and the lamp that a face is are on."""
    on = wp.vec3(0.0, 0.0, 0.0)
    if m >= 0:
        lit = (scene.objects[slot, m].lights >> (face.tag & 31)) & 1
        on = wp.vec3(scene.objects[slot, m].lamps, scene.objects[slot, m].brake, wp.float32(lit))
    elif face.material == _SIGNAL_LAMP:
        signal = face.tag >> 3
        if signal < scene.signals.shape[1]:
            on = wp.vec3(0.0, 0.0, wp.float32((scene.signals[slot, signal] >> (face.tag & 7)) & 1))
    return on


@cache
def surface_functions(features: Features, copy: int = 0) -> tuple[Any, Any]:
    """``surface_of`` and ``matt_light`` for worlds with such ``features``.

    Another ``copy`` is another pair of functions of the same text. A compiler inlines what is
    called once; what is not inlined gets its structs copied at every call.
    """
    assert copy >= 0
    looks = features.looks

    @wp.func
    def surface_of(
        scene: RayScene,
        slot: wp.int32,
        optics: Optics,
        at: ShadedPoint,
        direction: wp.vec3,
        light: SlotLight,
        detailed: wp.vec3,
    ) -> SurfacePoint:
        """Reflectance and own light at a place seen along ``direction``; ``detailed``: albedo of a
        face with details, of which the rest is up to :func:`with_look`."""
        face = scene.faces[at.face]
        slope = wp.max(0.2, wp.abs(dot(at.n, direction)))
        footprint = quotient(at.distance * optics.pixel, slope)
        if wp.static(looks):
            albedo = detailed
            if face.uv_per_m >= 0.0:
                albedo = albedo_at(scene, face, at.face, at.u, at.v, footprint)
        else:
            albedo = albedo_at(scene, face, at.face, at.u, at.v, footprint)
        on = _lamps_of(scene, slot, at.object, face)
        ground = wp.vec2(at.p[0], at.p[1])
        along = at.p[0]
        if wp.abs(at.n[0]) > 0.7:
            along = at.p[1] + 0.7
        if face.texture == _UV_METRES:
            ground = uv_at(scene, at.face, at.u, at.v)
            along = ground[0]
        s = surface_at(face, albedo, on, ground, along, at.p, at.n, at.distance, light)
        if wp.static(looks):
            s.tint = wp.vec3(1.0, 1.0, 1.0)
        return s

    @wp.func
    def matt_light(
        scene: RayScene,
        slot: wp.int32,
        lamps: StreetLamps,
        beams: wp.array2d(dtype=LampBeams),
        optics: Optics,
        pose: SlotPose,
        at: ShadedPoint,
        s: SurfacePoint,
        light: SlotLight,
    ) -> wp.vec3:
        """What a place reflects in all directions and what it emits [cd/m^2]."""
        n = at.n
        if wp.static(looks):
            n = bent_normal(n, s)
        elif scene.faces[at.face].material == _FOLIAGE:  # leaves face every way
            n = unit(n + s.ruffle)
        lux = irradiance(scene, slot, lamps, beams, optics, pose, at, n, s.retro, light)
        return wp.cw_mul(s.albedo, lux) * PI_INVERSE + s.emission

    return surface_of, matt_light
