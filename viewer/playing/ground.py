"""Lanes, marks, trajectories and routes of a played scenario, as Rerun draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr

from schemas.escape import escape
from schemas.files.played_scenario import PlayFile, PlayMark
from twin.records.play_file import points_of
from viewer.playing import paths
from viewer.recording.scenery import CYAN, VIOLET, Color, Logged

DASHES_MAX = 50_000
"""Strokes of broken marks; further marks are drawn without gaps."""
_LANE_COLORS: dict[str, Color] = {
    "shoulder": (46, 48, 54),
    "border": (40, 46, 42),
    "stop": (50, 52, 60),
    "none": (30, 36, 33),
    "median": (38, 52, 40),
    "restricted": (58, 50, 46),
    "parking": (50, 58, 74),
    "biking": (92, 58, 54),
    "sidewalk": (86, 82, 76),
    "walking": (86, 82, 76),
    "curb": (110, 104, 98),
    "rail": (72, 60, 80),
    "tram": (72, 60, 80),
}
_DRIVEN: Color = (64, 68, 77)
_EDGE: Color = (104, 110, 122)
_MARK_COLORS: dict[str, Color] = {
    "yellow": (242, 194, 48),
    "blue": (80, 140, 240),
    "red": (226, 80, 66),
    "green": (80, 180, 110),
    "orange": (240, 150, 60),
    "violet": (160, 110, 215),
}
_WHITE: Color = (236, 238, 242)
_LIFT_M = np.array([0.0, 0.0, 0.03])
"""Marks are drawn a little above the lanes, so that they win where both are equally near."""


def ground(play: PlayFile, origin_m: np.ndarray) -> list[Logged]:
    """Everything that stands still; points are moved by ``-origin_m``."""
    logged: list[Logged] = []
    if play.lanes:
        logged += [(paths.LANES, _lanes(play, origin_m))]
        logged += [(f"{paths.LANES}/edges", _edges(play, origin_m))]
    if play.marks:
        logged.append((paths.MARKS, _marks(play, origin_m)))
    if play.paths:
        logged.append((paths.PATHS, _paths(play, origin_m)))
    return logged


def _lanes(play: PlayFile, origin_m: np.ndarray) -> rr.Mesh3D:
    """Lanes as one mesh: between two stations a quadrilateral of two triangles."""
    corners, triangles, colors = [], [], []
    count = 0
    for lane in play.lanes:
        left, right = points_of(lane.left) - origin_m, points_of(lane.right) - origin_m
        stations = len(left)
        if stations < 2:
            continue
        first = count + np.arange(stations - 1)
        last = first + stations
        triangles.append(np.stack([first, last, first + 1], axis=-1))
        triangles.append(np.stack([first + 1, last, last + 1], axis=-1))
        corners += [left, right]
        colors.append(np.tile(_lane_color(lane.type), (2 * stations, 1)))
        count += 2 * stations
    if not corners:
        corners, triangles = [np.zeros((3, 3))], [np.zeros((0, 3), int)]
        colors = [np.zeros((3, 3), int)]
    positions = np.concatenate(corners)
    return rr.Mesh3D(
        vertex_positions=positions,
        triangle_indices=np.concatenate(triangles).astype(np.uint32),
        vertex_colors=np.concatenate(colors).astype(np.uint8),
        # All alike, or a mesh of flat pieces is shaded by their directions.
        vertex_normals=np.tile([0.0, 0.0, 1.0], (len(positions), 1)),
    )


def _edges(play: PlayFile, origin_m: np.ndarray) -> rr.LineStrips3D:
    """Borders of all lanes, thin: most have no mark of their own."""
    strips = [points_of(side) for lane in play.lanes for side in (lane.left, lane.right)]
    return rr.LineStrips3D(
        [strip - origin_m + 0.5 * _LIFT_M for strip in strips],
        colors=[_EDGE],
        radii=rr.Radius.ui_points(0.4),
    )


def _marks(play: PlayFile, origin_m: np.ndarray) -> rr.LineStrips3D:
    strips: list[np.ndarray] = []
    colors, radii = [], []
    for mark in play.marks:
        points = points_of(mark.points) - origin_m + _LIFT_M
        dashes = list(strokes(points, mark, DASHES_MAX - len(strips)))
        strips += dashes
        colors += [_MARK_COLORS.get(mark.color, _WHITE)] * len(dashes)
        radii += [max(0.5 * mark.width_m, 0.05)] * len(dashes)
    return rr.LineStrips3D(strips, colors=colors, radii=radii)


def strokes(points: np.ndarray, mark: PlayMark, count_max: int) -> Iterator[np.ndarray]:
    """Strokes of a mark along its line; one if it has no gaps, or more than ``count_max``."""
    if len(points) < 2:
        return
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if mark.stroke_m <= 0.0 or mark.gap_m <= 0.0:
        yield points
        return
    period = mark.stroke_m + mark.gap_m
    # Strokes before the line are passed over, however many there are.
    start = mark.from_m % period - period if mark.from_m < 0.0 else mark.from_m
    count = max(at[-1] - start, 0.0) / period + 1.0
    if count > count_max:
        yield points
        return
    axes = np.ascontiguousarray(points.T)
    for number in range(int(count)):
        begin = max(start + number * period, 0.0)
        end = min(start + number * period + mark.stroke_m, at[-1])
        if begin < end:
            low, high = np.searchsorted(at, begin, "right"), np.searchsorted(at, end, "left")
            places = np.concatenate([[begin], at[low:high], [end]])
            yield np.stack([np.interp(places, at, axis) for axis in axes], axis=-1)


def _paths(play: PlayFile, origin_m: np.ndarray) -> rr.LineStrips3D:
    strips = [points_of(line.points) - origin_m + _LIFT_M for line in play.paths]
    colors = [CYAN if line.kind == "trajectory" else VIOLET for line in play.paths]
    labels: Sequence[str] = [f"{line.kind} {escape(line.name, 40)}" for line in play.paths]
    return rr.LineStrips3D(
        strips,
        colors=colors,
        labels=labels,
        show_labels=False,
        radii=rr.Radius.ui_points(1.2),
    )


def _lane_color(lane_type: str) -> Color:
    return _LANE_COLORS.get(lane_type, _DRIVEN)
