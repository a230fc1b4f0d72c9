"""The sky of a moment as a small table of luminances over the whole upper half of the sphere.

Rows stand at the sine of elevation s^2 with s even from 0 (horizon) to 1 (zenith): half of them
below 15 deg. Columns go around in the square of directions |x| + |y| = 1, which costs a kernel one
division and no angle. The table is a sum, so that sun, moon, clouds and city may stand anywhere.
"""

from __future__ import annotations

import math

import numpy as np

from twin.world.sky import atmosphere

ROWS, COLUMNS = 32, 64
"""Shape of a table."""

SINE = (np.arange(ROWS) / (ROWS - 1)) ** 2
"""Sine of elevation of each row."""


def _around() -> np.ndarray:
    u = 4.0 * np.arange(COLUMNS) / COLUMNS - 1.0
    y = np.where(u <= 1.0, u, 2.0 - u)
    x = np.where(u <= 1.0, 1.0 - np.abs(y), np.abs(y) - 1.0)
    return np.stack([x, y], axis=1) / np.hypot(x, y)[:, None]


HEADING = _around()
"""Horizontal unit vector of each column, world x and y [columns, 2]."""


def _weights() -> np.ndarray:
    """Share of each entry in the illuminance of level ground [rows, columns]: z dz dphi."""
    angle = np.unwrap(np.arctan2(HEADING[:, 1], HEADING[:, 0]))
    closed = np.concatenate([[angle[-1] - 2 * math.pi], angle, [angle[0] + 2 * math.pi]])
    turn = 0.5 * (closed[2:] - closed[:-2])
    dz = np.zeros(ROWS)
    step = np.diff(SINE)
    # Linear between rows, times the sine: integrated exactly.
    dz[:-1] += step * (2.0 * SINE[:-1] + SINE[1:]) / 6.0
    dz[1:] += step * (SINE[:-1] + 2.0 * SINE[1:]) / 6.0
    return dz[:, None] * turn[None, :]


_WEIGHTS = _weights()
_OVERCAST = np.repeat(((1.0 + 2.0 * SINE) / 3.0)[:, None], COLUMNS, axis=1)
_CITY = np.repeat((1.0 + 2.0 * (1.0 - SINE) ** 4)[:, None], COLUMNS, axis=1)


def illuminance_rgb(table: np.ndarray) -> np.ndarray:
    """What a table [rows, columns, 3] gives level ground, linear RGB (3,) [lx]."""
    return np.einsum("rc,rcx->x", _WEIGHTS, table)


def clear(direction: np.ndarray, elevation_rad: float, level: int) -> np.ndarray:
    """Clear sky under a white source of 1 lx in ``direction`` (3,), float64 [rows, columns, 3]."""
    base = atmosphere.sky_for(elevation_rad, level)
    flat = math.hypot(direction[0], direction[1])
    ahead = direction[:2] / flat if flat > 1e-9 else np.array([1.0, 0.0])
    cosine = HEADING @ ahead
    at = np.sqrt(np.clip(0.5 - 0.5 * cosine, 0.0, 1.0)) * (base.shape[1] - 1)
    j = np.minimum(at.astype(np.intp), base.shape[1] - 2)
    share = (at - j)[None, :, None]
    return base[:, j] * (1.0 - share) + base[:, j + 1] * share


def scaled(table: np.ndarray, lux: float) -> np.ndarray:
    """The table at a brightness that gives level ground ``lux`` [lx]."""
    total = float(illuminance_rgb(table) @ atmosphere.LUMINANCE)
    return table * (lux / total) if total > 0.0 else np.zeros_like(table)


def overcast(rgb: np.ndarray, lux: float) -> np.ndarray:
    """CIE overcast sky, three times as bright at the zenith as at the horizon (ISO 15469)."""
    return scaled(_OVERCAST[..., None] * rgb, lux)


def city(rgb: np.ndarray, lux: float) -> np.ndarray:
    """Glow of a city's lamps in its air, brightest low above the houses."""
    return scaled(_CITY[..., None] * rgb, lux)
