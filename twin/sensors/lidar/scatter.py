"""Returns from the air: where fog, rain and snow send a pulse back, as tables made on the host.

Signals are in units of a white matt surface that fills the beam and faces the sensor at 1 m, in
focus: a surface of reflectance rho at R gives rho cos(i) / R^2, and a scatterer of backscatter
coefficient beta [1/(m sr)] filling the length dr gives pi beta dr / R^2. Nearby a part of it misses
the detector (:mod:`twin.sensors.lidar.near_field`). A table row has quantiles of the range at which
the return comes, with the signal it has; kernels draw a quantile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.sections.lidar import LidarProfile
from schemas.steady import steady
from twin.sensors.lidar.hydrometeors import DIAMETERS_MM, Fall, fall, target_mm2
from twin.sensors.lidar.near_field import NearField, beam_size, near_field

QUANTILES = 33
"""Columns of a table: quantiles 0 to 1, evenly."""

FOG_EXTINCTIONS_PER_M = np.geomspace(5e-4, 0.5, 40)
"""Rows of the fog table."""
RATES_MM_PER_H = np.geomspace(0.05, 200.0, 40)
"""Rows of the tables of rain and of snow."""

_FARTHEST_M = 60.0  # the air's returns from beyond are too weak for any sensor
_LEVELS = 14  # of the signal, for which echo is the strongest
_RARE = 1e-9  # echoes that no case will have

# Backscatter over extinction of fog droplets at 905 nm [1/sr], one over their lidar ratio
# (O'Connor, Illingworth, Hogan 2004: 18.8 sr; Mie's theory: 19 to 31 sr for 20 to 10 micrometres).
_FOG_BACKSCATTER = 1.0 / 18.8


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
    cells = np.arange(profile.range_min_m, _FARTHEST_M, profile.pulse_m) + 0.5 * profile.pulse_m
    echoes = np.maximum(soft_signal(profile, FOG_EXTINCTIONS_PER_M, cells), 1e-12)
    fog = np.stack([_fog_row(cells, mean) for mean in echoes])
    edges = _edges(profile, 121)
    middle = 0.5 * (edges[1:] + edges[:-1])
    air = near_field(profile, middle)
    rows, expected = [], []
    for snow in (False, True):
        target = target_mm2(profile, snow=snow)
        for rate in RATES_MM_PER_H:
            row, number = _drop_row(profile, fall(float(rate), snow=snow), target, edges, air)
            rows.append(row)
            expected.append(number)
    # Exponentials end in other last bits on other hosts.
    fog, drops = (steady(table, 20).astype(np.float32) for table in (fog, np.stack(rows)))
    return Scatter(fog, drops, steady(expected, 20))


def soft_signal(profile: LidarProfile, alpha_per_m: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Signal that fog of each extinction [A] sends back from around each range [R], over
    ``fog_gain`` [A, R].

    The lidar equation with the impulse response of a homogeneous medium, caught(r) e^(-2 a r) /
    r^2, convolved with a sin^2 pulse whose half-power length is ``pulse_m``. What comes from nearer
    than ``range_min_m`` is not listened to.
    """
    x, dx = np.linspace(0.0, 2.0 * profile.pulse_m, 101, retstep=True)
    pulse = np.sin(np.pi * x / (2.0 * profile.pulse_m)) ** 2
    at = range_m[:, None] - x
    table = np.geomspace(profile.range_min_m, 2.0 * _FARTHEST_M, 200)
    caught = np.interp(at, table, near_field(profile, table).mean, left=0.0)
    weight = pulse * caught / np.maximum(at, profile.range_min_m) ** 2 * dx
    return np.stack([(weight * np.exp(-2.0 * a * at)).sum(axis=1) for a in alpha_per_m])


def _fog_row(centres: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The strongest of the echoes of ``mean`` signal from cells around ``centres`` [QUANTILES, 2].

    One pulse length after another scatters on its own, and each is speckled: its signal is
    exponentially distributed around the mean. The cell i is the strongest with probability
    integral f_i(x) prod_{j != i} F_j(x) dx.
    """
    x = np.geomspace(mean.max() * 1e-3, mean.max() * 30.0, 1500)
    below = -np.expm1(-x / mean[:, None])
    others = np.exp(np.log(below).sum(axis=0) - np.log(below))
    density = np.exp(-x / mean[:, None]) / mean[:, None] * others
    share = np.trapezoid(density, x, axis=1)
    signal = np.trapezoid(density * x, x, axis=1) / np.maximum(share, 1e-30)
    half = 0.5 * (centres[1] - centres[0])
    edges = np.append(centres - half, centres[-1] + half)
    return _quantiles(edges, share, centres, signal)


def _edges(profile: LidarProfile, count: int) -> np.ndarray:
    """Ranges between which echoes of drops are told apart [m], closer together nearby."""
    return np.geomspace(profile.range_min_m, max(_FARTHEST_M, 2.0 * profile.range_min_m), count)


def _drop_row(
    profile: LidarProfile, of: Fall, target_mm2: np.ndarray, edges: np.ndarray, air: NearField
) -> tuple[np.ndarray, float]:
    """The echo that is kept of drops which could be detected: range and mean signal
    [QUANTILES, 2], and how many there are to choose from.

    Drops are a Poisson process in space, size and place within the beam. With the strongest return,
    an echo of a signal between two levels is kept where no echo is above: e^(-number above).
    """
    r = 0.5 * (edges[1:] + edges[:-1])
    wide, high = beam_size(profile, r)
    passes = np.exp(-2.0 * of.extinction_per_m * r)
    # Signal of a drop of reflectance 1 and of 1 mm^2, for each piece of the beam [R, P].
    one_mm2 = 1e-6 * air.irradiance * air.caught * (passes / (wide * high * r**2))[:, None]
    levels = threshold(profile) * np.geomspace(1.0, 1e4, _LEVELS)
    number = np.zeros((_LEVELS, len(r)))  # echoes above a level per range
    for k, level in enumerate(levels):
        needed = level / np.maximum(one_mm2, 1e-30)
        smallest = np.interp(needed, target_mm2, DIAMETERS_MM, right=DIAMETERS_MM[-1])
        number[k] = of.above(smallest).sum(axis=1) * air.piece_m2 * np.diff(edges)
        if number[k].sum() < _RARE:
            break
    expected = float(number[0].sum())
    between = np.maximum(number[:-1] - number[1:], 0.0)
    middle = np.sqrt(levels[1:] * levels[:-1])[:, None]
    if profile.returns == "strongest":
        kept = np.exp(-number[1:].sum(axis=1))[:, None] * between
    else:
        before = np.cumsum(number[0]) - number[0]
        if profile.returns == "last":
            before = expected - before - number[0]
        kept = between * np.exp(-before)
    share = np.maximum(kept.sum(axis=0), 1e-30)
    signal = np.maximum((kept * middle).sum(axis=0) / share, levels[0])
    return _quantiles(edges, share, r, signal), expected


def _quantiles(
    edges: np.ndarray, share: np.ndarray, centres: np.ndarray, signal: np.ndarray
) -> np.ndarray:
    """Quantiles of the range, and the signal there [QUANTILES, 2]."""
    total = np.concatenate([[0.0], np.cumsum(share)])
    # Not the very ends: the tails would reach from the first to the last range.
    wanted = np.linspace(0.002, 0.998, QUANTILES)
    ranges = np.interp(wanted, total / total[-1], edges)
    return np.stack([ranges, np.interp(ranges, centres, signal)], axis=1)
