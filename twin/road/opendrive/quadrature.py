"""Gauss-Legendre quadrature with twelve nodes, summed in a fixed order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_HALF = np.array(
    [
        (0.1252334085114689, 0.2491470458134028),
        (0.3678314989981802, 0.2334925365383548),
        (0.5873179542866175, 0.2031674267230659),
        (0.7699026741943047, 0.1600783285433462),
        (0.9041172563704749, 0.1069393259953184),
        (0.9815606342467192, 0.0471753363865118),
    ]
)
"""Positive nodes on [-1, 1] and their weights (Abramowitz and Stegun, table 25.4)."""


def integrate(
    function: Callable[[np.ndarray], np.ndarray], start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Integrals of ``function`` from ``start`` to ``end``, arrays of one shape.

    Polynomials up to the 23rd degree come out exactly, but for rounding.
    """
    half = 0.5 * (end - start)
    middle = 0.5 * (end + start)
    total = np.zeros(np.shape(half))
    for node, weight in _HALF:
        total = total + weight * (function(middle - half * node) + function(middle + half * node))
    integral: np.ndarray = half * total
    return integral


def integrate_both(
    functions: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    end: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """:func:`integrate` of two functions, which are asked once, for the nodes of all integrals
    together [12, ...]: the same sums in the same order."""
    half = 0.5 * (end - start)
    middle = 0.5 * (end + start)
    nodes = [middle + sign * (half * node) for node in _HALF[:, 0] for sign in (-1.0, 1.0)]
    one, other = functions(np.stack(nodes))
    totals = np.zeros(np.shape(half)), np.zeros(np.shape(half))
    for k, weight in enumerate(_HALF[:, 1]):
        first, second = 2 * k, 2 * k + 1
        totals = (
            totals[0] + weight * (one[first] + one[second]),
            totals[1] + weight * (other[first] + other[second]),
        )
    return half * totals[0], half * totals[1]
