"""Returns from the air: where fog, rain and snow send a pulse back, as tables made on the host.

Signals are in units of a white matt surface that fills the beam and faces the sensor at 1 m, in
focus: a surface of reflectance rho at R gives rho cos(i) / R^2, and a scatterer of backscatter
coefficient beta [1/(m sr)] filling the length dr gives pi beta dr / R^2. Out of focus, nearer than
``focus_m``, only (R / focus)^2 of that is caught, which cancels 1 / R^2. A table row has quantiles
of the range at which the return comes, with the signal it has; kernels draw a quantile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lidar import LidarProfile

QUANTILES = 33
"""Columns of a table: quantiles 0 to 1, evenly."""

FOG_EXTINCTIONS_PER_M = np.geomspace(5e-4, 0.5, 40)
"""Rows of the fog table."""
RATES_MM_PER_H = np.geomspace(0.05, 200.0, 40)
"""Rows of the tables of rain and of snow."""

# The receiver sees nothing of the beam nearer than this, all of it from the second on [m]; the
# fields of transmitter and receiver overlap from about 1 m on in bistatic sensors.
_OVERLAP_M = (0.9, 1.0)
_APERTURE_M = 0.010  # width of the beam where it leaves the sensor
_FARTHEST_M = 40.0  # the air's returns from beyond are too weak for any sensor
_DROP_MAX_MM = 8.0

# beta = 0.046 / MOR and alpha = 2.996 / MOR (5 % contrast): backscatter over extinction [1/sr].
_FOG_BACKSCATTER = 0.046 / 2.996

# Lambertian reflectance that sends back what a drop of the same area does: 2 pi / S, for a lidar
# ratio S of 18.8 sr of water drops (O'Connor, Illingworth, Hogan 2004) and about 25 sr of ice; the
# 2 is the extinction efficiency of large particles.
_RAIN_REFLECTANCE, _SNOW_REFLECTANCE = 2.0 * np.pi / 18.8, 2.0 * np.pi / 25.0
_FLAKE_GROWTH = 2.15  # diameter of a flake of density 0.1 g/cm^3 over that of its drop of water


@dataclass(frozen=True, slots=True)
class Scatter:
    """Tables of one profile, float32."""

    fog: np.ndarray
    """[rows, QUANTILES, 2]: range [m] and signal over ``fog_gain`` [-]."""
    drops: np.ndarray
    """[2 rows, QUANTILES, 2]: range [m] and signal [-]; rain, then snow."""
    drops_expected: np.ndarray
    """[2 rows]: drops in the beam that could be detected."""


def threshold(profile: LidarProfile) -> float:
    """Signal that is detected in half of the pulses [-]."""
    return 0.1 / profile.range_10_percent_m**2


def fog_gain(extinction_per_m: float) -> float:
    """pi times the backscatter coefficient of fog [1/m]."""
    return float(np.pi) * _FOG_BACKSCATTER * extinction_per_m


def scatter(profile: LidarProfile) -> Scatter:
    """The tables of ``profile``."""
    fog = np.stack([_fog_row(profile, alpha) for alpha in FOG_EXTINCTIONS_PER_M])
    rows, expected = [], []
    for snow in (False, True):
        for rate in RATES_MM_PER_H:
            row, number = _drop_row(profile, float(rate), snow)
            rows.append(row)
            expected.append(number)
    return Scatter(fog.astype(np.float32), np.stack(rows).astype(np.float32), np.array(expected))


def soft_signal(profile: LidarProfile, alpha: float, range_m: np.ndarray) -> np.ndarray:
    """Signal that fog of extinction ``alpha`` [1/m] sends back from around ``range_m`` over
    ``fog_gain``.

    The lidar equation with the impulse response of a homogeneous medium, overlap(r) e^(-2 a r) /
    max(r, focus)^2, convolved with a sin^2 pulse whose half-power length is ``pulse_m``.
    """
    x, dx = np.linspace(0.0, 2.0 * profile.pulse_m, 201, retstep=True)
    pulse = np.sin(np.pi * x / (2.0 * profile.pulse_m)) ** 2
    at = range_m[:, None] - x
    weight = np.maximum(at, max(profile.focus_m, 1e-3)) ** -2
    low, high = _OVERLAP_M
    overlap = np.clip((at - low) / (high - low), 0.0, 1.0)
    return (pulse * overlap * np.exp(-2.0 * alpha * at) * weight).sum(axis=1) * dx


def _fog_row(profile: LidarProfile, alpha: float) -> np.ndarray:
    """The strongest echo of fog [QUANTILES, 2].

    One pulse length after another scatters on its own, and each is speckled: its signal is
    exponentially distributed around the mean. The cell i is the strongest with probability
    integral f_i(x) prod_{j != i} F_j(x) dx.
    """
    centres = np.arange(max(profile.range_min_m, _OVERLAP_M[0]), _FARTHEST_M, profile.pulse_m)
    centres += 0.5 * profile.pulse_m
    mean = np.maximum(soft_signal(profile, alpha, centres), 1e-12)
    x = np.geomspace(mean.max() * 1e-3, mean.max() * 30.0, 1500)
    below = -np.expm1(-x / mean[:, None])
    others = np.exp(np.log(below).sum(axis=0) - np.log(below))
    density = np.exp(-x / mean[:, None]) / mean[:, None] * others
    share = np.trapezoid(density, x, axis=1)
    signal = np.trapezoid(density * x, x, axis=1) / np.maximum(share, 1e-30)
    edges = np.concatenate([centres - 0.5 * profile.pulse_m, [_FARTHEST_M]])
    return _quantiles(edges, share, centres, signal)


def _drop_row(profile: LidarProfile, rate: float, snow: bool) -> tuple[np.ndarray, float]:
    """Drops that could be detected: range and mean signal [QUANTILES, 2], and how many there are.

    Drop sizes N(D) = N0 e^(-L D): rain after Marshall and Palmer (1948), snow (melted diameters)
    after Gunn and Marshall (1958).
    """
    if snow:
        n0, slope = 3.8e3 * rate**-0.87, 2.55 * rate**-0.48
        growth, reflectance = _FLAKE_GROWTH, _SNOW_REFLECTANCE
    else:
        n0, slope = 8.0e3, 4.1 * rate**-0.21
        growth, reflectance = 1.0, _RAIN_REFLECTANCE
    edges = np.linspace(max(profile.range_min_m, _OVERLAP_M[0]), _FARTHEST_M, 400)
    r = 0.5 * (edges[1:] + edges[:-1])
    wide, high = (_APERTURE_M + 1e-3 * d * r for d in profile.divergence_mrad)
    area = 0.25 * np.pi * wide * high
    # A drop gives reflectance (D^2 / (wide high)) / r^2, out of focus / focus^2; D in mm, melted.
    one_mm = (
        reflectance * (1e-3 * growth) ** 2 / (wide * high) / np.maximum(r, profile.focus_m) ** 2
    )
    smallest = np.minimum(np.sqrt(threshold(profile) / one_mm), _DROP_MAX_MM)
    tail, end = np.exp(-slope * smallest), np.exp(-slope * _DROP_MAX_MM)
    share = area * n0 / slope * np.maximum(tail - end, 0.0) * np.diff(edges)
    # Mean of D^2 above the smallest: of an exponential distribution.
    square = smallest**2 + 2.0 * smallest / slope + 2.0 / slope**2
    expected = float(share.sum())
    return _quantiles(edges, np.maximum(share, 1e-30), r, one_mm * square), expected


def _quantiles(
    edges: np.ndarray, share: np.ndarray, centres: np.ndarray, signal: np.ndarray
) -> np.ndarray:
    """Quantiles of the range, and the signal there [QUANTILES, 2]."""
    total = np.concatenate([[0.0], np.cumsum(share)])
    # Not the very ends: the tails would reach from the first to the last range.
    wanted = np.linspace(0.002, 0.998, QUANTILES)
    ranges = np.interp(wanted, total / total[-1], edges)
    return np.stack([ranges, np.interp(ranges, centres, signal)], axis=1)
