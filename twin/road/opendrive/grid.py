"""Numbers that come out the same on every processor.

NumPy's sines and arc tangents differ in their last bits between processors. These are the portable
ones, rounded to a grid far above their last bits and far below what matters; results are rounded
once more, for what else may differ.
"""

from __future__ import annotations

import numpy as np

from twin.base.portable import host

_GRID = 2.0**30
"""Per metre or radian, of results."""
_FINE_GRID = 2.0**44
"""Of sines, which are multiplied by lengths."""


def settled(values: np.ndarray) -> np.ndarray:
    """Results [m or rad] on their grid, 1e-9 apart."""
    return np.rint(values * _GRID) / _GRID


def cosine(angle: float | np.ndarray) -> np.ndarray:
    """Within 3e-14."""
    return np.rint(host.cosine(angle) * _FINE_GRID) / _FINE_GRID


def sine(angle: float | np.ndarray) -> np.ndarray:
    """Within 3e-14."""
    return np.rint(host.sine(angle) * _FINE_GRID) / _FINE_GRID


def sine_cosine(angle: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """:func:`sine` and :func:`cosine` in the time of one of them."""
    up, across = host.sine_cosine(angle)
    return np.rint(up * _FINE_GRID) / _FINE_GRID, np.rint(across * _FINE_GRID) / _FINE_GRID


def chord_share(half: np.ndarray) -> np.ndarray:
    """sin(half) / half, 1 at 0; within 3e-14."""
    return np.rint(host.sine_share(half) * _FINE_GRID) / _FINE_GRID


def angle_of(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Arc tangent of y / x, on the grid of results [rad]."""
    return settled(host.angle_of(y, x))


def turned(angle: np.ndarray) -> np.ndarray:
    """A direction in [-pi, pi) [rad]."""
    wrapped: np.ndarray = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    return wrapped
