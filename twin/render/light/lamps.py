"""Lamps: the ego's headlamps, those of other vehicles, street lamps, and their glow in fog."""

from __future__ import annotations

import math

import warp as wp

from twin.actors.lamps import VehicleLamp
from twin.base.portable.quick import decay, dot, quotient, reciprocal, root
from twin.base.portable.whole import whole_within_f32
from twin.render.light.light import SlotLight
from twin.render.trace.geometry import RayScene, out_of_object
from twin.render.trace.rays import SlotPose

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Both headlamps together, seen as one source in the middle of the front.
# Order of magnitude of UN R149 lamps: low beam about 20 kcd below its cut-off, high beam 50 kcd.
LOW_CD = wp.constant(22_000.0)
HIGH_CD = wp.constant(50_000.0)
FOG_CD = wp.constant(9_000.0)

WARM_WHITE = wp.constant(wp.vec3(1.0, 0.93, 0.80))
SODIUM = wp.constant(wp.vec3(1.0, 0.76, 0.46))

_FOG_BLUR_M = wp.constant(6.0)
"""Softening of a beam's cut-off, as a slope, per extinction [m]."""
# Half width and height of each beam, as slopes: how often they go into 1.
_LOW_WIDTH, _LOW_HEIGHT = wp.constant(1.0 / 0.42), wp.constant(1.0 / 0.09)
_HIGH_WIDTH, _HIGH_HEIGHT = wp.constant(1.0 / 0.24), wp.constant(1.0 / 0.10)
_FOG_WIDTH, _FOG_HEIGHT = wp.constant(1.0 / 0.80), wp.constant(1.0 / 0.10)
_CUT_OFF = wp.constant(1.0 / 0.012)
_SPHERE = wp.constant(1.0 / (4.0 * math.pi))
# Share of light that fog scatters straight back, relative to isotropic scattering.
_BACKSCATTER = wp.constant(0.6)


@wp.struct
class StreetLamps:
    """Two rows of lamps along a straight street, or lamps anywhere, found by a grid of cells."""

    spacing: wp.float32
    """Distance between lamps of a row [m]."""
    height: wp.float32
    """Height of the luminaires [m]."""
    intensity: wp.float32
    """Luminous intensity of each [cd]."""
    right: wp.vec2
    """World x of one lamp of the right row, world y of the row [m]."""
    left: wp.vec2
    """World x of one lamp of the left row, world y of the row [m]."""
    scattered: wp.int32
    """1: the lamps of ``at``; 0: the two rows."""
    at: wp.array(dtype=wp.vec2)
    """World x, y of each lamp [m]."""
    near: wp.array3d(dtype=wp.int32)
    """Lamps nearest to the middle of each cell [rows along y, columns along x, LAMPS_GLOWING];
    -1: none."""
    corner: wp.vec2
    """World x, y at which the cells begin [m]."""
    cell: wp.float32
    """Width of a cell [m]."""


LAMPS_GLOWING = 8
"""Street lamps whose glow an eye sees in fog."""
_LAMPS_GLOWING = wp.constant(LAMPS_GLOWING)
LAMPS_LIGHTING = 4
"""Street lamps that light a point; at the usual distances the next ones give less than 1 %."""
_LAMPS_LIGHTING = wp.constant(LAMPS_LIGHTING)


@wp.func
def _near_lamp(x: wp.float32, y: wp.float32, i: wp.int32, lamps: StreetLamps) -> wp.int32:
    """The ``i``-th of the lamps that light a place; -1: none."""
    columns, rows = lamps.near.shape[1], lamps.near.shape[0]
    across = quotient(x - lamps.corner[0], lamps.cell)
    along = quotient(y - lamps.corner[1], lamps.cell)
    column = whole_within_f32(wp.floor(across), -1, columns)
    row = whole_within_f32(wp.floor(along), -1, rows)
    if row < 0 or row >= rows or column < 0 or column >= columns:
        return wp.int32(-1)
    return lamps.near[row, column, i]


@wp.func
def _lobes(h: wp.float32, v: wp.float32) -> wp.float32:
    """Share of a beam's peak at ``h`` half widths to the side and ``v`` half heights up."""
    square = (1.0 + h * h) * (1.0 + v * v)
    return reciprocal(square * square)


@wp.func
def _beam_cd(h: wp.float32, v: wp.float32, light: SlotLight) -> wp.float32:
    """Luminous intensity at slope ``h`` to the side and ``v`` up [cd]."""
    total = wp.float32(0.0)
    # Droplets scatter mostly forwards: in fog the edge of a beam is no edge any more (inferred).
    blur = wp.min(_FOG_BLUR_M * light.extinction, 0.2)
    if light.low_beam > 0.0:
        # Cut-off 1 % below the horizon, softened over 1.2 %.
        cut = wp.clamp(quotient(0.5 * blur - 0.004 - v, 0.012 + blur), 0.0, 1.0)
        shape = _lobes(h * _LOW_WIDTH, (v + 0.03) * _LOW_HEIGHT)
        total += light.low_beam * LOW_CD * shape * (cut + 0.008)
    if light.high_beam > 0.0:
        total += light.high_beam * HIGH_CD * _lobes(h * _HIGH_WIDTH, v * _HIGH_HEIGHT)
    if light.fog_lamp > 0.0:
        cut = wp.clamp(quotient(0.5 * blur - 0.015 - v, 0.015 + blur), 0.0, 1.0)
        shape = _lobes(h * _FOG_WIDTH, (v + 0.06) * _FOG_HEIGHT)
        total += light.fog_lamp * FOG_CD * shape * cut
    return total


@wp.func
def headlamp_cd(local: wp.vec3, light: SlotLight) -> wp.float32:
    """Intensity towards ``local``, a point in lamp axes (x forward, y left, z up) [cd]."""
    if local[0] < 0.3:
        return 0.0
    share = reciprocal(local[0])
    return _beam_cd(local[1] * share, local[2] * share, light)


@wp.func
def headlamp_lux(local: wp.vec3, facing: wp.float32, light: SlotLight) -> wp.float32:
    """Illuminance of a surface at ``local``; ``facing``: cosine to the lamp [lx]."""
    if facing <= 0.0:
        return 0.0
    square = dot(local, local)
    fade = decay(light.extinction * root(square))
    return quotient(headlamp_cd(local, light) * facing * fade, wp.max(square, 0.25))


@wp.func
def headlamp_glow(
    eye: wp.vec3, direction: wp.vec3, distance: wp.float32, light: SlotLight
) -> wp.float32:
    """Luminance that fog scatters back from the ego's beams [cd/m^2].

    Single scattering along a ray that nearly follows the beam: the integral of
    b p / (4 pi) I / r^2 e^(-2 b r) from r0 on, with the beam sampled on the ray at three distances.
    ``eye`` and ``direction`` are in lamp axes.
    """
    if light.low_beam + light.high_beam + light.fog_lamp <= 0.0:
        return 0.0
    b = light.extinction
    total = wp.float32(0.0)
    near = wp.float32(2.6)
    for _ in range(3):
        far = wp.min(near * 2.4, distance)
        if far > near:
            middle = 0.5 * (near + far)
            intensity = headlamp_cd(eye + direction * middle, light)
            total += intensity * quotient(far - near, near * far) * decay(2.0 * b * middle)
        near = near * 2.4
    return total * b * (_BACKSCATTER * _SPHERE)


@wp.func
def _lamp_lux(to_lamp: wp.vec3, normal: wp.vec3) -> wp.float32:
    """Illuminance by a luminaire of 1 cd [lx]."""
    square = dot(to_lamp, to_lamp)
    cosine = dot(to_lamp, normal)
    if cosine > 0.0 and to_lamp[2] > 0.0:
        # Luminaires shine downwards: once more the cosine at the lamp, squared.
        down = to_lamp[2] * to_lamp[2]
        return quotient(cosine * down, square * square * root(square))
    return 0.0


@wp.func
def _row_lux(point: wp.vec3, normal: wp.vec3, row: wp.vec2, lamps: StreetLamps) -> wp.float32:
    total = wp.float32(0.0)
    cell = wp.floor(quotient(point[0] - row[0], lamps.spacing))
    for i in range(2):
        x = row[0] + (cell + wp.float32(i)) * lamps.spacing
        to_lamp = wp.vec3(x - point[0], row[1] - point[1], lamps.height - point[2])
        total += _lamp_lux(to_lamp, normal)
    return total


@wp.func
def street_lamp_lux(point: wp.vec3, normal: wp.vec3, lamps: StreetLamps) -> wp.float32:
    """Illuminance by the nearest lamps [lx]."""
    if lamps.scattered != 0:
        total = wp.float32(0.0)
        for i in range(_LAMPS_LIGHTING):
            k = _near_lamp(point[0], point[1], i, lamps)
            if k >= 0:
                at = lamps.at[k]
                to_lamp = wp.vec3(at[0] - point[0], at[1] - point[1], lamps.height - point[2])
                total += _lamp_lux(to_lamp, normal)
        return total * lamps.intensity
    rows = _row_lux(point, normal, lamps.right, lamps) + _row_lux(point, normal, lamps.left, lamps)
    return rows * lamps.intensity


# ---- lamps of the objects ------------------------------------------------------------------------

BEAMS_MAX = 6
"""Vehicles around a camera whose lamps light the scene, the nearest ones."""
_BEAMS_MAX = wp.constant(BEAMS_MAX)
_BEAM_RANGE_M = wp.constant(90.0)
_LAMP_HEIGHT_M = wp.constant(0.68)
_HIGH_BEAM = wp.constant(1 << VehicleLamp.HIGH_BEAM)
# Both lamps together: UN R7 tail lamps have 4 to 17 cd each, brake lamps 60 to 260 cd.
_TAIL_CD = wp.constant(16.0)
_BRAKE_CD = wp.constant(170.0)
_RED = wp.constant(wp.vec3(1.0, 0.04, 0.03))
_FOGGY_PER_M = wp.constant(1.0e-3)


@wp.struct
class LampBeams:
    """Lamps of one vehicle: both headlamps as one, both rear lamps as one."""

    there: wp.int32
    front: wp.vec3
    """World [m]."""
    rear: wp.vec3
    forward: wp.vec3
    up: wp.vec3
    """The vehicle's own upward axis."""
    head: wp.float32
    """Low beam, 1: on."""
    high: wp.float32
    """High beam, 1: on."""
    red: wp.float32
    """Intensity to the rear [cd]."""


@wp.kernel
def beams_kernel(
    # model
    scene: RayScene,
    # state in
    lights: wp.array(dtype=SlotLight),
    poses: wp.array(dtype=SlotPose),
    # out
    beams_out: wp.array2d(dtype=LampBeams),
):
    """The nearest vehicles whose lamps are on [S, BEAMS_MAX], nearest first."""
    slot = wp.tid()
    dark = lights[slot].lamps_on > 0.0
    last = wp.float32(-1.0)
    for b in range(_BEAMS_MAX):
        best = wp.int32(-1)
        nearest = _BEAM_RANGE_M
        if dark and lights[slot].active != 0:
            for m in range(scene.objects.shape[1]):
                pose = scene.objects[slot, m]
                high = wp.float32(pose.lights & _HIGH_BEAM)
                if pose.root != 0 and pose.lamps + pose.brake + high > 0.0:
                    away = wp.length(pose.position - poses[slot].eye)
                    if away > last and away < nearest:
                        nearest = away
                        best = m
        beams = LampBeams()
        if best >= 0:
            pose = scene.objects[slot, best]
            last = nearest
            beams.there = 1
            beams.forward = wp.vec3(pose.cosine, pose.sine, 0.0)
            beams.up = wp.vec3(0.0, 0.0, 1.0)
            if pose.tilt[0] != 0.0 or pose.tilt[2] != 0.0:
                beams.forward = out_of_object(wp.vec3(1.0, 0.0, 0.0), pose)
                beams.up = out_of_object(beams.up, pose)
            up = beams.up * _LAMP_HEIGHT_M
            beams.front = pose.position + beams.forward * pose.half[0] + up
            beams.rear = pose.position - beams.forward * pose.half[0] + up
            beams.head = pose.lamps
            beams.high = wp.where((pose.lights & _HIGH_BEAM) != 0, 1.0, 0.0)
            beams.red = _TAIL_CD * pose.lamps + _BRAKE_CD * pose.brake
        beams_out[slot, b] = beams


@wp.func
def _low_beam_cd(local: wp.vec3) -> wp.float32:
    if local[0] < 0.2:
        return 0.0
    share = reciprocal(local[0])
    h = local[1] * share
    v = local[2] * share
    cut = wp.clamp((-0.004 - v) * _CUT_OFF, 0.0, 1.0)
    return LOW_CD * _lobes(h * _LOW_WIDTH, (v + 0.03) * _LOW_HEIGHT) * (cut + 0.02)


@wp.func
def _high_beam_cd(local: wp.vec3) -> wp.float32:
    if local[0] < 0.2:
        return 0.0
    share = reciprocal(local[0])
    return HIGH_CD * _lobes(local[1] * share * _HIGH_WIDTH, local[2] * share * _HIGH_HEIGHT)


@wp.func
def _head_cd(local: wp.vec3, beam: LampBeams) -> wp.float32:
    """Intensity of a vehicle's headlamps towards a point in their axes [cd]."""
    total = wp.float32(0.0)
    if beam.head > 0.0:
        total = _low_beam_cd(local)
    if beam.high > 0.0:
        total += _high_beam_cd(local)
    return total


@wp.func
def _along(v: wp.vec3, forward: wp.vec3, up: wp.vec3) -> wp.vec3:
    """``v`` in axes whose x is the direction ``forward`` and z the direction ``up``."""
    if up[2] != 1.0:
        return wp.vec3(dot(v, forward), dot(v, wp.cross(up, forward)), dot(v, up))
    return wp.vec3(dot(v, forward), forward[0] * v[1] - forward[1] * v[0], v[2])


@wp.func
def vehicles_lux(
    p: wp.vec3, n: wp.vec3, slot: wp.int32, beams: wp.array2d(dtype=LampBeams)
) -> wp.vec3:
    """Illuminance by the lamps of vehicles [lx]."""
    total = wp.vec3(0.0, 0.0, 0.0)
    for b in range(_BEAMS_MAX):
        if beams[slot, b].there == 0:
            break
        beam = beams[slot, b]
        if beam.head + beam.high > 0.0:
            ray = p - beam.front
            square = wp.max(dot(ray, ray), 0.25)
            share = reciprocal(root(square))
            facing = -dot(ray, n) * share
            if facing > 0.0:
                toward = _head_cd(_along(ray, beam.forward, beam.up), beam)
                total += WARM_WHITE * (toward * facing * (share * share))
        if beam.red > 0.0:
            ray = p - beam.rear
            square = wp.max(dot(ray, ray), 0.25)
            share = reciprocal(root(square))
            behind = -dot(ray, beam.forward) * share
            facing = -dot(ray, n) * share
            if facing > 0.0 and behind > 0.0:
                total += _RED * (beam.red * behind * facing * (share * share))
    return total


@wp.func
def _angle(y: wp.float32, x: wp.float32) -> wp.float32:
    """Angle of (x, y), y > 0, to 2e-3 rad: atan(a) = a (pi / 4 + 0.273 (1 - a)) (Rajan 2006)."""
    size = wp.abs(x)
    a = quotient(wp.min(size, y), wp.max(size, y))
    angle = a * (0.785398 + 0.273 * (1.0 - a))
    if y > size:
        angle = 1.570796 - angle
    if x < 0.0:
        angle = 3.141593 - angle
    return angle


@wp.func
def _halo(
    to: wp.vec3, direction: wp.vec3, distance: wp.float32, extinction: wp.float32
) -> wp.float32:
    """Light of a lamp of 1 cd scattered by the air along a ray: single, isotropic [cd/m^2].

    The integral of b / (4 pi) e^(-b (s + r)) / r^2 along the ray, with the exponential taken at the
    ray's point nearest to the lamp: the rest is the angle under which the lamp sees the ray.
    """
    along = dot(to, direction)
    off = root(wp.max(dot(to, to) - along * along, 0.01))
    arc = _angle(off * distance, off * off - along * (distance - along))
    fade = decay(extinction * (wp.clamp(along, 0.0, distance) + off))
    return quotient(extinction * fade * arc * _SPHERE, off)


@wp.func
def lamps_glow(
    eye: wp.vec3,
    direction: wp.vec3,
    distance: wp.float32,
    slot: wp.int32,
    lamps: StreetLamps,
    beams: wp.array2d(dtype=LampBeams),
    light: SlotLight,
) -> wp.vec3:
    """Glow of street lamps and of vehicles' lamps in fog, rain and snow [cd/m^2]."""
    total = wp.vec3(0.0, 0.0, 0.0)
    if light.lamps_on <= 0.0 or light.extinction < _FOGGY_PER_M:
        return total
    if lamps.scattered != 0:
        for i in range(_LAMPS_GLOWING):
            k = _near_lamp(eye[0], eye[1], i, lamps)
            if k >= 0:
                at = lamps.at[k]
                to = wp.vec3(at[0] - eye[0], at[1] - eye[1], lamps.height - eye[2])
                halo = _halo(to, direction, distance, light.extinction)
                total += SODIUM * (lamps.intensity * halo)
    else:
        for side in range(2):
            row = lamps.right
            if side == 1:
                row = lamps.left
            cell = wp.floor(quotient(eye[0] - row[0], lamps.spacing))
            for i in range(3):
                step = wp.where(direction[0] > 0.0, wp.float32(i), 1.0 - wp.float32(i))
                x = row[0] + (cell + step) * lamps.spacing
                to = wp.vec3(x - eye[0], row[1] - eye[1], lamps.height - eye[2])
                halo = _halo(to, direction, distance, light.extinction)
                total += SODIUM * (lamps.intensity * halo)
    for b in range(_BEAMS_MAX):
        if beams[slot, b].there == 0:
            break
        beam = beams[slot, b]
        if beam.head + beam.high > 0.0:
            to = beam.front - eye
            toward = _head_cd(_along(-to, beam.forward, beam.up), beam)
            total += WARM_WHITE * (toward * _halo(to, direction, distance, light.extinction))
        if beam.red > 0.0:
            to = beam.rear - eye
            if dot(to, beam.forward) > 0.0:
                total += _RED * (beam.red * _halo(to, direction, distance, light.extinction))
    return total
