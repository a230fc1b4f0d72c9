"""Clear sky by look-up tables: single and multiple scattering of sunlight in a round atmosphere.

After Hillaire, *A Scalable and Production Ready Sky and Atmosphere Rendering Technique* (2020):
a table of transmittances, one of the light that is scattered more than once (isotropic, infinitely
many orders by a geometric series), then a march along each direction of the sky. Constants of air,
Bruneton 2017: Rayleigh scattering (5.802, 13.558, 33.1)e-6 /m at 680, 550 and 440 nm falling over
8 km; ozone absorbs 1.881e-6 /m at 550 nm in a tent of 15 km around 25 km. That spread of
wavelengths stands for the negative lobes of sRGB's matching functions and gives the zenith its
measured blue; but ozone absorbs where red's primary is, at 611 nm, and not at 680, else twilight
turns purple (cross sections 4.9, 3.3, 0.17e-21 cm^2 at 611, 550 and 450 nm, Serdyuchenko et al.
2014). Aerosol falls over 1.2 km, with the phase function of Cornette and Shanks (g = 0.8) and a
scattering share of 0.9; its density follows the weather's visibility.

Why not Hosek-Wilkie or Preetham: both are fits for a sun above the horizon. Dawn and dusk need a
sky for a sun below it, the moon is a second sun, and all of it has to move continuously. Measured
against the illuminances of the Illuminating Engineering Society and of twilight in the tests.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from twin.world.kept import kept

SUN_LX = 133_100.0
"""Illuminance of the sun above the atmosphere [lx]."""
SUN_RGB = np.array([1.1127, 0.9755, 0.9122])
"""Colour of a black body of 5778 K, linear sRGB of luminance 1."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear sRGB (IEC 61966-2-1)."""

HAZES_PER_M = tuple(float(h) for h in np.geomspace(0.4e-4, 3.2e-4, 7))
"""Aerosol extinctions at the ground that there are tables for [1/m]."""
ELEVATION_STEP_RAD = math.radians(0.1)
"""Tables are made for elevations on this grid."""
SKIES_MAX = 2048
"""Skies that are kept on the disk, of 19 kB each: a first one takes 12 ms, a kept one 0.2."""

_GROUND, _TOP = 6_360_000.0, 6_460_000.0
_EYE_M = 200.0
_RAYLEIGH = np.array([5.802e-6, 13.558e-6, 33.1e-6])
_OZONE = 1.881e-6 * np.array([4.9, 3.3, 0.17]) / 3.3
_AEROSOL_ALBEDO = 0.9
_G = 0.8
_ALBEDO = 0.15  # of the ground
_ROWS, _COLUMNS = 32, 25
_PENUMBRA = 0.009
_LOWEST_RAD = math.radians(-12.0)


def haze_level(extinction_per_m: float) -> int:
    """Index of :data:`HAZES_PER_M` nearest to an extinction of clear air, in the logarithm."""
    step = math.log(HAZES_PER_M[1] / HAZES_PER_M[0])
    level = round(math.log(max(extinction_per_m, 1e-9) / HAZES_PER_M[0]) / step)
    return max(0, min(len(HAZES_PER_M) - 1, level))


def sky_for(elevation_rad: float, level: int) -> np.ndarray:
    """Luminance of the sky over a source of 1 lx above the atmosphere, white [1/sr].

    Returns:
        float64 [rows, columns, 3]: row i at the sine of elevation (i / (rows - 1))^2, column j at
        sin(azimuth / 2) = j / (columns - 1) from the source. Read only.
    """
    return _sky_for(round(max(elevation_rad, _LOWEST_RAD) / ELEVATION_STEP_RAD), level)


def sunlight_left(elevation_rad: float, level: int) -> np.ndarray:
    """Share of a source's light that comes through the atmosphere to the ground (3,) [-]."""
    if elevation_rad < math.radians(-1.0):
        return np.zeros(3)
    sine = np.array([math.sin(max(elevation_rad, math.radians(0.1)))])
    return _transmitted(_tables(level)[0], np.array([_GROUND + _EYE_M]), sine)[0]


@functools.lru_cache(maxsize=1024)
def _sky_for(elevation_steps: int, level: int) -> np.ndarray:
    key = b"%d %d" % (elevation_steps, level)
    table = kept("skies", key, lambda: _sky(elevation_steps, level), SKIES_MAX)
    table.flags.writeable = False
    return table


def _sky(elevation_steps: int, level: int) -> np.ndarray:
    transmittance, multiple = _tables(level)
    elevation = elevation_steps * ELEVATION_STEP_RAD
    sine = (np.arange(_ROWS) / (_ROWS - 1)) ** 2
    half = np.arange(_COLUMNS) / (_COLUMNS - 1)
    cos_azimuth = 1.0 - 2.0 * half * half
    mu = np.repeat(sine, _COLUMNS)
    along = np.sqrt(1.0 - sine * sine)[:, None] * cos_azimuth[None, :]
    cosine = (along * math.cos(elevation) + sine[:, None] * math.sin(elevation)).ravel()
    light = _march(mu, cosine, math.sin(elevation), level, transmittance, multiple, 40)
    return light.reshape(_ROWS, _COLUMNS, 3)


def _march(
    mu: np.ndarray,
    cosine: np.ndarray,
    sun_sine: float,
    level: int,
    transmittance: np.ndarray,
    multiple: np.ndarray,
    steps: int,
) -> np.ndarray:
    """Light scattered towards the eye along rays [N, 3]; ``mu``: sine of elevation, ``cosine``:
    of the angle to the sun."""
    r = _GROUND + _EYE_M
    far = -r * mu + np.sqrt((r * mu) ** 2 + _TOP**2 - r * r)
    edges = (np.arange(steps + 1) / steps) ** 1.7
    middle = 0.5 * (edges[1:] + edges[:-1])[None, :] * far[:, None]
    length = np.diff(edges)[None, :] * far[:, None]
    height = np.sqrt(r * r + middle * middle + 2.0 * r * mu[:, None] * middle)
    # The sun's elevation seen from a sample: the ray's way turns the vertical by a little.
    sun_along = cosine[:, None] * middle + r * sun_sine
    local = np.clip(sun_along / height, -1.0, 1.0)
    rayleigh, aerosol, extinction = _medium(height, level)
    direct = _transmitted(transmittance, height, local)
    phase_r = 3.0 / (16.0 * math.pi) * (1.0 + cosine * cosine)
    square = _G * _G
    phase_m = 3.0 / (8.0 * math.pi) * (1.0 - square) / (2.0 + square) * (1.0 + cosine * cosine)
    phase_m = phase_m / (1.0 + square - 2.0 * _G * cosine) ** 1.5
    source = rayleigh * phase_r[:, None, None] + (aerosol * phase_m[:, None])[..., None]
    source = source * direct
    source += (rayleigh + aerosol[..., None]) * _scattered(multiple, height, local)
    depth = extinction * length[..., None]
    passed = np.exp(-depth)
    before = np.exp(-(np.cumsum(depth, axis=1) - depth))
    return np.sum(before * source * (1.0 - passed) / extinction, axis=1)


def _medium(height: np.ndarray, level: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rayleigh scattering [..., 3], aerosol scattering [...], extinction [..., 3] [1/m]."""
    up = np.maximum(height - _GROUND, 0.0)
    rayleigh = np.exp(-up / 8000.0)[..., None] * _RAYLEIGH
    haze = HAZES_PER_M[level] * np.exp(-up / 1200.0)
    ozone = np.maximum(0.0, 1.0 - np.abs(up - 25_000.0) / 15_000.0)[..., None] * _OZONE
    return rayleigh, _AEROSOL_ALBEDO * haze, rayleigh + haze[..., None] + ozone


_T_HEIGHTS, _T_ANGLES = 48, 192
_M_HEIGHTS, _M_ANGLES = 10, 32


@functools.lru_cache(maxsize=len(HAZES_PER_M))
def _tables(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Transmittance [heights, angles, 3] and multiple scattering [heights, angles, 3]."""
    return kept("air", b"%d" % level, lambda: _air(level))


def _air(level: int) -> tuple[np.ndarray, np.ndarray]:
    # Bruneton's mapping: distance to the horizon, and distance to the top along the ray.
    rho = np.linspace(0.0, 1.0, _T_HEIGHTS) * math.sqrt(_TOP**2 - _GROUND**2)
    r = np.sqrt(rho * rho + _GROUND**2)
    nearest = _TOP - r
    farthest = rho + math.sqrt(_TOP**2 - _GROUND**2)
    share = np.linspace(0.0, 1.0, _T_ANGLES)
    d = nearest[:, None] + share[None, :] * (farthest - nearest)[:, None]
    safe = np.maximum(d, 1e-3)
    mu = np.clip((_TOP**2 - (r * r)[:, None] - d * d) / (2.0 * r[:, None] * safe), -1.0, 1.0)
    total = np.zeros((_T_HEIGHTS, _T_ANGLES, 3))
    steps = 40
    for i in range(steps):
        t = (i + 0.5) / steps * d
        height = np.sqrt((r * r)[:, None] + t * t + 2.0 * r[:, None] * mu * t)
        total += _medium(height, level)[2] * (d / steps)[..., None]
    transmittance = np.exp(-total)
    return transmittance, _multiple(transmittance, level)


def _multiple(transmittance: np.ndarray, level: int) -> np.ndarray:
    """Logarithm of the light of all orders from the second on, for isotropic scattering, over the
    source's: it falls exponentially once the sun is down, and is interpolated so."""
    up = np.linspace(0.0, 1.0, _M_HEIGHTS) ** 2 * 0.99 * (_TOP - _GROUND) + 10.0
    sun = np.linspace(-0.35, 1.0, _M_ANGLES)
    count, steps = 32, 16
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    turn = index * math.pi * (3.0 - math.sqrt(5.0))  # a golden spiral: even over the sphere
    x = np.sqrt(1.0 - z * z) * np.cos(turn)
    r = (_GROUND + up)[:, None]
    ground = (r * z) ** 2 - (r * r - _GROUND**2)
    hits = (ground > 0.0) & (z < 0.0)
    top = -r * z + np.sqrt((r * z) ** 2 + _TOP**2 - r * r)
    far = np.where(hits, -r * z - np.sqrt(np.maximum(ground, 0.0)), top)  # [H, D]
    light = np.zeros((_M_HEIGHTS, _M_ANGLES, 3))
    again = np.zeros((_M_HEIGHTS, 3))
    passed = np.ones((_M_HEIGHTS, count, 3))
    sun_x = np.sqrt(1.0 - sun * sun)
    cosine = x[:, None] * sun_x[None, :] + z[:, None] * sun[None, :]  # [D, A]
    length = far / steps
    for i in range(steps):
        t = (i + 0.5) * length
        height = np.sqrt(r * r + t * t + 2.0 * r * z * t)
        rayleigh, aerosol, extinction = _medium(height, level)
        scattering = rayleigh + aerosol[..., None]
        segment = np.exp(-extinction * length[..., None])
        gain = passed * scattering * (1.0 - segment) / extinction
        local = np.clip(
            (cosine[None] * t[..., None] + r[..., None] * sun) / height[..., None], -1, 1
        )
        direct = _transmitted(transmittance, np.broadcast_to(height[..., None], local.shape), local)
        light += np.einsum("hdc,hdac->hac", gain, direct) / (4.0 * math.pi * count)
        again += gain.sum(axis=1) / count
        passed = passed * segment
    floor = _transmitted(transmittance, np.full(_M_ANGLES, _GROUND + 1.0), sun)
    lit = floor * np.maximum(sun, 0.0)[:, None] * (_ALBEDO / math.pi)
    light += np.einsum("hdc,ac->hac", passed * hits[..., None], lit) / count
    return np.log(np.maximum(light / (1.0 - again)[:, None, :], 1e-30))


def _transmitted(table: np.ndarray, height: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Share of light that passes from outside to ``height`` [...] at sine ``mu``: [..., 3].

    Zero below the horizon, softened over a little more than the sun and its refraction: steps
    along a ray leave the shadow one by one.
    """
    r = np.clip(height, _GROUND, _TOP)
    rho = np.sqrt(r * r - _GROUND**2)
    ground = (r * mu) ** 2 - rho * rho
    d = -r * mu + np.sqrt((r * mu) ** 2 + _TOP**2 - r * r)
    horizon = math.sqrt(_TOP**2 - _GROUND**2)
    nearest, farthest = _TOP - r, rho + horizon
    v = rho / horizon * (_T_HEIGHTS - 1)
    u = np.clip((d - nearest) / (farthest - nearest), 0.0, 1.0) * (_T_ANGLES - 1)
    value = _bilinear(table, v, u)
    below = np.sqrt(np.maximum(ground, 0.0)) / r  # sine of the dip under the horizon
    seen = np.where(mu >= 0.0, 1.0, np.clip(1.0 - below / _PENUMBRA, 0.0, 1.0))
    return value * np.where(ground < 0.0, 1.0, seen)[..., None]


def _scattered(table: np.ndarray, height: np.ndarray, mu: np.ndarray) -> np.ndarray:
    up = np.clip((height - _GROUND - 10.0) / (0.99 * (_TOP - _GROUND)), 0.0, 1.0)
    v = np.sqrt(up) * (_M_HEIGHTS - 1)
    u = np.clip((mu + 0.35) / 1.35, 0.0, 1.0) * (_M_ANGLES - 1)
    return np.exp(_bilinear(table, v, u))


def _bilinear(table: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    rows, columns, _ = table.shape
    i = np.minimum(v.astype(np.intp), rows - 2)
    j = np.minimum(u.astype(np.intp), columns - 2)
    a, b = (v - i)[..., None], (u - j)[..., None]
    flat = table.reshape(-1, 3)
    at = i * columns + j
    low = flat[at] * (1.0 - b) + flat[at + 1] * b
    high = flat[at + columns] * (1.0 - b) + flat[at + columns + 1] * b
    return low * (1.0 - a) + high * a
