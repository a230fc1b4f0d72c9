"""A case over sim time: KPI columns, where everybody was, and what the stack saw."""

from __future__ import annotations

import math
from typing import Any

from schemas.kinds.kpi import columns_by_name
from viewer.console.recorded import RecordedAttempt
from viewer.console.table import title_of
from viewer.playback.frames import MoverBox, RecordedCase
from viewer.playback.surroundings import read_surroundings

ROWS_MAX = 20_000
"""Most rows that are shown; of longer cases every second, third and so on."""
MOVERS_MAX = 64
"""Most objects that move."""
BOXES_MAX = 64
"""Most boxes of one picture."""
SKIPPED = ("tick", "sim_time_ns", "x_m", "y_m", "yaw_rad", "headlights", "indicators")


def case_series(attempt: RecordedAttempt) -> dict[str, Any]:
    """``series.json``: KPI rows on one clock, actors, road and detections; what was not recorded is
    empty, what is missing in a row is None."""
    rows = attempt.rows
    times_ns, columns = _columns(rows) if rows else _of_frames(attempt.recording)
    step = max(1, -(-len(times_ns) // ROWS_MAX))
    times_ns = times_ns[::step]
    known = columns_by_name()
    series = {
        name: {
            "unit": known[name].unit if name in known else "",
            "title": _title(name),
            "v": [_number(value) for value in values[::step]],
        }
        for name, values in columns.items()
        if name not in SKIPPED and any(value is not None for value in values)
    }
    road = read_surroundings(attempt.found.path) if attempt.found else None
    ego = {
        "name": "ego",
        "kind": "ego",
        "size": road.ego_size_m if road else None,
        "center": road.ego_center_m if road else None,
        **{
            axis: [_number(value) for value in columns.get(name, [])[::step]]
            for axis, name in (("x", "x_m"), ("y", "y_m"), ("yaw", "yaw_rad"))
        },
    }
    return {
        "t": [time_ns / 1e9 for time_ns in times_ns],
        "series": series,
        "actors": [ego, *_movers(attempt.recording, times_ns)] if times_ns else [],
        "road": None
        if road is None
        else {
            "lines": road.lines_m,
            "hulls": [
                {
                    "kind": hull.kind,
                    "x": hull.x_m,
                    "y": hull.y_m,
                    "yaw": hull.yaw_rad,
                    "size": [hull.length_m, hull.width_m, hull.height_m],
                }
                for hull in road.hulls
            ],
        },
        "detections": _detections(attempt),
    }


def _columns(rows: dict[str, list[Any]]) -> tuple[list[int], dict[str, list[Any]]]:
    known = columns_by_name()
    return rows["sim_time_ns"], {
        name: values
        for name, values in rows.items()
        if name in known and known[name].type in ("bool", "int32", "int64", "float64")
    }


_FRAME_COLUMNS = {
    "x_m": "x_m",
    "y_m": "y_m",
    "yaw_rad": "yaw_rad",
    "speed_mps": "speed_mps",
    "accel_mps2": "accel_mps2",
    "dtc_m": "dtc_m",
    "ttc_s": "ttc_s",
    "throttle": "throttle",
    "brake": "brake",
    "aeb": "aeb",
}
"""Attributes of a recorded tick -> the KPI columns that they are."""


def _of_frames(case: RecordedCase | None) -> tuple[list[int], dict[str, list[Any]]]:
    """As the recording has it, of an attempt that was killed before it wrote its rows."""
    if case is None:
        return [], {}
    columns = {
        column: [getattr(frame, name) for frame in case.frames]
        for name, column in _FRAME_COLUMNS.items()
    }
    return [frame.sim_time_ns for frame in case.frames], columns


def _movers(case: RecordedCase | None, times_ns: list[int]) -> list[dict[str, Any]]:
    """Tracks of the objects that move, on the clock of the rows; the last pose stands until the
    next."""
    if case is None:
        return []
    boxes_at = {frame.sim_time_ns: frame.movers for frame in case.frames if frame.movers}
    count = min(MOVERS_MAX, max((len(boxes) for boxes in boxes_at.values() if boxes), default=0))
    latest: list[MoverBox | None] = [None] * count
    tracks: list[dict[str, Any]] = [
        {"name": f"object {number + 1}", "kind": "mover", "size": None, "x": [], "y": [], "yaw": []}
        for number in range(count)
    ]
    for time_ns in times_ns:
        for number, box in enumerate((boxes_at.get(time_ns) or [])[:count]):
            latest[number] = box
        for number, track in enumerate(tracks):
            last = latest[number]
            track["size"] = track["size"] or (list(last.size_m) if last else None)
            track["x"].append(None if last is None else _number(last.position_m[0]))
            track["y"].append(None if last is None else _number(last.position_m[1]))
            track["yaw"].append(None if last is None else _yaw(last.rotation))
    return tracks


def _detections(attempt: RecordedAttempt) -> list[dict[str, Any]]:
    """Boxes of the stack in the main camera's picture [px], and which are true, where recorded."""
    case = attempt.recording
    if case is None:
        return []
    return [
        {
            "t": frame.sim_time_ns / 1e9,
            "boxes": [_box(mark) for mark in (frame.detections or [])[:BOXES_MAX]],
            "truth": [_box(mark) for mark in (frame.truth or [])[:BOXES_MAX]],
            "trigger": _box(frame.trigger) if frame.trigger else None,
        }
        for frame in case.frames
        if frame.detections or frame.truth
    ][:ROWS_MAX]


def _box(mark: Any) -> dict[str, Any]:
    return {
        "label": mark.label,
        "x": round(mark.x_px, 1),
        "y": round(mark.y_px, 1),
        "w": round(mark.width_px, 1),
        "h": round(mark.height_px, 1),
    }


def _yaw(rotation: tuple[float, float, float, float]) -> float:
    x, y, z, w = rotation
    return round(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), 5)


def _number(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value


def _title(name: str) -> str:
    curve = columns_by_name()[name].curve if name in columns_by_name() else None
    return curve.title if curve is not None else title_of(name)
