"""Smooth lines cut into pieces of cubic polynomials of the way.

A piece is the cubic Hermite curve through the places and directions at its ends, and its heading
the cubic through the headings and curvatures there. Pieces are halved until what lies between is
within :data:`PLACE_TOLERANCE_M` and :data:`ANGLE_TOLERANCE_RAD` of the line at nine points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.clothoid import clothoid
from twin.road.opendrive.grid import cosine, settled, sine
from twin.scenario.storyboard.program.places import FixedPosition, TrajectoryPiece

PLACE_TOLERANCE_M = 2e-6
ANGLE_TOLERANCE_RAD = 2e-7
PIECES_MAX = 20_000
"""Pieces of one trajectory."""
_LENGTH_MIN_M = 1e-6
_CHECKS = np.arange(1, 10) / 10.0
_CURVATURE_GRID = 2.0**40
"""Per 1/m; coefficients come out the same on every processor."""

Coefficients = tuple[float, float, float, float]


class LinePoints(NamedTuple):
    """Points of a line; arrays of one shape."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    slope_z: np.ndarray
    """Rise per metre of the way."""
    heading_rad: np.ndarray
    """Unwrapped."""
    curvature_per_m: np.ndarray
    """Change of the heading per metre of the way."""


class CurvePiece(NamedTuple):
    """A piece between two stations of a line."""

    start_m: float
    length_m: float
    x: Coefficients
    y: Coefficients
    z: Coefficients
    heading: Coefficients


Line = Callable[[np.ndarray], LinePoints]
"""Points of a line at stations [m]."""


def cut(line: Line, knots: np.ndarray) -> list[CurvePiece]:
    """Pieces of a line, smooth between the knots.

    Args:
        line: gives its points; the heading is that of the way.
        knots: stations at which it may have corners, the ends among them; rising [m].

    Raises:
        ValueError: more than :data:`PIECES_MAX` pieces are needed.
    """
    low, high = knots[:-1], knots[1:]
    kept = high - low > _LENGTH_MIN_M
    low, high = low[kept], high[kept]
    pieces: list[CurvePiece] = []
    while len(low):
        fitted, close = _fitted(line, low, high)
        pieces += [piece for piece, fits in zip(fitted, close.tolist(), strict=True) if fits]
        if len(pieces) + 2 * int((~close).sum()) > PIECES_MAX:
            raise ValueError(f"its shape needs more than {PIECES_MAX} pieces")
        low, high = low[~close], high[~close]
        middle = 0.5 * (low + high)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return sorted(pieces)


def _fitted(line: Line, low: np.ndarray, high: np.ndarray) -> tuple[list[CurvePiece], np.ndarray]:
    """Pieces between stations, and which of them are close enough."""
    length = high - low
    # Inside the ends, so that a corner belongs to neither side.
    inside = 1e-9 * length
    ends = line(np.stack([low + inside, high - inside]))
    heading_rad, climb = settled(ends.heading_rad), settled(ends.slope_z)
    curvature = np.rint(ends.curvature_per_m * _CURVATURE_GRID) / _CURVATURE_GRID
    level = np.sqrt(np.maximum(1.0 - climb * climb, 0.0))
    x = hermite(settled(ends.x_m), cosine(heading_rad) * level, length)
    y = hermite(settled(ends.y_m), sine(heading_rad) * level, length)
    z = hermite(settled(ends.z_m), climb, length)
    heading = hermite(heading_rad, curvature, length)
    ahead = _CHECKS[:, None] * length
    true = line(low + ahead)
    off = np.maximum(np.abs(value(x, ahead) - true.x_m), np.abs(value(y, ahead) - true.y_m))
    turn = np.abs(value(heading, ahead) - true.heading_rad)
    close = (off.max(axis=0) < PLACE_TOLERANCE_M) & (turn.max(axis=0) < ANGLE_TOLERANCE_RAD)
    columns = [np.stack(c, axis=1).tolist() for c in (x, y, z, heading)]
    pieces = [
        CurvePiece(start, span, *(_coefficients(row) for row in rows))
        for start, span, *rows in zip(low.tolist(), length.tolist(), *columns, strict=True)
    ]
    return pieces, close | (length < 2.0 * _LENGTH_MIN_M)


def _coefficients(row: list[float]) -> Coefficients:
    a, b, c, d = row
    return a, b, c, d


def hermite(
    values: np.ndarray, slopes: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The cubics with these values and slopes [2, N] at 0 and at ``length`` [N]."""
    (v0, v1), (d0, d1) = values, slopes
    rise = (v1 - v0) / length
    last = (d0 + d1 - 2.0 * rise) / (length * length)
    return v0, d0, (3.0 * rise - 2.0 * d0 - d1) / length, last


def value(c: tuple[np.ndarray, ...], ahead: np.ndarray) -> np.ndarray:
    """Polynomials at distances from the beginning of their pieces."""
    total: np.ndarray = c[0] + ahead * (c[1] + ahead * (c[2] + ahead * c[3]))
    return total


def trajectory_piece(piece: CurvePiece, start_s_m: float) -> TrajectoryPiece:
    """A piece of a line as one of a trajectory, along which the line begins at ``start_s_m``."""
    return TrajectoryPiece(
        start_s_m + piece.start_m, piece.length_m, piece.x, piece.y, piece.z, piece.heading
    )


def spiral(
    start: FixedPosition, curvature_per_m: tuple[float, float], length_m: float, start_s_m: float
) -> tuple[TrajectoryPiece, ...]:
    """A clothoid from a place on, level with it, between two curvatures; along a trajectory it
    begins at ``start_s_m``."""
    curve = clothoid(*curvature_per_m, length_m)
    c, si = float(cosine(start.heading_rad)), float(sine(start.heading_rad))

    def line(s_m: np.ndarray) -> LinePoints:
        u, v = curve.at(s_m)
        level = np.zeros(s_m.shape)
        return LinePoints(
            start.x_m + c * u - si * v,
            start.y_m + si * u + c * v,
            level + start.z_m,
            level,
            start.heading_rad + curve.heading(s_m),
            curve.curvature + curve.rate * s_m,
        )

    pieces = cut(line, np.array([0.0, length_m]))
    return tuple(trajectory_piece(piece, start_s_m) for piece in pieces)


def place_on(piece: TrajectoryPiece, ahead_m: float) -> FixedPosition:
    """The place so far along a piece of a trajectory, headed along it."""
    x, y, z, heading = (
        c[0] + ahead_m * (c[1] + ahead_m * (c[2] + ahead_m * c[3]))
        for c in (piece.x, piece.y, piece.z, piece.heading)
    )
    return FixedPosition(x, y, z, heading)


def end_of(piece: TrajectoryPiece) -> FixedPosition:
    """Where a piece of a trajectory ends, headed along it."""
    return place_on(piece, piece.length_m)
