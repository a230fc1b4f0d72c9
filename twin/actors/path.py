"""A way on the ground: straight pieces joined by circular turns, and a law of time along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.base.portable.host import angle_of, cosine, sine, tangent

_SHORT_M = 1e-6


@dataclass(frozen=True, slots=True)
class Path:
    """Pieces of constant curvature, in order; P of them."""

    station_m: np.ndarray
    """Beginning of each piece, along the path [P]."""
    start: np.ndarray
    """x, y [m] and heading [rad] at its beginning [P, 3]; headings go on past pi."""
    curvature: np.ndarray
    """Curvature to the left [1/m], [P]."""
    height: np.ndarray
    """Station and z of points in between which z changes evenly [Q, 2] [m]."""
    length_m: float
    waypoint_m: np.ndarray
    """Stations of the waypoints; of a loop, one more: the first again."""


def build_path(waypoints: np.ndarray, corner_m: float, loop: bool) -> Path:
    """Round the corners of the polyline ``waypoints`` [N, 3].

    A turn's radius is ``corner_m``, less where the neighbouring legs are too short for it. A loop
    begins in the middle of the turn at the first waypoint.

    Raises:
        ValueError: two waypoints in a row are the same, or the way turns back on the spot.
    """
    points = np.vstack([waypoints, waypoints[:1]]) if loop else waypoints
    legs = np.diff(points[:, :2], axis=0)
    lengths = np.sqrt((legs * legs).sum(axis=1))
    if (lengths < 0.01).any():
        k = int(np.argmax(lengths < 0.01)) + 1
        raise ValueError(f"waypoints {k} and {k % len(waypoints) + 1} are at the same place")
    heading = np.unwrap(angle_of(legs[:, 1], legs[:, 0]))
    turns = np.zeros(len(points))  # at every waypoint; of a loop, at the first as at the last
    turns[1:-1] = np.diff(heading)
    if loop:
        back = heading[0] - heading[-1]
        turns[0] = turns[-1] = (back + np.pi) % (2 * np.pi) - np.pi
    if (np.abs(turns) > np.radians(175)).any():
        k = int(np.argmax(np.abs(turns) > np.radians(175))) + 1
        raise ValueError(f"waypoint {k}: the way turns back on the spot; go round in two corners")
    cut = corner_m * tangent(np.abs(turns) / 2)
    cut[:-1] = np.minimum(cut[:-1], 0.49 * lengths)
    cut[1:] = np.minimum(cut[1:], 0.49 * lengths)
    if loop:
        cut[0] = cut[-1] = min(cut[0], cut[-1])
    return _assemble(points, heading, lengths, turns, cut, loop)


def _assemble(
    points: np.ndarray,
    heading: np.ndarray,
    lengths: np.ndarray,
    turns: np.ndarray,
    cut: np.ndarray,
    loop: bool,
) -> Path:
    rows: list[tuple[float, float, float, float, float]] = []  # station, x, y, heading, curvature
    stations = [0.0]
    unit = np.stack([cosine(heading), sine(heading)], axis=1)
    s = 0.0

    def arc(k: int, first: bool) -> float:
        """Half a turn at waypoint ``k``: towards its middle, or from it (``first`` false)."""
        radius = cut[k] / float(tangent(abs(turns[k]) / 2))
        if first:
            begin = points[k, :2] - cut[k] * unit[k - 1]
            angle = heading[k - 1]
        else:  # from the middle of the turn, which lies on the bisector
            angle = heading[k] - turns[k] / 2
            end = points[k, :2] + cut[k] * unit[k]
            chord = 2.0 * radius * float(sine(abs(turns[k]) / 4))
            way = heading[k] - turns[k] / 4
            begin = end - chord * np.array((float(cosine(way)), float(sine(way))))
        rows.append((s, *begin, angle, np.sign(turns[k]) / radius))
        return radius * abs(turns[k]) / 2

    for k in range(len(lengths)):
        if cut[k] > _SHORT_M and (k > 0 or loop):
            s += arc(k, first=False)
        begin = points[k, :2] + cut[k] * unit[k]
        rows.append((s, *begin, heading[k], 0.0))
        s += lengths[k] - cut[k] - cut[k + 1]
        if cut[k + 1] > _SHORT_M and (k + 1 < len(lengths) or loop):
            s += arc(k + 1, first=True)
        stations.append(s)
    table = np.array(rows)
    return Path(
        table[:, 0],
        table[:, 1:4],
        table[:, 4],
        np.stack([stations, points[:, 2]], axis=1),
        s,
        np.array(stations),
    )


@dataclass(frozen=True, slots=True)
class TimeLaw:
    """Station over time as a cubic between knots (Hermite): K knots."""

    time_s: np.ndarray
    """[K], from 0 on, growing."""
    station_m: np.ndarray
    """[K]"""
    speed_mps: np.ndarray
    """[K]"""


def law_of_speeds(stations_m: np.ndarray, speeds: np.ndarray, waits_s: np.ndarray) -> TimeLaw:
    """Speed changes evenly in time from waypoint to waypoint: a quadratic, which the cubic is then.

    A leg of length d from speed v to w takes 2 d / (v + w).
    """
    time, rows = 0.0, []
    for k, station in enumerate(stations_m):
        if k:
            time += 2.0 * (station - stations_m[k - 1]) / (speeds[k] + speeds[k - 1])
        rows.append((time, station, speeds[k]))
        if waits_s[k] > 0.0:
            time += waits_s[k]
            rows.append((time, station, speeds[k]))
    return TimeLaw(*np.array(rows).T.copy())


def law_of_times(stations_m: np.ndarray, times_s: np.ndarray, loop: bool) -> TimeLaw:
    """Smooth and never backwards through given times (Fritsch and Carlson 1980).

    At the ends it stands, or goes on at the same speed in a loop.
    """
    step, way = np.diff(times_s), np.diff(stations_m)
    slope = way / step
    speed = np.zeros(len(times_s))
    before, after = slope[:-1], slope[1:]
    weight = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    speed[1:-1] = (weight[0] + weight[1]) / (weight[0] / before + weight[1] / after)
    if loop:
        mean = 2.0 / (1.0 / slope[0] + 1.0 / slope[-1])
        speed[0] = speed[-1] = mean
    return TimeLaw(times_s, stations_m, speed)
