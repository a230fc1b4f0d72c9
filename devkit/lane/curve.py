"""A lane's centre line near the car as a cubic, and its least-squares fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

Coefficients = tuple[float, float, float, float]

PRIOR = (1.5, 0.3, 0.03, 0.005)
"""Deviations of the coefficients before anything was seen [m, 1, 1/m, 1/m^2]: a car that stands
anywhere in its lane is more usual than a narrow bend."""
_NOISE_M = 0.1
"""Deviation of a point of weight 1 [m]."""


@dataclass(frozen=True, slots=True)
class LaneCurve:
    """y = a + b x + c x^2/2 + d x^3/6 in the vehicle's axes: x forward from the rear axle, y left.

    The third-order curve of Dickmanns and Mysliwetz (1992): offset, heading, curvature and its
    change along the way.
    """

    coefficients: Coefficients = (0.0, 0.0, 0.0, 0.0)
    """a [m], b [-], c [1/m], d [1/m^2]."""

    def left_m(self, ahead_m: Any) -> Any:
        """Position of the centre line at one or many distances before the rear axle [m]."""
        a, b, c, d = self.coefficients
        return a + ahead_m * (b + ahead_m * (c / 2.0 + ahead_m * (d / 6.0)))

    def slope(self, ahead_m: Any) -> Any:
        """Direction of the centre line: tangent of the angle to the vehicle's axis [-]."""
        _, b, c, d = self.coefficients
        return b + ahead_m * (c + ahead_m * (d / 2.0))

    def stretch(self, ahead_m: np.ndarray) -> np.ndarray:
        """Distance of a parallel line straight to the left, over that on a straight lane [-]."""
        slope = self.slope(ahead_m)
        stretch: np.ndarray = np.sqrt(1.0 + slope * slope)
        return stretch

    def bend_per_m(self, ahead_m: float) -> float:
        """Curvature of the arc that leaves the car along the lane and meets it there [1/m]."""
        a, b, _, _ = self.coefficients
        return 2.0 * (self.left_m(ahead_m) - a - b * ahead_m) / (ahead_m * ahead_m)


def fit(ahead_m: np.ndarray, left_m: np.ndarray, weight: np.ndarray) -> LaneCurve:
    """The cubic nearest to points of the centre line [P], by weighted least squares with a prior.

    The normal equations hold the moments of the points; NumPy's own sums keep their order.
    """
    powers = [weight]
    for _ in range(6):
        powers.append(powers[-1] * ahead_m)
    moments = [float(power.sum()) for power in powers]
    sides = [float((power * left_m).sum()) for power in powers[:4]]
    scale = [1.0, 1.0, 2.0, 6.0]
    matrix = [[moments[i + j] / (scale[i] * scale[j]) for j in range(4)] for i in range(4)]
    for i, deviation in enumerate(PRIOR):
        matrix[i][i] += (_NOISE_M / deviation) ** 2
    return LaneCurve(_solved(matrix, [sides[i] / scale[i] for i in range(4)]))


def _solved(matrix: list[list[float]], side: list[float]) -> Coefficients:
    """Cholesky's method for four unknowns; the prior keeps the matrix positive definite."""
    lower = [[0.0] * 4 for _ in range(4)]
    half = [0.0] * 4
    for i in range(4):
        for j in range(i + 1):
            rest = matrix[i][j] - sum(lower[i][k] * lower[j][k] for k in range(j))
            lower[i][j] = math.sqrt(rest) if i == j else rest / lower[j][j]
        half[i] = (side[i] - sum(lower[i][k] * half[k] for k in range(i))) / lower[i][i]
    solution = [0.0] * 4
    for i in reversed(range(4)):
        rest = half[i] - sum(lower[k][i] * solution[k] for k in range(i + 1, 4))
        solution[i] = rest / lower[i][i]
    return (solution[0], solution[1], solution[2], solution[3])
