"""Bodies of a road file's objects in the world, without looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.furniture import RoadObject
from twin.road.opendrive.grid import cosine, sine


@dataclass(frozen=True, slots=True)
class StandingBody:
    """A box or a cylinder."""

    thing: RoadObject
    road: str
    """Id of its road."""
    position_m: tuple[float, float, float]
    """Middle of its underside, world."""
    heading_rad: float
    pitch_rad: float
    roll_rad: float
    size_m: tuple[float, float, float]
    """Length, width and height; 0: not given."""
    radius_m: float
    """Above 0 for a cylinder."""
    above_m: float
    """Least height of its underside above the road's surface [m]."""
    inward_rad: float
    """Direction to the reference line, world."""
    number: int
    """Which copy of the object it is, from 0."""


@dataclass(frozen=True, slots=True)
class OutlineBody:
    """What an outline encloses; an open one is a wall along it."""

    thing: RoadObject
    road: str
    base_m: np.ndarray
    """Corners of the underside, world, float64 [N, 3]."""
    height_m: np.ndarray
    """Of the body above each corner, float64 [N] [m]."""
    above_m: float
    """Least height of its underside above the road's surface [m]."""
    closed: bool


@dataclass(frozen=True, slots=True)
class SweptBody:
    """A body drawn along a road, such as a guard rail."""

    thing: RoadObject
    road: str
    left_m: np.ndarray
    """Left edge of the underside as seen along s, world, float64 [N, 3]."""
    right_m: np.ndarray
    height_m: np.ndarray
    """float64 [N] [m]"""
    above_m: float
    """Least height of its underside above the road's surface [m]."""


RoadsideBody = StandingBody | OutlineBody | SweptBody


def body_axes(heading_rad: float, pitch_rad: float, roll_rad: float) -> np.ndarray:
    """World directions of a body's u, v and z axes, the rows of float64 [3, 3].

    Right-handed: heading about z, then pitch about the turned y axis (down is positive), then roll
    about the turned x axis.
    """
    angles = np.array([heading_rad, pitch_rad, roll_rad])
    (c, cp, cr), (s, sp, sr) = cosine(angles).tolist(), sine(angles).tolist()
    u = (c * cp, s * cp, -sp)
    v = (c * sp * sr - s * cr, s * sp * sr + c * cr, cp * sr)
    z = (c * sp * cr + s * sr, s * sp * cr - c * sr, cp * cr)
    return np.array([u, v, z])
