"""A point of a face whose material comes from a file: smooth normals, maps, own light."""

from __future__ import annotations

import warp as wp

from twin.render.light.light import SlotLight
from twin.render.looks import MapUse
from twin.render.surface import SurfacePoint, snow_share
from twin.render.texture import sample
from twin.render.trace.geometry import RayScene, turned
from twin.world.meshes.details import DIELECTRIC, MATT_FROM, SHARP_TO

_DIELECTRIC = wp.constant(DIELECTRIC)
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
class Shine:
    """How a surface divides light."""

    matt: wp.float32
    """Share of the base colour that is reflected in all directions."""
    mirror: wp.float32
    """Reflectance of the mirror part at normal incidence [-]."""
    tint: wp.vec3
    """Colour of the mirror part, 1 at most."""


@wp.func
def object_turned(v: wp.vec3, scene: RayScene, slot: wp.int32, m: wp.int32) -> wp.vec3:
    """A vector in a mesh's own axes, brought into the world."""
    if m >= 0:
        return turned(v, scene.objects[slot, m].cosine, scene.objects[slot, m].sine)
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
    row = scene.looks.row[face]
    if row < 0:
        return point
    if scene.looks.table[scene.looks.look[row]].smooth == 0:
        return point
    first = 3 * row
    w = 1.0 - u - v
    side = wp.float32(1.0)
    if wp.dot(object_turned(scene.faces[face].normal, scene, slot, m), flat) < 0.0:
        side = -1.0
    a = scene.looks.normal[first] * side
    b = scene.looks.normal[first + 1] * side
    c = scene.looks.normal[first + 2] * side
    n = a * u + b * v + c * w
    if wp.length(n) > 1.0e-3:
        point.n = object_turned(wp.normalize(n), scene, slot, m)
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
    row = scene.looks.row[face]
    if row < 0:
        return False
    return scene.looks.table[scene.looks.look[row]].mirrors != 0


@wp.func
def color_of(
    scene: RayScene, color: wp.vec3, row: wp.int32, u: wp.float32, v: wp.float32
) -> wp.vec3:
    """Colour of a face: ``color``, or that between the corners of its row of details."""
    if row < 0:
        return color
    if scene.looks.table[scene.looks.look[row]].colored == 0:
        return color
    first = 3 * row
    mean = scene.looks.color[first] * u + scene.looks.color[first + 1] * v
    return mean + scene.looks.color[first + 2] * (1.0 - u - v)


@wp.func
def bent_normal(scene: RayScene, face: wp.int32, n: wp.vec3, s: SurfacePoint) -> wp.vec3:
    """``n`` as the face's material bends it."""
    if scene.looks.row[face] < 0:
        return n
    return wp.normalize(n + s.ruffle)


@wp.func
def _map_at(scene: RayScene, use: MapUse, uv: wp.vec2, footprint: wp.float32) -> wp.vec3:
    at = wp.vec3(uv[0], uv[1], 1.0)
    there = wp.vec2(wp.dot(use.u, at), wp.dot(use.v, at))
    return sample(scene.textures, use.texture, there, footprint * use.scale)


@wp.func
def shine_of(
    scene: RayScene, look: wp.int32, base: wp.vec3, uv: wp.vec2, footprint: wp.float32
) -> Shine:
    """Metalness and roughness as this renderer knows them.

    A metal mirrors its base colour, anything else 0.04 (glTF 2.0, B.3.1). The rougher, the less of
    a metal's mirrored light makes an image; the rest is reflected as by a matt surface.
    """
    metallic = scene.looks.table[look].metallic
    roughness = scene.looks.table[look].roughness
    use = scene.looks.table[look].shine_map
    if use.texture >= 0:
        texel = _map_at(scene, use, uv, footprint)
        roughness = roughness * texel[1]
        metallic = metallic * texel[2]
    sharp = wp.clamp((_MATT_FROM - roughness) / _SHARP_SPAN, 0.0, 1.0)
    sharp = sharp * sharp
    share = Shine()
    share.matt = 1.0 - metallic * sharp
    plain = _DIELECTRIC * (1.0 - metallic)
    color = (base * metallic + wp.vec3(plain, plain, plain)) * sharp
    share.mirror = wp.max(color[0], wp.max(color[1], color[2]))
    share.tint = color / wp.max(share.mirror, 1.0e-6)
    return share


@wp.func
def _mapped_normal(
    scene: RayScene,
    row: wp.int32,
    look: wp.int32,
    front: wp.vec3,
    u: wp.float32,
    v: wp.float32,
    uv: wp.vec2,
    footprint: wp.float32,
) -> wp.vec3:
    """``front``, in the mesh's axes, as the normal map bends it."""
    first = 3 * row
    w = 1.0 - u - v
    mean = scene.looks.tangent[first] * u + scene.looks.tangent[first + 1] * v
    mean = mean + scene.looks.tangent[first + 2] * w
    along = wp.vec3(mean[0], mean[1], mean[2])
    along = along - front * wp.dot(front, along)
    if wp.length(along) < 1.0e-4:
        return front
    along = wp.normalize(along)
    turn = wp.where(mean[3] < 0.0, wp.float32(-1.0), wp.float32(1.0))
    up = wp.cross(front, along) * turn
    texel = _map_at(scene, scene.looks.table[look].normal_map, uv, footprint)
    scale = scene.looks.table[look].normal_scale
    x = (2.0 * texel[0] - 1.0) * scale
    y = (2.0 * texel[1] - 1.0) * scale
    z = 2.0 * texel[2] - 1.0
    bent = along * x + up * y + front * z
    if wp.length(bent) < 1.0e-4:
        return front
    return wp.normalize(bent)


@wp.func
def with_look(
    s: SurfacePoint,
    scene: RayScene,
    slot: wp.int32,
    face: wp.int32,
    m: wp.int32,
    flat: wp.vec3,
    u: wp.float32,
    v: wp.float32,
    uv: wp.vec2,
    footprint: wp.float32,
    share: Shine,
    direction: wp.vec3,
    light: SlotLight,
) -> SurfacePoint:
    """``s`` with the normal, mirror and own light of the face's material."""
    row = scene.looks.row[face]
    look = scene.looks.look[row]
    n = smooth_point(scene, slot, face, m, u, v, flat).n
    if scene.looks.table[look].normal_map.texture >= 0:
        # In the mesh's axes, before it: objects only turn about z.
        own = n
        front = flat
        if m >= 0:
            cosine = scene.objects[slot, m].cosine
            sine = scene.objects[slot, m].sine
            own = turned(n, cosine, -sine)
            front = turned(flat, cosine, -sine)
        side = wp.where(wp.dot(front, scene.faces[face].normal) < 0.0, -1.0, 1.0)
        own = _mapped_normal(scene, row, look, own * side, u, v, uv, footprint) * side
        n = object_turned(own, scene, slot, m)
    away = wp.dot(n, direction)
    if away > -_FACING:
        n = wp.normalize(n - direction * (away + _FACING))
    s.ruffle = n - flat
    if share.mirror > 0.0:
        s.mirror = share.mirror * (1.0 - snow_share(flat, light))
        s.tint = share.tint
    glow = scene.looks.table[look].emission
    if glow[0] + glow[1] + glow[2] > 0.0:
        use = scene.looks.table[look].emission_map
        if use.texture >= 0:
            glow = wp.cw_mul(glow, _map_at(scene, use, uv, footprint))
        s.emission = s.emission + glow
    return s


@wp.func
def bounced(direction: wp.vec3, n: wp.vec3, flat: wp.vec3) -> wp.vec3:
    """``direction`` mirrored at a surface with normal ``n``, not into the face with normal
    ``flat``."""
    ahead = direction + n * (2.0 * wp.clamp(-wp.dot(n, direction), 0.0, 1.0))
    above = wp.dot(ahead, flat)
    if above < _FACING:
        ahead = wp.normalize(ahead + flat * (_FACING - above))
    return ahead
