"""A reference line as cubics: short enough that a kernel needs no sine, arc or spiral.

Every geometry of the file is cut in halves until each part is the cubic Hermite interpolant of its
ends, x(d) and y(d) with d the way since its beginning, within :data:`PLACE_M` and
:data:`HEADING_RAD` of the exact line. An arc of radius R needs parts of about R / 20. Curvature is
kept beside them, linear along each part, because second derivatives of interpolants are coarse;
for lines, arcs and spirals it is exact.
"""

from __future__ import annotations

import numpy as np

from twin.road.opendrive.cubic_curve import CubicCurve
from twin.road.opendrive.reference_line import ReferenceLine

PLACE_M = 5e-6
"""Largest error of places that cutting allows [m]; 1e-5 is promised."""
HEADING_RAD = 5e-7
"""Largest error of headings that cutting allows [rad]; 1e-6 is promised."""
CURVATURE_PER_M = 1e-5
"""Largest error of curvatures that cutting allows [1/m], or the same share of them."""
PIECE_M_MIN = 1e-3
"""Shortest part; shorter ones are no further cut [m]."""
LINE_COLUMNS = (
    *("s_m", "x_0", "x_1", "x_2", "x_3", "y_0", "y_1", "y_2", "y_3"),
    *("curvature_per_m", "curvature_rate_per_m2"),
)
"""Columns of a line's parts: where it begins, coefficients of x and y by powers of the way since
then, curvature there and its change per metre."""
_PROBES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_ANGLES_MIN = 1e-12


def line_pieces(line: ReferenceLine, most: int) -> np.ndarray:
    """The parts of a reference line, in order, float64 [P, 11] (:data:`LINE_COLUMNS`).

    Raises:
        ValueError: there would be more than ``most``.
    """
    ends = np.minimum(np.append(line.starts[1:], line.length_m), line.length_m)
    parts: list[np.ndarray] = []
    begin = 0.0
    for index, end in enumerate(ends.tolist()):
        if end > begin or (index == len(ends) - 1 and not parts):
            parts.append(_cut(line, index, begin, end, most))
            most -= len(parts[-1])
        begin = max(begin, end)
    return np.concatenate(parts)


def _cut(line: ReferenceLine, index: int, begin: float, end: float, most: int) -> np.ndarray:
    """Parts of one geometry from station ``begin`` to ``end``."""
    whole = [np.zeros((0, len(LINE_COLUMNS)))]
    low, high = np.array([begin]), np.array([end])
    while len(low):
        if len(low) > most:
            raise ValueError("it bends so much that its tables would be too large")
        rows, close = _hermite(line, index, low, high)
        close |= high - low < 2.0 * PIECE_M_MIN
        whole.append(rows[close])
        middle = 0.5 * (low + high)[~close]
        low, high = (
            np.column_stack([low[~close], middle]).ravel(),
            np.column_stack([middle, high[~close]]).ravel(),
        )
    rows = np.concatenate(whole)
    ordered: np.ndarray = rows[np.argsort(rows[:, 0], kind="stable")]
    return ordered


def _hermite(
    line: ReferenceLine, index: int, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolants between stations, and whether each is close enough."""
    length = high - low
    start, stop = line.on_piece(index, low), line.on_piece(index, high)
    curve = line.curves[index]
    # A curve that is not as long as the file says is stretched.
    speed = curve.stretch if isinstance(curve, CubicCurve) else 1.0
    rows = np.zeros((len(low), len(LINE_COLUMNS)))
    rows[:, 0] = low
    safe = np.maximum(length, _ANGLES_MIN)
    for axis, first in ((0, 1), (1, 5)):
        value, slope = start[axis], speed * start[2 + axis]
        chord, after = (stop[axis] - value) / safe, speed * stop[2 + axis]
        rows[:, first] = value
        rows[:, first + 1] = slope
        rows[:, first + 2] = (3.0 * chord - 2.0 * slope - after) / safe
        rows[:, first + 3] = (slope + after - 2.0 * chord) / (safe * safe)
    rows[:, 9] = start[4]
    rows[:, 10] = (stop[4] - start[4]) / safe
    close = np.ones(len(low), bool)
    for probe in _PROBES.tolist():
        close &= _close(line.on_piece(index, low + probe * length), rows, probe * length)
    return rows, close


def _close(exact: np.ndarray, rows: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    x, y = (rows[:, k] + ahead * (rows[:, k + 1] + ahead * _upper(rows, k, ahead)) for k in (1, 5))
    dx, dy = (
        rows[:, k + 1] + ahead * (2.0 * rows[:, k + 2] + ahead * 3.0 * rows[:, k + 3])
        for k in (1, 5)
    )
    turn = (dy * exact[2] - dx * exact[3]) / np.maximum(np.sqrt(dx * dx + dy * dy), 1e-9)
    bend = np.abs(rows[:, 9] + ahead * rows[:, 10] - exact[4])
    good: np.ndarray = (
        (np.maximum(np.abs(x - exact[0]), np.abs(y - exact[1])) < PLACE_M)
        & (np.abs(turn) < HEADING_RAD)
        & (dx * exact[2] + dy * exact[3] > 0.0)
        & (bend < CURVATURE_PER_M * np.maximum(1.0, np.abs(exact[4])))
    )
    return good


def _upper(rows: np.ndarray, k: int, ahead: np.ndarray) -> np.ndarray:
    upper: np.ndarray = rows[:, k + 2] + ahead * rows[:, k + 3]
    return upper
