"""Gaps: where pieces of a reference line, or ends of roads that are linked, do not meet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.records import ContactPoint, RoadLink, RoadNetwork
from twin.road.opendrive.road_frame import RoadFrame

GAP_M = 0.01
"""Least gap that is told [m]."""
KINK_RAD = math.radians(0.1)
"""Least kink that is told [rad]."""


class RoadGap(NamedTuple):
    """A place where two ends do not meet."""

    road: str
    at: str
    """``start``, ``end``, or the station of a piece."""
    other: str
    """The road there; the same inside of a road."""
    distance_m: float
    kink_rad: float


def find_gaps(network: RoadNetwork, frames: Mapping[str, RoadFrame]) -> list[RoadGap]:
    """All gaps above 1 cm or 0.1 degrees, in the order of the file; each pair of ends once."""
    gaps: list[RoadGap] = []
    pairs: set[frozenset[tuple[str, str]]] = set()
    for road in network.roads.values():
        frame = frames[road.id]
        gaps += _inside(frame)
        ends: tuple[tuple[ContactPoint, RoadLink | None], ...] = (
            ("start", road.predecessor),
            ("end", road.successor),
        )
        for at, link in ends:
            if link is None or link.contact is None:
                continue
            pair = frozenset({(road.id, at), (link.id, link.contact)})
            if pair in pairs:
                continue
            pairs.add(pair)
            gaps += _told(
                road.id, at, link.id, _leaving(frame, at), _entering(frames[link.id], link.contact)
            )
    return gaps


def _inside(frame: RoadFrame) -> list[RoadGap]:
    gaps = []
    for piece in frame.line.pieces[1:]:
        before = min(max(piece.start_m - 1e-9, 0.0), frame.road.length_m)
        after = min(piece.start_m, frame.road.length_m)
        one, other = (frame.pose(s) for s in (before, after))
        name = f"s={piece.start_m:.6g}"
        gaps += _told(frame.road.id, name, frame.road.id, _row(one, 0.0), _row(other, 0.0))
    return gaps


def _row(pose: tuple[np.ndarray, ...], turn: float) -> tuple[float, float, float, float]:
    return float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]) + turn


def _leaving(frame: RoadFrame, at: ContactPoint) -> tuple[float, float, float, float]:
    if at == "end":
        return _row(frame.pose(frame.road.length_m), 0.0)
    return _row(frame.pose(0.0), math.pi)


def _entering(frame: RoadFrame, at: ContactPoint) -> tuple[float, float, float, float]:
    x, y, z, heading = _leaving(frame, at)
    return x, y, z, heading + math.pi


def _told(
    road: str,
    at: str,
    other: str,
    one: tuple[float, float, float, float],
    two: tuple[float, float, float, float],
) -> list[RoadGap]:
    distance = math.dist(one[:3], two[:3])
    kink = abs(math.remainder(one[3] - two[3], 2.0 * math.pi))
    if distance <= GAP_M and kink <= KINK_RAD:
        return []
    return [RoadGap(road, at, other, distance, kink)]
