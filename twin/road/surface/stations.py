"""Stations at which the surface of a lane section is cut.

They are the same for all lanes of a section, so lanes meet without cracks. Between two of them
every border is a chord; it stays within :data:`ASIDE_M` of the border in the plane and within
:data:`HEIGHT_M` in height, and so does the diagonal that parts each lane's quadrilateral.
"""

from __future__ import annotations

import numpy as np

from twin.road.opendrive.cross_section import CrossSection
from twin.road.opendrive.records import Cubic
from twin.road.opendrive.road_frame import RoadFrame

ASIDE_M = 0.009
"""Largest distance in the plane between a border and its chord; 1 cm is promised [m]."""
HEIGHT_M = 0.0025
"""Largest difference in height, less than half of what marks lie above lanes [m]."""
STEP_M = 12.0
"""Longest piece: long faces spoil a hierarchy of boxes [m]."""
STEP_M_MIN = 0.02
"""Shortest piece; shorter ones are no further cut [m]."""
JUMP_M = 1e-3
"""Length of a piece over which a border that jumps goes from one place to the other [m]."""
POINTS_MAX = 2_000_000
"""Most points of the borders of a lane section."""
_SHARES = (0.25, 0.5, 0.75)


def section_stations(frame: RoadFrame, number: int, most: int = POINTS_MAX) -> np.ndarray:
    """Stations of lane section ``number`` from its start to its end [N] [m].

    Raises:
        ValueError: its borders would have more than ``most`` points.
    """
    section = frame.sections[number]
    start, end = section.section.start_m, section.section.end_m
    borders = len(section.section.lanes) + 1
    s = _knots(frame, section, start, end)
    steps = np.maximum(np.ceil(np.diff(s) / STEP_M), 1.0).astype(int)
    _check(int(steps.sum()) * borders, most)
    parts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(s[:-1], s[1:], steps.tolist(), strict=True)
    ]
    s = np.concatenate([*parts, [end]])
    while True:
        wide = _off(frame, section, s) & (np.diff(s) > 2.0 * STEP_M_MIN)
        if not wide.any():
            return s
        s = np.sort(np.append(s, 0.5 * (s[:-1] + s[1:])[wide]))
        _check(len(s) * borders, most)


def _check(points: int, most: int) -> None:
    if points > most:
        raise ValueError(f"its lanes would have more than {most} points")


def edge_points(
    frame: RoadFrame, s_m: np.ndarray, t_m: np.ndarray, h_m: float | np.ndarray = 0.0
) -> np.ndarray:
    """World places of a line across stations of one section [N, 3] [m]."""
    pose = frame.pose(np.clip(s_m, 0.0, frame.road.length_m), t_m, h_m)
    points: np.ndarray = np.stack([pose.x_m, pose.y_m, pose.z_m], axis=-1)
    return points


def _knots(frame: RoadFrame, section: CrossSection, start: float, end: float) -> np.ndarray:
    """Where something may change at once, and the places just before jumps."""
    road = frame.road
    cubics: list[tuple[float, tuple[Cubic, ...]]] = [
        (0.0, road.elevation),
        (0.0, road.superelevation),
        (0.0, road.lane_offset),
    ]
    starts = [piece.start_m for piece in road.geometry]
    for lane in section.section.lanes:
        cubics += [(start, lane.widths), (start, lane.borders)]
        starts += [start + height.start_m for height in lane.heights]
        starts += [start + material.start_m for material in lane.materials]
    starts += [begin + cubic.start_m for begin, profile in cubics for cubic in profile]
    knots = np.unique([start, end, *(s for s in starts if start < s < end)])
    inner = knots[1:-1]
    before = np.maximum(inner - JUMP_M, start)
    jumps = np.zeros(len(inner), bool)
    there, here = section.borders(before), section.borders(inner)
    for lane_id, t in here.items():
        jumps |= np.abs(t - there[lane_id]) > 10.0 * JUMP_M
    stations: np.ndarray = np.union1d(knots, before[jumps])
    return stations


def _off(frame: RoadFrame, section: CrossSection, s: np.ndarray) -> np.ndarray:
    """Which of the pieces between stations bend too much."""
    # The end of a section belongs to the next; its own borders end just before.
    inside = np.clip(s, section.section.start_m, np.nextafter(section.section.end_m, 0.0))
    off = np.zeros(len(s) - 1, bool)
    between = [(1.0 - share) * inside[:-1] + share * inside[1:] for share in _SHARES]
    borders = [section.borders(at) for at in between]
    before: tuple[np.ndarray, np.ndarray] | None = None
    for lane_id, t in section.borders(inside).items():
        ends = edge_points(frame, inside, t)
        middle = ends[:-1]
        for share, at, rows in zip(_SHARES, between, borders, strict=True):
            exact = edge_points(frame, at, rows[lane_id])
            off |= _apart(exact, (1.0 - share) * ends[:-1] + share * ends[1:])
            middle = exact if share == 0.5 else middle
        if before is not None:
            diagonal = 0.5 * (before[0][1:] + ends[:-1])
            off |= np.abs(diagonal[:, 2] - 0.5 * (before[1] + middle)[:, 2]) > HEIGHT_M
        before = ends, middle
    return off


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    aside = np.hypot(one[:, 0] - other[:, 0], one[:, 1] - other[:, 1])
    apart: np.ndarray = (aside > ASIDE_M) | (np.abs(one[:, 2] - other[:, 2]) > HEIGHT_M)
    return apart
