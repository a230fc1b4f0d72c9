"""The picture of a road file from above: lanes by type, road marks, ids and directions."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from schemas.escape import escape
from schemas.words import counted
from twin.road.opendrive.records import DRIVEN_TYPES, Lane
from twin.road.opendrive.road_frame import RoadFrame, traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.mark_lines import line_strokes, painted_marks

FILE_NAME = "roads.png"
_WIDTH_IN = 15.0
_STEPS_MAX = 4000
"""Most places along a road that are drawn."""
_FINER = 4
"""Places drawn per place that the nearest station is looked for from."""
_DETAIL_M = (90.0, 60.0)
"""Size of the close-up."""
_MARKS_SHOWN_M = 400.0
"""Marks are drawn where the picture shows at most so much across."""
_DRIVEN = "#6f7782"
_COLORS = {
    "shoulder": "#b8b2a6",
    "border": "#c9c4ba",
    "stop": "#98a0a8",
    "none": "#e6e2d8",
    "restricted": "#d9b8a0",
    "parking": "#8fa6c4",
    "median": "#a9c49a",
    "biking": "#c98f7f",
    "sidewalk": "#d8cfc0",
    "walking": "#d8cfc0",
    "curb": "#8d8578",
    "rail": "#a38fb8",
    "tram": "#a38fb8",
}
_MARK_COLORS = {
    "yellow": "#f2c230",
    "blue": "#3f7fe0",
    "red": "#d8402f",
    "green": "#3fa05a",
    "orange": "#e88a2a",
    "violet": "#8a5bc0",
}


def write_picture(folder: Path, roads: RoadMap) -> Path:
    """Write ``roads.png`` into ``folder``, which is made if it is not there.

    Raises:
        OSError: it cannot be written.
    """
    importlib.import_module("matplotlib")
    figures = importlib.import_module("matplotlib.figure")
    x0, y0, x1, y1 = _extent(roads)
    wide, high = x1 - x0, y1 - y0
    # The whole above, a close-up below: a kilometre of road is a hair in the whole.
    closer = max(wide, high) > 1.5 * _DETAIL_M[0]
    whole_in = float(np.clip(_WIDTH_IN * high / max(wide, 1.0), 2.5, 12.0))
    heights = [whole_in, _WIDTH_IN * _DETAIL_M[1] / _DETAIL_M[0]] if closer else [whole_in]
    figure = figures.Figure(figsize=(_WIDTH_IN, sum(heights) + 1.2), layout="constrained")
    grid = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)
    axes = [row[0] for row in grid]
    _draw(axes[0], roads, (x0, y0, x1, y1), marks=max(wide, high) <= _MARKS_SHOWN_M)
    network = roads.network
    version = "{}.{}".format(*network.version)
    name = escape(Path(network.file).name, 120).replace("$", r"\$")
    axes[0].set_title(f"{name}: OpenDRIVE {version}, {_count(roads)}", loc="left")
    if closer:
        x, y = _centre_of_interest(roads)
        half_x, half_y = 0.5 * _DETAIL_M[0], 0.5 * _DETAIL_M[1]
        box = x - half_x, y - half_y, x + half_x, y + half_y
        _draw(axes[1], roads, box, marks=True)
        axes[1].set_title(f"close-up of {_DETAIL_M[0]:.0f} m x {_DETAIL_M[1]:.0f} m", loc="left")
        axes[0].add_patch(
            importlib.import_module("matplotlib.patches").Rectangle(
                (box[0], box[1]), *_DETAIL_M, fill=False, edgecolor="#c03028", zorder=9
            )
        )
    _legend(axes[0], roads)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE_NAME
    figure.savefig(path, dpi=110, facecolor="white", metadata={"Software": None})
    return path


def draw_roads(axes: Any, roads: RoadMap, box: tuple[float, float, float, float]) -> None:
    """Draw lanes, marks, signals and objects within x and y of ``box`` into a figure's axes."""
    _draw(axes, roads, box, marks=True, ids=False)


def _extent(roads: RoadMap) -> tuple[float, float, float, float]:
    """Extent of all lanes, with a margin."""
    xs, ys = [], []
    for frame in roads.frames.values():
        s = _stations(frame)
        index = frame.section_at(s)
        for number, section in enumerate(frame.sections):
            mine = s[index == number]
            for lane in (len(section.section.left), -len(section.section.right)):
                pose = frame.pose(mine, section.outer(lane, mine)[0])
                xs.append(pose.x_m)
                ys.append(pose.y_m)
    x, y = np.concatenate(xs), np.concatenate(ys)
    margin = 2.0 + 0.01 * max(float(np.ptp(x)), float(np.ptp(y)))
    return (
        float(x.min()) - margin,
        float(y.min()) - margin,
        float(x.max()) + margin,
        float(y.max()) + margin,
    )


def _count(roads: RoadMap) -> str:
    count = len(roads.network.roads)
    return counted(count, "road")


def _stations(frame: RoadFrame) -> np.ndarray:
    s = np.union1d(frame.line.sample_s, [section.section.start_m for section in frame.sections])
    if len(s) * _FINER <= _STEPS_MAX:
        s = np.interp(np.arange(len(s) * _FINER - _FINER + 1) / _FINER, np.arange(len(s)), s)
    return s[:: max(1, len(s) // _STEPS_MAX)]


def _centre_of_interest(roads: RoadMap) -> tuple[float, float]:
    """The middle of the first junction; without one, the tightest curve of the longest road, what
    stands beside it, or its beginning."""
    for junction in roads.network.junctions.values():
        ids = {connection.connecting_road for connection in junction.connections}
        lines = [roads.frames[i].line for i in sorted(ids)]
        if lines:
            x = np.concatenate([line.sample_x for line in lines])
            y = np.concatenate([line.sample_y for line in lines])
            return 0.5 * float(x.min() + x.max()), 0.5 * float(y.min() + y.max())
    frame = max(roads.frames.values(), key=lambda frame: frame.road.length_m)
    bend = np.abs(frame.curvature(frame.line.sample_s))
    objects = [item.s_m for item in (*frame.road.objects, *frame.road.signals)]
    s = float(np.median(objects)) if objects else 0.0
    if bend.max() > 1e-9:
        s = float(frame.line.sample_s[int(np.argmax(bend))])
    pose = frame.pose(min(max(s, 0.5 * _DETAIL_M[0] - 5.0), 0.999 * frame.road.length_m))
    return float(pose.x_m), float(pose.y_m)


def _draw(
    axes: Any,
    roads: RoadMap,
    box: tuple[float, float, float, float],
    *,
    marks: bool,
    ids: bool = True,
) -> None:
    axes.set_facecolor("#f4f1ea")
    axes.set_xlim(box[0], box[2])
    axes.set_ylim(box[1], box[3])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    for frame in roads.frames.values():
        s = _within(frame, box)
        if not len(s):
            continue
        index = frame.section_at(s)
        for number, section in enumerate(frame.sections):
            mine = s[index == number]
            if not len(mine):
                continue
            # Up to where the next section begins.
            mine = np.append(mine, min(mine[-1] + 6.0, section.section.end_m))
            inside = np.clip(mine, section.section.start_m, section.section.end_m)
            for lane in section.section.lanes:
                _lane(axes, frame, number, lane, inside)
            if marks:
                _marks(axes, frame, number, inside)
        _direction(axes, frame, s, box, ids)
    if marks:
        _furniture(axes, roads, box)


def _within(frame: RoadFrame, box: tuple[float, float, float, float]) -> np.ndarray:
    """Stations from which something may be seen."""
    s = _stations(frame)
    pose = frame.pose(s)
    reach = 60.0
    seen = (pose.x_m > box[0] - reach) & (pose.x_m < box[2] + reach)
    seen &= (pose.y_m > box[1] - reach) & (pose.y_m < box[3] + reach)
    return s[seen]


def _lane(axes: Any, frame: RoadFrame, number: int, lane: Lane, s: np.ndarray) -> None:
    section = frame.sections[number]
    inner = frame.pose(s, section.inner(lane.id, s)[0])
    outer = frame.pose(s, section.outer(lane.id, s)[0])
    x = np.concatenate([inner.x_m, outer.x_m[::-1]])
    y = np.concatenate([inner.y_m, outer.y_m[::-1]])
    axes.fill(x, y, facecolor=_color(lane.type), edgecolor="#ffffff50", linewidth=0.3, zorder=2)


def _color(lane_type: str) -> str:
    return _DRIVEN if lane_type in DRIVEN_TYPES else _COLORS.get(lane_type, "#c0a8a8")


def _marks(axes: Any, frame: RoadFrame, number: int, s: np.ndarray) -> None:
    section = frame.sections[number]
    for mark in painted_marks(section.section):
        for line in mark.lines:
            color = _MARK_COLORS.get(line.color, "#ffffff")
            for one, other in line_strokes(line, mark.begin_m, mark.end_m).tolist():
                if other <= s[0] or one >= s[-1]:
                    continue
                low, high = max(one, float(s[0])), min(other, float(s[-1]))
                cuts = min(max(2, int((high - low) / 2.0) + 1), _STEPS_MAX)
                at = np.linspace(low, high, cuts)
                t = section.outer(mark.lane, at)[0] + line.aside_m
                left = frame.pose(at, t + 0.5 * line.width_m)
                right = frame.pose(at, t - 0.5 * line.width_m)
                x = np.concatenate([left.x_m, right.x_m[::-1]])
                y = np.concatenate([left.y_m, right.y_m[::-1]])
                axes.fill(x, y, facecolor=color, edgecolor=color, linewidth=0.4, zorder=4)


def _direction(
    axes: Any,
    frame: RoadFrame,
    s: np.ndarray,
    box: tuple[float, float, float, float],
    ids: bool,
) -> None:
    """An arrow on every driven lane and, if ``ids``, the road's id where it is seen."""
    pose = frame.pose(s)
    inside = (pose.x_m > box[0]) & (pose.x_m < box[2]) & (pose.y_m > box[1]) & (pose.y_m < box[3])
    if not inside.any():
        return
    seen = s[inside]
    # Ways through a junction cross in their middles.
    share = 0.5 if frame.road.junction is None else 0.3
    at = float(seen[0] + share * (seen[-1] - seen[0]))
    size = 0.02 * (box[2] - box[0])
    section = frame.sections[int(frame.section_at(at))]
    for lane in section.section.lanes:
        width = float(section.width(lane.id, np.array(at)))
        if lane.type not in DRIVEN_TYPES or width < 0.2:
            continue
        sign = traffic_sign(frame.road, lane)
        length = min(size, 12.0 * width)
        ways = (1.0, -1.0) if sign == 0 else (float(sign),)
        place = frame.lane_pose(lane.id, at)
        x, y = float(place.x_m), float(place.y_m)
        for way in ways:
            dx = way * length * float(np.cos(place.heading_rad))
            dy = way * length * float(np.sin(place.heading_rad))
            axes.annotate(
                "",
                (x + 0.9 * dx, y + 0.9 * dy),
                (x - 0.1 * dx, y - 0.1 * dy),
                arrowprops={"arrowstyle": "-|>", "color": "#ffe9a8", "linewidth": 1.4},
                zorder=6,
            )
    if not ids:
        return
    place = frame.pose(at)
    label = escape(frame.road.id, 12).replace("$", r"\$")
    axes.text(
        float(place.x_m),
        float(place.y_m),
        label,
        ha="center",
        va="center",
        fontsize=9,
        color="#101418",
        bbox={"boxstyle": "round,pad=0.25", "facecolor": "#ffffffd8", "edgecolor": "#30363c"},
        zorder=8,
    )


def _furniture(axes: Any, roads: RoadMap, box: tuple[float, float, float, float]) -> None:
    for kind, marker, color in (("signals", "^", "#c03028"), ("objects", "s", "#2f6fb0")):
        x, y = [], []
        for frame in roads.frames.values():
            for item in getattr(frame.road, kind):
                pose = frame.pose(min(item.s_m, frame.road.length_m), item.t_m)
                if box[0] < pose.x_m < box[2] and box[1] < pose.y_m < box[3]:
                    x.append(float(pose.x_m))
                    y.append(float(pose.y_m))
        if x:
            axes.scatter(x, y, s=36, marker=marker, color=color, edgecolor="white", zorder=7)


def _legend(axes: Any, roads: RoadMap) -> None:
    patches = importlib.import_module("matplotlib.patches")
    lines = importlib.import_module("matplotlib.lines")
    types = {
        "driven" if lane.type in DRIVEN_TYPES else lane.type: _color(lane.type)
        for road in roads.network.roads.values()
        for section in road.sections
        for lane in section.lanes
    }
    handles = [patches.Patch(color=types[name], label=name) for name in sorted(types)]
    for kind, marker, color in (("signals", "^", "#c03028"), ("objects", "s", "#2f6fb0")):
        if any(getattr(road, kind) for road in roads.network.roads.values()):
            handles.append(
                lines.Line2D([], [], linestyle="", marker=marker, color=color, label=kind)
            )
    axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=min(len(handles), 8),
        frameon=False,
        fontsize=9,
    )
