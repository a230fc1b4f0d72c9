"""A road along the way of the ego, for recordings of which nobody has the map."""

from __future__ import annotations

import math

import numpy as np

from twin.road.lane_fit import LanePoints, fit_lane
from twin.road.shipped.xml_parts import element

LANE_M = 3.5
"""Width of its lanes; the ego's way is the middle of the right one [m]."""
SHOULDER_M = 3.0
"""Width of its shoulders [m]."""
BEFORE_M, BEYOND_M = 60.0, 250.0
"""How far it goes on straight before the way and beyond its end [m]."""
SPACING_MIN_M = 6.0
"""Places through which it goes are no nearer to one another [m]."""
PLACES_MAX = 300
"""Most of these places."""
_TURN_MAX_RAD = 0.5
"""Between two of these places a car on a road turns by no more; what does is no road."""


def road_text(x_m: np.ndarray, y_m: np.ndarray, heading_rad: float, name: str) -> str:
    """An OpenDRIVE file with one road.

    Args:
        x_m, y_m: way of the ego [N].
        heading_rad: at its beginning, if it hardly moves.
        name: of the road.
    """
    pieces = _pieces(_spaced(x_m, y_m, heading_rad))
    length_m = sum(piece[3] for piece in pieces)
    plan, along_m = "", 0.0
    for x, y, heading, piece_m, curvature in pieces:
        shape = element("arc", curvature=f"{curvature:.12f}") if curvature else element("line")
        plan += element(
            "geometry",
            shape,
            s=along_m,
            x=x,
            y=y,
            hdg=f"{heading:.12f}",
            length=f"{piece_m:.12f}",
        )
        along_m += piece_m
    road = element("planView", plan) + element("lanes", _lanes())
    head = element("header", revMajor=1, revMinor=7, name=name, vendor="drivetwin")
    whole = element(
        "road", road, name=name, length=f"{length_m:.12f}", id=0, junction=-1, rule="RHT"
    )
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{element("OpenDRIVE", head + whole)}'


def _spaced(x_m: np.ndarray, y_m: np.ndarray, heading_rad: float) -> np.ndarray:
    """Places along the way [P, 2], with straight ends; straight ahead where it is no road."""
    way = np.column_stack([x_m, y_m])
    steps = np.hypot(*np.diff(way, axis=0).T)
    moved = np.concatenate([[True], steps > 1e-3])
    way = way[moved]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    length_m = float(along[-1])
    count = min(PLACES_MAX, int(length_m / SPACING_MIN_M))
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    straight = np.array([way[0] - BEFORE_M * ahead, way[0] + (BEYOND_M + length_m) * ahead])
    if count < 2:
        return straight
    stations = np.linspace(0.0, length_m, count + 1)
    places = np.column_stack([np.interp(stations, along, way[:, axis]) for axis in (0, 1)])
    legs = np.diff(places, axis=0)
    directions = np.arctan2(legs[:, 1], legs[:, 0])
    turns = np.abs(np.remainder(np.diff(directions) + math.pi, 2.0 * math.pi) - math.pi)
    if (turns > _TURN_MAX_RAD).any():
        return straight
    first, last = (leg / np.hypot(*leg) for leg in (legs[0], legs[-1]))
    return np.concatenate([[places[0] - BEFORE_M * first], places, [places[-1] + BEYOND_M * last]])


def _pieces(places: np.ndarray) -> list[tuple[float, float, float, float, float]]:
    """x, y, heading, length and curvature of each piece of the reference line."""
    legs = np.diff(places, axis=0)
    directions = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    # At a place between two legs the line goes halfway between them.
    headings = np.concatenate(
        [directions[:1], 0.5 * (directions[:-1] + directions[1:]), directions[-1:]]
    )
    path = fit_lane(LanePoints(places[:, 0], places[:, 1], headings), closed=False)
    lengths = np.diff(np.append(path.station_m, path.length_m))
    rows = zip(path.start.tolist(), lengths.tolist(), path.curvature.tolist(), strict=True)
    return [(x, y, heading, length, bend) for (x, y, heading), length, bend in rows]


def _lanes() -> str:
    def lane(number: int, kind: str, width_m: float, mark: str = "") -> str:
        width = element("width", sOffset=0, a=width_m, b=0, c=0, d=0)
        drawn = element("roadMark", sOffset=0, type=mark, weight="standard", color="standard",
                        width=0.12) if mark else ""  # fmt: skip
        return element("lane", width + drawn, id=number, type=kind, level="false")

    middle = element("roadMark", sOffset=0, type="broken", weight="standard", color="standard",
                     width=0.12)  # fmt: skip
    left = lane(2, "shoulder", SHOULDER_M) + lane(1, "driving", LANE_M, "solid")
    right = lane(-1, "driving", LANE_M, "solid") + lane(-2, "shoulder", SHOULDER_M)
    section = (
        element("left", left)
        + element("center", element("lane", middle, id=0, type="none", level="false"))
        + element("right", right)
    )
    # The reference line is the ego's way, the middle of the right lane.
    offset = element("laneOffset", s=0, a=0.5 * LANE_M, b=0, c=0, d=0)
    return offset + element("laneSection", section, s=0)
