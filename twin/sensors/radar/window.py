"""Windows in range and speed: how far a scatterer's signal reaches into the cells around it.

A Fourier transform of N samples under a window w answers a tone at cell f with W(k - f) in cell k,
W the window's own transform. Samples count from the window's middle, so W is real. What the
sensor adds up cell by cell is therefore the transform of the sum of all tones, up to the side
lobes, which are left out.
"""

from __future__ import annotations

import math

import numpy as np

from schemas.steady import steady

REACH = 4
"""Cells from a tone at which its signal ends; inside the first zero of the shipped windows."""
STEPS = 64
"""Rows of the table per cell."""


def chebyshev(count: int, sidelobe_db: float) -> np.ndarray:
    """Dolph-Chebyshev window [count], largest value 1: all side lobes ``sidelobe_db`` below.

    Its transform is T_{N-1}(x0 cos(pi k / N)) (Dolph 1946), brought back by an inverse transform.
    """
    order = count - 1
    x0 = math.cosh(math.acosh(10.0 ** (sidelobe_db / 20.0)) / order)
    x = x0 * np.cos(np.pi * np.arange(count) / count)
    inside = np.cos(order * np.arccos(np.clip(x, -1.0, 1.0)))
    outside = np.cosh(order * np.arccosh(np.maximum(np.abs(x), 1.0)))
    sign = np.where((x < 0.0) & (order % 2 == 1), -1.0, 1.0)
    transform = np.where(np.abs(x) <= 1.0, inside, sign * outside)
    cells = np.arange(count)
    middle = np.exp(2j * np.pi * np.outer(cells - 0.5 * order, cells) / count)
    window = (middle @ transform).real
    return np.asarray(window / window.max())


def response(window: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Signal at ``offset`` cells from a tone, 1 in its middle; any shape."""
    time = np.arange(len(window)) - 0.5 * (len(window) - 1)
    phase = np.cos(2.0 * np.pi * np.multiply.outer(offset, time) / len(window))
    return np.asarray(phase @ window / window.sum())


def table(window: np.ndarray) -> np.ndarray:
    """Response at 0, 1 / STEPS, ... REACH cells, float32; rounded, so the same everywhere."""
    values = response(window, np.arange(REACH * STEPS + 2) / STEPS)
    return steady(values, 20).astype(np.float32)


def loss(window: np.ndarray) -> float:
    """Signal over noise that a window leaves of a tone in a cell's middle [-], at most 1."""
    return float(window.sum() ** 2 / (len(window) * (window**2).sum()))


PLACES = 129
"""Rows of the table of :func:`places`."""


def places(window: np.ndarray) -> tuple[np.ndarray, float]:
    """Where between cells a peak lies, by what a parabola through three logarithms says.

    Returns:
        Offsets from the middle cell, float32 [PLACES], at parabola's results from -limit to limit
        in even steps; and the limit.
    """
    offset = np.linspace(-0.6, 0.6, 241)
    low, mid, high = (np.log(response(window, np.abs(offset + k))) for k in (1.0, 0.0, -1.0))
    apex = 0.5 * (low - high) / (low - 2.0 * mid + high)
    limit = 0.6
    grid = np.linspace(-limit, limit, PLACES)
    values = np.interp(grid, apex, offset)
    return np.array([steady(float(v), 24) for v in values], np.float32), limit
