"""What stands beside and above a road: records of objects and signals."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OutlineCorner:
    """A corner of an outline."""

    frame: str
    """``road``: s, t and height above the road; ``local``: u, v, z in the object's axes."""
    position: tuple[float, float, float]
    """[m]."""
    height_m: float
    """Of the object above this corner [m]."""


@dataclass(frozen=True, slots=True)
class ObjectOutline:
    """Ground plan of an object."""

    corners: tuple[OutlineCorner, ...]
    closed: bool


@dataclass(frozen=True, slots=True)
class ObjectRepeat:
    """A row of copies of an object, or a body drawn along the road.

    Values change linearly from the beginning of the row to its end.
    """

    s_m: float
    """Of the beginning [m]."""
    length_m: float
    distance_m: float
    """Between copies; 0: a body without gaps [m]."""
    t_m: tuple[float, float]
    z_offset_m: tuple[float, float]
    size_m: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    """Length, width and height, each at the beginning and the end; of a body drawn along the road
    the first says nothing [m]."""
    radius_m: tuple[float, float]
    line: int


def copies_of(row: ObjectRepeat) -> int:
    """How many copies stand in a row whose distance is above 0; the last may stand at its end."""
    return math.floor(row.length_m / row.distance_m * (1.0 + 1e-12) + 1e-9) + 1


@dataclass(frozen=True, slots=True)
class RoadObject:
    """An object: a box, a cylinder, or what its outlines enclose."""

    id: str
    name: str
    type: str
    subtype: str
    s_m: float
    t_m: float
    z_offset_m: float
    heading_rad: float
    """Against the road's [rad]."""
    pitch_rad: float
    roll_rad: float
    length_m: float
    """0: not given."""
    width_m: float
    height_m: float
    radius_m: float
    """Above 0 for a cylinder."""
    orientation: str
    """``+``, ``-`` or ``none``: the direction of travel it is for."""
    dynamic: bool
    outlines: tuple[ObjectOutline, ...]
    repeats: tuple[ObjectRepeat, ...]
    """Empty: it stands once, at ``s_m``; else it stands where they say."""
    line: int


@dataclass(frozen=True, slots=True)
class RoadSignal:
    """A traffic sign or light."""

    id: str
    name: str
    s_m: float
    t_m: float
    z_offset_m: float
    h_offset_rad: float
    """Turn against the road's direction [rad]."""
    pitch_rad: float
    roll_rad: float
    orientation: str
    """``+``, ``-`` or ``none``: the direction of travel it is for."""
    dynamic: bool
    country: str
    type: str
    subtype: str
    value: float | None
    """Such as a speed; None: none is given."""
    unit: str
    text: str
    width_m: float
    height_m: float
    line: int
