"""Lamps: the ego's headlamps, their glow in fog, and street lamps."""

from __future__ import annotations

import warp as wp

from twin.render.light import SlotLight

# Both headlamps together, seen as one source in the middle of the front.
# Order of magnitude of UN R149 lamps: low beam about 20 kcd below its cut-off, high beam 50 kcd.
LOW_CD = wp.constant(22_000.0)
HIGH_CD = wp.constant(50_000.0)
FOG_CD = wp.constant(9_000.0)

WARM_WHITE = wp.constant(wp.vec3(1.0, 0.93, 0.80))
SODIUM = wp.constant(wp.vec3(1.0, 0.76, 0.46))

# Share of light that fog scatters straight back, relative to isotropic scattering.
_BACKSCATTER = wp.constant(0.6)


@wp.struct
class StreetLamps:
    """Two rows of lamps along the street."""

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


@wp.func
def _lobe(offset: wp.float32, width: wp.float32) -> wp.float32:
    q = offset / width
    return 1.0 / ((1.0 + q * q) * (1.0 + q * q))


@wp.func
def _beam_cd(h: wp.float32, v: wp.float32, light: SlotLight) -> wp.float32:
    """Luminous intensity at slope ``h`` to the side and ``v`` up [cd]."""
    total = wp.float32(0.0)
    if light.low_beam > 0.0:
        # Cut-off 1 % below the horizon, softened over 1.2 %.
        cut = wp.clamp((-0.004 - v) / 0.012, 0.0, 1.0)
        total += light.low_beam * LOW_CD * _lobe(h, 0.42) * _lobe(v + 0.03, 0.09) * (cut + 0.008)
    if light.high_beam > 0.0:
        total += light.high_beam * HIGH_CD * _lobe(h, 0.24) * _lobe(v, 0.10)
    if light.fog_lamp > 0.0:
        cut = wp.clamp((-0.015 - v) / 0.015, 0.0, 1.0)
        total += light.fog_lamp * FOG_CD * _lobe(h, 0.80) * _lobe(v + 0.06, 0.10) * cut
    return total


@wp.func
def headlamp_cd(local: wp.vec3, light: SlotLight) -> wp.float32:
    """Intensity towards ``local``, a point in lamp axes (x forward, y left, z up) [cd]."""
    if local[0] < 0.3:
        return 0.0
    return _beam_cd(local[1] / local[0], local[2] / local[0], light)


@wp.func
def headlamp_lux(local: wp.vec3, facing: wp.float32, light: SlotLight) -> wp.float32:
    """Illuminance of a surface at ``local``; ``facing``: cosine to the lamp [lx]."""
    if facing <= 0.0:
        return 0.0
    square = wp.dot(local, local)
    fade = wp.exp(-light.extinction * wp.sqrt(square))
    return headlamp_cd(local, light) * facing * fade / wp.max(square, 0.25)


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
            total += intensity * (1.0 / near - 1.0 / far) * wp.exp(-2.0 * b * middle)
        near = near * 2.4
    return total * b * _BACKSCATTER / (4.0 * wp.pi)


@wp.func
def _row_lux(point: wp.vec3, normal: wp.vec3, row: wp.vec2, lamps: StreetLamps) -> wp.float32:
    total = wp.float32(0.0)
    cell = wp.floor((point[0] - row[0]) / lamps.spacing)
    for i in range(2):
        x = row[0] + (cell + wp.float32(i)) * lamps.spacing
        to_lamp = wp.vec3(x - point[0], row[1] - point[1], lamps.height - point[2])
        square = wp.dot(to_lamp, to_lamp)
        cosine = wp.dot(to_lamp, normal)
        if cosine > 0.0 and to_lamp[2] > 0.0:
            down = to_lamp[2] * to_lamp[2] / square  # luminaires shine downwards
            total += cosine * down / (square * wp.sqrt(square))
    return total


@wp.func
def street_lamp_lux(point: wp.vec3, normal: wp.vec3, lamps: StreetLamps) -> wp.float32:
    """Illuminance by the nearest lamps of both rows [lx]."""
    rows = _row_lux(point, normal, lamps.right, lamps) + _row_lux(point, normal, lamps.left, lamps)
    return rows * lamps.intensity
