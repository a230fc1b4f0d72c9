"""Procedural surfaces: reflectance, own light and shine of the point a ray has hit."""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import quotient, reciprocal
from twin.render.light.light import SlotLight
from twin.render.noise import lattice, value_noise
from twin.render.trace.geometry import Face
from twin.world.meshes import materials

_PLAIN = wp.constant(materials.PLAIN)
_ASPHALT = wp.constant(materials.ASPHALT)
_PAVING = wp.constant(materials.PAVING)
_LAST_GROUND = wp.constant(materials.PAINT)
_FACADE = wp.constant(materials.FACADE)
_SHOPFRONT = wp.constant(materials.SHOPFRONT)
_FOLIAGE = wp.constant(materials.FOLIAGE)
_CAR_PAINT = wp.constant(materials.CAR_PAINT)
_GLASS = wp.constant(materials.GLASS)
_STREET_LAMP = wp.constant(materials.STREET_LAMP)
_HAZARD = wp.constant(materials.HAZARD)
_REFLECTOR = wp.constant(materials.REFLECTOR)
_WINDOW = wp.constant(materials.WINDOW)
_BRICK = wp.constant(materials.BRICK)
_PLASTER = wp.constant(materials.PLASTER)
_SIGN = wp.constant(materials.SIGN)
_SIGNAL = wp.constant(materials.SIGNAL)
_GRASS = wp.constant(materials.GRASS)
_TAIL_LAMP = wp.constant(materials.TAIL_LAMP)
_HEAD_LAMP = wp.constant(materials.HEAD_LAMP)
_VEHICLE_LAMP = wp.constant(materials.VEHICLE_LAMP)
_SIGNAL_LAMP = wp.constant(materials.SIGNAL_LAMP)

_MIRRORS = wp.constant(
    (1 << materials.CAR_PAINT)
    | (1 << materials.GLASS)
    | (1 << materials.WINDOW)
    | (1 << materials.FACADE)
    | (1 << materials.SHOPFRONT)
    | (1 << materials.HEAD_LAMP)
)
"""Bits of the materials that can be mirrors, at least in places; wet ground is one as well."""

_PANE = wp.constant(wp.vec3(0.025, 0.03, 0.035))
_SNOW = wp.constant(wp.vec3(0.80, 0.83, 0.88))
_LAMP = wp.constant(wp.vec3(1.0, 0.80, 0.52))
_ROOM = wp.constant(wp.vec3(1.0, 0.72, 0.40))


@wp.struct
class SurfacePoint:
    """A point of a surface."""

    albedo: wp.vec3
    """Diffuse reflectance, linear RGB [-]."""
    emission: wp.vec3
    """Own luminance [cd/m^2]."""
    mirror: wp.float32
    """Reflectance of the mirror part at normal incidence [-]; 0: none."""
    clear: wp.float32
    """Share of the light that passes at normal incidence [-]; 0: opaque."""
    ruffle: wp.vec3
    """Added to the normal of leaves [-]."""
    tint: wp.vec3
    """Colour of the mirror part, 1 at most; only where materials come from files."""
    retro: wp.float32
    """Gain of light returned to the ego's headlamps, relative to a matt surface [-]."""


@wp.func
def _facade(s: SurfacePoint, tag: wp.int32, u: wp.float32, z: wp.float32, light: SlotLight):
    """A grid of windows; ``u`` runs along the wall and ``z`` up [m]."""
    pitch = 2.3 + 1.5 * lattice(tag, 1, 0)
    storey = 3.1 + 0.5 * lattice(tag, 2, 0)
    broad = 0.42 + 0.26 * lattice(tag, 3, 0)
    across = quotient(u, pitch)
    up = quotient(z - 4.2, storey)
    column = wp.floor(across)
    row = wp.floor(up)
    a = across - column
    b = up - row
    inside_a = wp.abs(a - 0.5) - 0.5 * broad
    inside_b = wp.abs(b - 0.52) - 0.29
    if inside_a < 0.0 and inside_b < 0.0:
        frame = inside_a > -0.025 or inside_b > -0.025 or wp.abs(a - 0.5) < 0.014
        i = wp.int32(column)
        j = wp.int32(row)
        dice = lattice(tag + i, j, 7)
        if frame:
            s.albedo = wp.vec3(0.45, 0.44, 0.42)
        else:
            curtain = wp.where(dice > 0.6, 0.18 * lattice(tag + i, j, 9), 0.0)
            s.albedo = _PANE + wp.vec3(curtain, curtain, 0.9 * curtain)
            s.mirror = 0.10
            if light.lamps_on > 0.0 and dice < 0.22:
                s.emission = _ROOM * (4.0 + 12.0 * lattice(tag + i, j, 8)) * (0.6 + 0.5 * b)
    elif inside_a < 0.03 and b < 0.23 and b > 0.19:
        s.albedo = wp.vec3(0.42, 0.41, 0.39)  # window sill
    else:
        grain = 0.9 + 0.2 * lattice(wp.int32(wp.floor(u * 4.0)), wp.int32(wp.floor(z * 12.0)), tag)
        s.albedo = s.albedo * grain
    return s


@wp.func
def _shopfront(s: SurfacePoint, tag: wp.int32, u: wp.float32, z: wp.float32, light: SlotLight):
    pitch = 3.4 + 1.6 * lattice(tag, 4, 0)
    across = quotient(u, pitch)
    column = wp.floor(across)
    a = wp.abs(across - column - 0.5)
    i = wp.int32(column)
    dice = lattice(tag + i, 5, 3)
    if z > 3.15 and z < 3.85 and a < 0.47:  # sign board
        s.albedo = wp.vec3(0.12 + 0.5 * dice, 0.14 + 0.3 * lattice(tag, i, 4), 0.30 - 0.2 * dice)
        if light.lamps_on > 0.0 and dice > 0.5:
            s.emission = s.albedo * 20.0
    elif z > 0.6 and z < 2.95 and a < 0.43:
        if a > 0.415 or z > 2.88 or wp.abs(z - 2.35) < 0.04:
            s.albedo = wp.vec3(0.10, 0.10, 0.10)
        else:
            s.albedo = _PANE * 1.5
            s.mirror = 0.10
            if light.lamps_on > 0.0 and dice < 0.45:
                s.emission = _ROOM * (7.0 + 10.0 * dice)
    return s


@wp.func
def _ground(
    s: SurfacePoint, material: wp.int32, p: wp.vec2, distance: wp.float32, light: SlotLight
):
    """Road, paving and paint: texture, water, snow."""
    patch = value_noise(p[0] * 0.22, p[1] * 0.9, 5)
    if material == _PAVING:
        joint = wp.abs(p[0] - wp.floor(p[0]) - 0.5) > 0.485
        joint = joint or wp.abs(p[1] - wp.floor(p[1]) - 0.5) > 0.485
        slab = lattice(wp.int32(wp.floor(p[0])), wp.int32(wp.floor(p[1])), 6)
        s.albedo = s.albedo * (0.85 + 0.25 * slab)
        if joint and distance < 45.0:
            s.albedo = s.albedo * 0.65
    elif material == _ASPHALT:
        grain = lattice(wp.int32(wp.floor(p[0] * 14.0)), wp.int32(wp.floor(p[1] * 14.0)), 2)
        keep = reciprocal(1.0 + 0.004 * distance * distance)  # grain averages out far away
        s.albedo = s.albedo * (0.78 + 0.4 * patch + (grain - 0.5) * 0.35 * keep)
    else:
        s.albedo = s.albedo * (0.82 + 0.18 * patch)
    if light.wetness > 0.0:
        # Water darkens porous ground and turns it into a mirror at grazing angles.
        s.albedo = s.albedo * (1.0 - 0.45 * light.wetness)
        if light.wetness > 0.5:
            puddle = wp.clamp((patch - 0.35) * 3.0, 0.0, 1.0)
            s.mirror = 0.02 * light.wetness * (0.35 + 0.65 * puddle)
    if light.snow_cover > 0.0:
        # Tyre tracks stay darker: two bands around each lane's centre.
        track = wp.float32(1.0)
        if material != _PAVING:
            in_lane = p[1] - 3.5 * wp.floor((p[1] + 1.75) * (1.0 / 3.5))
            band = wp.abs(wp.abs(in_lane) - 0.8)
            track = wp.clamp(0.45 + 0.9 * band, 0.0, 1.0)
        rough = value_noise(p[0] * 1.3, p[1] * 3.1, 8)
        # Clods and grains, which average out far away.
        near = reciprocal(1.0 + 0.004 * distance * distance)
        clods = value_noise(p[0] * 7.0, p[1] * 9.0, 11) - 0.5
        rough += (0.5 * clods + 0.35 * (value_noise(p[0] * 31.0, p[1] * 33.0, 12) - 0.5)) * near
        share = wp.clamp(light.snow_cover * track * 1.5 + (rough - 0.62) * 0.6, 0.0, 0.97)
        s.albedo = s.albedo * (1.0 - share) + _SNOW * share
        s.mirror = s.mirror * (1.0 - share)
    return s


@wp.func
def is_ground(material: wp.int32) -> wp.bool:
    """Whether a surface gets wet as the road does."""
    return material <= _LAST_GROUND and material != _PLAIN


@wp.func
def snow_share(normal: wp.vec3, light: SlotLight) -> wp.float32:
    """Share of a surface with unit ``normal``, neither ground nor glass, that lies under snow."""
    if light.snow_cover > 0.0 and normal[2] > 0.5:
        return light.snow_cover * wp.min(1.0, (normal[2] - 0.5) * 4.0)
    return wp.float32(0.0)


@wp.func
def may_mirror(material: wp.int32) -> wp.bool:
    """Whether a dry surface can be a mirror or let light through."""
    return ((1 << material) & _MIRRORS) != 0


@wp.func
def _pane(s: SurfacePoint, tag: wp.int32, light: SlotLight):
    """One pane of a building, with a curtain or a lit room behind it."""
    dice = lattice(tag, 5, 7)
    curtain = wp.where(dice > 0.6, 0.18 * lattice(tag, 6, 9), 0.0)
    s.albedo = s.albedo + wp.vec3(curtain, curtain, 0.9 * curtain)
    s.mirror = 0.08
    if light.lamps_on > 0.0 and dice < 0.25:
        s.emission = _ROOM * (4.0 + 12.0 * lattice(tag, 7, 8))
    return s


@wp.func
def _masonry(s: SurfacePoint, tag: wp.int32, u: wp.float32, z: wp.float32, distance: wp.float32):
    """Courses of bricks of 25 cm by 7.7 cm; joints average out far away."""
    height = z * (1.0 / 0.077)
    course = wp.floor(height)
    along = u * 4.0 + 0.5 * (course - 2.0 * wp.floor(course * 0.5))
    brick = wp.floor(along)
    shade = 0.82 + 0.36 * lattice(wp.int32(brick), wp.int32(course), tag)
    keep = reciprocal(1.0 + 0.0015 * distance * distance)
    joint = height - course < 0.13 or along - brick < 0.04
    mortar = wp.vec3(0.36, 0.34, 0.31)
    face = s.albedo * (1.0 + (shade - 1.0) * keep)
    if joint:
        face = face * (1.0 - 0.6 * keep) + mortar * (0.6 * keep)
    s.albedo = face
    return s


@wp.func
def _plain_surface(s: SurfacePoint, m: wp.int32, on: wp.vec3, light: SlotLight):
    """Materials without a pattern."""
    if m == _CAR_PAINT:
        s.mirror = 0.04
    elif m == _GLASS:
        s.mirror = 0.08
        s.clear = 0.70
    elif m == _STREET_LAMP:
        s.emission = _LAMP * (light.lamps_on * 350.0)
    elif m == _HAZARD:
        s.retro = 2.0
        s.emission = wp.vec3(260.0, 110.0, 9.0) * light.hazard
    elif m == _REFLECTOR:
        s.retro = 4.0
    elif m == _SIGN:
        s.retro = 25.0
    elif m == _SIGNAL:
        # Dimmed at night, as LED signals are; squared, so that the colour outlives the exposure.
        bright = wp.where(light.lamps_on > 0.0, 120.0, 4000.0)
        s.emission = wp.cw_mul(s.albedo, s.albedo) * bright
    elif m == _TAIL_LAMP:
        s.retro = 4.0
        dark = wp.max(wp.where(light.lamps_on > 0.0, on[0], 0.0), on[2])
        s.emission = wp.vec3(1.0, 0.03, 0.02) * (250.0 * dark + 2500.0 * on[1])
    elif m == _HEAD_LAMP:
        s.mirror = 0.04
        lit = wp.where(light.lamps_on > 0.0, 9000.0 * wp.max(on[0], on[2]), 40000.0 * on[2])
        s.emission = wp.vec3(1.0, 0.95, 0.85) * lit
    elif m == _VEHICLE_LAMP:
        # Of UN R6 and R23, about 10 kcd/m^2 by day; squared and dimmed as traffic lights are.
        bright = wp.where(light.lamps_on > 0.0, 150.0, 25000.0)
        s.emission = wp.cw_mul(s.albedo, s.albedo) * (bright * on[2])
    elif m == _SIGNAL_LAMP:
        bright = wp.where(light.lamps_on > 0.0, 120.0, 4000.0)
        s.emission = wp.cw_mul(s.albedo, s.albedo) * (bright * on[2])
        s.albedo = s.albedo * wp.where(on[2] > 0.0, 1.0, 0.12)
    return s


@wp.func
def _bare_surface(
    face: Face,
    albedo: wp.vec3,
    on: wp.vec3,
    along: wp.float32,
    p: wp.vec3,
    distance: wp.float32,
    light: SlotLight,
) -> SurfacePoint:
    """What is no ground, without snow; arguments as of :func:`surface_at`.

    Every material returns by itself: a struct that is chosen between branches is copied at each of
    them, which took an eighth of a picture's shading on a CPU.
    """
    s = SurfacePoint()
    s.albedo = albedo
    s.retro = 1.0
    m = face.material
    if m == _FACADE:
        return _facade(s, face.tag, along, p[2], light)
    if m == _SHOPFRONT:
        return _shopfront(s, face.tag, along, p[2], light)
    if m == _WINDOW:
        return _pane(s, face.tag, light)
    if m == _BRICK:
        return _masonry(s, face.tag, along, p[2], distance)
    if m == _PLASTER:
        stain = value_noise(along * 0.35, p[2] * 0.12, face.tag)
        s.albedo = s.albedo * (0.86 + 0.22 * stain)
        return s
    if m == _FOLIAGE:
        i = wp.int32(wp.floor(p[0] * 7.0 + p[2] * 3.0))
        j = wp.int32(wp.floor(p[1] * 7.0 - p[2] * 5.0))
        leaf = lattice(i, j, 3)
        s.albedo = s.albedo * (0.5 + 1.1 * leaf)
        s.ruffle = wp.vec3(leaf - 0.5, lattice(i, j, 4) - 0.5, lattice(i, j, 5) - 0.4) * 1.5
        return s
    if m == _GRASS:
        blade = lattice(wp.int32(wp.floor(p[0] * 11.0)), wp.int32(wp.floor(p[1] * 11.0)), 12)
        keep = reciprocal(1.0 + 0.004 * distance * distance)
        s.albedo = s.albedo * (0.75 + 0.5 * value_noise(p[0] * 0.4, p[1] * 0.4, 13))
        s.albedo = s.albedo * (1.0 + (blade - 0.5) * 0.6 * keep)
        return s
    return _plain_surface(s, m, on, light)


@wp.func
def surface_at(
    face: Face,
    albedo: wp.vec3,
    on: wp.vec3,
    ground: wp.vec2,
    along: wp.float32,
    p: wp.vec3,
    normal: wp.vec3,
    distance: wp.float32,
    light: SlotLight,
) -> SurfacePoint:
    """The surface at world point ``p`` with unit ``normal``, seen from ``distance`` [m].

    ``ground``: x along the street and y across it, where patterns of the ground lie [m];
    ``along``: where patterns of walls lie, beside the height [m];
    ``albedo``: the face's colour or that of its image; ``on``: whether the object's lamps, its
    brake lamps and the lamp that the face is are on.
    """
    m = face.material
    if m <= _LAST_GROUND and m != _PLAIN:
        s = SurfacePoint()
        s.albedo = albedo
        s.retro = 1.0
        return _ground(s, m, ground, distance, light)
    bare = _bare_surface(face, albedo, on, along, p, distance, light)
    if light.snow_cover > 0.0 and normal[2] > 0.5 and m != _GLASS:
        share = light.snow_cover * wp.min(1.0, (normal[2] - 0.5) * 4.0)
        bare.albedo = bare.albedo * (1.0 - share) + _SNOW * share
        bare.mirror = bare.mirror * (1.0 - share)
    return bare
