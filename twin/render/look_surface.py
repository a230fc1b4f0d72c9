"""A point of a face whose material comes from a file: smooth normals, maps, own light."""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import dot, quotient, reciprocal, unit
from twin.render.light.light import SlotLight
from twin.render.looks import SMOOTH
from twin.render.surface import SurfacePoint, snow_share
from twin.render.texture import sample
from twin.render.trace.geometry import RayScene, into_object, out_of_object
from twin.world.meshes.details import DIELECTRIC, EMISSION, MATT_FROM, NORMAL, SHARP_TO

_SMOOTH, _ROW = wp.constant(SMOOTH), wp.constant(SMOOTH - 1)
_DIELECTRIC = wp.constant(DIELECTRIC)
_EMISSION, _NORMAL = wp.constant(EMISSION), wp.constant(NORMAL)
_MATT_FROM = wp.constant(MATT_FROM)
_SHARP_SPAN = wp.constant(MATT_FROM - SHARP_TO)
# A normal that looks away from the viewer is bent back until it does so no more, by this cosine.
_FACING = wp.constant(0.01)


@wp.struct
class SmoothPoint:
    """A point of a face as one of the curved surface that the face stands for."""

    n: wp.vec3
    """Unit, on the side of the viewer."""
    lift: wp.vec3
    """From the face to the curved surface where that lies before it [m]."""


@wp.struct
class LookPoint:
    """What a face's material says of a point of it."""

    albedo: wp.vec3
    """Diffuse reflectance, linear RGB [-]."""
    mirror: wp.float32
    """Reflectance of the mirror part at normal incidence [-]."""
    tint: wp.vec3
    """Colour of the mirror part, 1 at most."""
    emission: wp.vec3
    """Own luminance [cd/m^2]."""
    bump: wp.vec3
    """Texel of the normal map; its blue is below 0: there is none."""


@wp.func
def object_turned(v: wp.vec3, scene: RayScene, slot: wp.int32, m: wp.int32) -> wp.vec3:
    """A vector in a mesh's own axes, brought into the world."""
    if m >= 0:
        return out_of_object(v, scene.objects[slot, m])
    return v


@wp.func
def smooth_point(
    scene: RayScene,
    slot: wp.int32,
    face: wp.int32,
    m: wp.int32,
    u: wp.float32,
    v: wp.float32,
    flat: wp.vec3,
) -> SmoothPoint:
    """The point with weights ``u``, ``v`` of the first two corners; ``flat``: the face's normal on
    the side of the viewer, ``m``: the object it belongs to.

    Interpolated normals (Phong 1975). Shadow rays begin on the curved surface: the mean of the
    point's projections onto the planes through the corners across their normals, of those that it
    lies below (Hanika, Hacking the Shadow Terminator, Ray Tracing Gems II, 2021). So facets cast no
    shadow on their neighbours where the sun grazes.
    """
    point = SmoothPoint()
    point.n = flat
    if scene.faces[face].uv_per_m >= 0.0:
        return point
    row = scene.looks.row[face]
    if row < _SMOOTH:
        return point
    first = 3 * (row - _SMOOTH)
    w = 1.0 - u - v
    side = wp.float32(1.0)
    if dot(object_turned(scene.faces[face].normal, scene, slot, m), flat) < 0.0:
        side = -1.0
    a = scene.looks.normal[first] * side
    b = scene.looks.normal[first + 1] * side
    c = scene.looks.normal[first + 2] * side
    n = a * u + b * v + c * w
    if dot(n, n) > 1.0e-6:
        point.n = object_turned(unit(n), scene, slot, m)
    x = scene.looks.rise[first]
    y = scene.looks.rise[first + 1]
    z = scene.looks.rise[first + 2]
    below_a = wp.min(0.0, side * (x[0] * v + x[1] * w))
    below_b = wp.min(0.0, side * (y[0] * w + y[1] * u))
    below_c = wp.min(0.0, side * (z[0] * u + z[1] * v))
    lift = a * (-u * below_a) + b * (-v * below_b) + c * (-w * below_c)
    point.lift = object_turned(lift, scene, slot, m)
    return point


@wp.func
def look_mirrors(scene: RayScene, face: wp.int32) -> wp.bool:
    """Whether a face's material can be a mirror that is worth a ray."""
    if scene.faces[face].uv_per_m >= 0.0:
        return False
    row = scene.looks.row[face] & _ROW
    return scene.looks.table[scene.looks.look[row]].mirrors != 0


@wp.func
def bent_normal(n: wp.vec3, s: SurfacePoint) -> wp.vec3:
    """``n`` as the face's material bends it."""
    if dot(s.ruffle, s.ruffle) == 0.0:
        return n
    return unit(n + s.ruffle)


@wp.func
def divided(at: LookPoint, base: wp.vec3, metallic: wp.float32, roughness: wp.float32) -> LookPoint:
    """``at`` with metalness and roughness as this renderer knows them.

    A metal mirrors its base colour, anything else 0.04 (glTF 2.0, B.3.1). The rougher, the less of
    a metal's mirrored light makes an image; the rest is reflected as by a matt surface.
    """
    if roughness >= _MATT_FROM:
        at.albedo = base
        return at
    sharp = wp.min(quotient(_MATT_FROM - roughness, _SHARP_SPAN), 1.0)
    sharp = sharp * sharp
    plain = _DIELECTRIC * (1.0 - metallic)
    color = (base * metallic + wp.vec3(plain, plain, plain)) * sharp
    at.albedo = base * (1.0 - metallic * sharp)
    at.mirror = wp.max(color[0], wp.max(color[1], color[2]))
    at.tint = color * reciprocal(wp.max(at.mirror, 1.0e-6))
    return at


@wp.func
def _mapped(
    scene: RayScene,
    first: wp.int32,
    front: wp.vec3,
    u: wp.float32,
    v: wp.float32,
    texel: wp.vec3,
    scale: wp.float32,
) -> wp.vec3:
    """``front``, in the mesh's axes, as a texel of the normal map bends it; ``first``: row of the
    first of the face's corners."""
    w = 1.0 - u - v
    mean = scene.looks.tangent[first] * u + scene.looks.tangent[first + 1] * v
    mean = mean + scene.looks.tangent[first + 2] * w
    along = wp.vec3(mean[0], mean[1], mean[2])
    along = along - front * dot(front, along)
    if dot(along, along) < 1.0e-8:
        return front
    along = unit(along)
    turn = wp.where(mean[3] < 0.0, wp.float32(-1.0), wp.float32(1.0))
    up = wp.cross(front, along) * turn
    x = (2.0 * texel[0] - 1.0) * scale
    y = (2.0 * texel[1] - 1.0) * scale
    z = 2.0 * texel[2] - 1.0
    bent = along * x + up * y + front * z
    if dot(bent, bent) < 1.0e-8:
        return front
    return unit(bent)


@wp.func
def look_point(
    scene: RayScene,
    face: wp.int32,
    u: wp.float32,
    v: wp.float32,
    uv: wp.vec2,
    footprint: wp.float32,
) -> LookPoint:
    """The point of a face that has a row of details.

    Args:
        scene: what is seen.
        face: row of the table of faces.
        u: weight of the first corner.
        v: weight of the second one.
        uv: texture coordinates there.
        footprint: width of the pixel in texture coordinates.
    """
    row = scene.looks.row[face] & _ROW
    look = scene.looks.look[row]
    at = LookPoint()
    base = scene.faces[face].color
    if scene.looks.table[look].colored != 0:
        base = scene.looks.color[3 * row] * u + scene.looks.color[3 * row + 1] * v
        base = base + scene.looks.color[3 * row + 2] * (1.0 - u - v)
    metallic = scene.looks.table[look].metallic
    roughness = scene.looks.table[look].roughness
    at.emission = scene.looks.table[look].emission
    at.bump = wp.vec3(0.0, 0.0, -1.0)
    # One loop over all images, so that the code of an image stands there once.
    for k in range(scene.looks.table[look].images):
        texture = scene.faces[face].texture
        there = uv
        wide = footprint
        if k > 0:
            texture = scene.looks.maps[look, k - 1].texture
            if texture >= 0:
                one = wp.vec3(uv[0], uv[1], 1.0)
                x = dot(scene.looks.maps[look, k - 1].u, one)
                y = dot(scene.looks.maps[look, k - 1].v, one)
                there = wp.vec2(x, y)
                wide = footprint * scene.looks.maps[look, k - 1].scale
        if texture >= 0:
            texel = sample(scene.textures, texture, there, wide)
            if k == 0:
                base = wp.cw_mul(base, texel)
            elif k == 1 + _EMISSION:
                at.emission = wp.cw_mul(at.emission, texel)
            elif k == 1 + _NORMAL:
                at.bump = texel
            else:
                roughness = roughness * texel[1]
                metallic = metallic * texel[2]
    return divided(at, base, metallic, roughness)


@wp.func
def look_ruffle(
    scene: RayScene,
    slot: wp.int32,
    face: wp.int32,
    m: wp.int32,
    flat: wp.vec3,
    curved: wp.vec3,
    u: wp.float32,
    v: wp.float32,
    bump: wp.vec3,
    direction: wp.vec3,
) -> wp.vec3:
    """What a face's details add to its normal, on the side of the viewer.

    Args:
        scene: what is seen.
        slot: of the case.
        face: row of the table of faces; it has a row of details.
        m: object that it belongs to; -1: static.
        flat: normal of the face on the side of the viewer.
        curved: that of the curved surface, of :func:`smooth_point`.
        u: weight of the first corner.
        v: weight of the second one.
        bump: that of :func:`look_point`.
        direction: along which it is seen.
    """
    n = curved
    if bump[2] >= 0.0:
        row = scene.looks.row[face] & _ROW
        # In the axes of the mesh.
        own = n
        front = flat
        if m >= 0:
            own = into_object(n, scene.objects[slot, m])
            front = into_object(flat, scene.objects[slot, m])
        side = wp.where(dot(front, scene.faces[face].normal) < 0.0, -1.0, 1.0)
        scale = scene.looks.table[scene.looks.look[row]].normal_scale
        own = _mapped(scene, 3 * row, own * side, u, v, bump, scale) * side
        n = object_turned(own, scene, slot, m)
    away = dot(n, direction)
    if away > -_FACING:
        n = unit(n - direction * (away + _FACING))
    return n - flat


@wp.func
def with_look(
    s: SurfacePoint, at: LookPoint, ruffle: wp.vec3, flat: wp.vec3, light: SlotLight
) -> SurfacePoint:
    """``s``, a surface of ``at``'s albedo, with the rest of what the material says."""
    s.ruffle = ruffle
    s.emission = s.emission + at.emission
    if at.mirror > 0.0:
        s.mirror = at.mirror * (1.0 - snow_share(flat, light))
        s.tint = at.tint
    return s


@wp.func
def bounced(direction: wp.vec3, n: wp.vec3, flat: wp.vec3) -> wp.vec3:
    """``direction`` mirrored at a surface with normal ``n``, not into the face with normal
    ``flat``."""
    ahead = direction + n * (2.0 * wp.clamp(-dot(n, direction), 0.0, 1.0))
    above = dot(ahead, flat)
    if above < _FACING:
        ahead = unit(ahead + flat * (_FACING - above))
    return ahead
