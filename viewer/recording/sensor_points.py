"""Rows of sensors that see, as points: radar detections by their declaration's look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from schemas.kinds.sensor import PointsLook
from schemas.wire.view import RowsSite, StateSample
from viewer.recording import naming
from viewer.recording.rows import EntityRows, rows_at
from viewer.recording.scenery import BLUE, GREY, RED, Logged, rotation

POINT_RADIUS = 4.0
"""Of a point on the screen [points]."""


def mounted(sites: Mapping[str, RowsSite]) -> list[Logged]:
    """Where the sensors sit, and the style of their points."""
    logged: list[Logged] = []
    for name, site in sites.items():
        turned = rr.Transform3D(translation=site.position_m, mat3x3=rotation(site.rotation_deg))
        style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(POINT_RADIUS), show_labels=False)
        logged += [(naming.sensor(name), turned), (naming.sensor(name), style)]
    return logged


def points_of(sites: Mapping[str, RowsSite], samples: Sequence[StateSample]) -> list[EntityRows]:
    """Points of the sensors that were due. A point under the cursor says its row's values."""
    shown = []
    for name, site in sites.items():
        width = len(site.columns)
        due = [s for s in samples if all(len(row) == width for row in s.rows.get(name, [[]]))]
        if due:
            shown.append(
                rows_at(naming.sensor(name), due, _columns(site, [s.rows[name] for s in due]))
            )
    return shown


def _columns(site: RowsSite, rows: Sequence[list[list[float]]]) -> list[rr.ComponentColumn]:
    counts = [len(its) for its in rows]
    values = np.array([row for its in rows for row in its], float).reshape(-1, len(site.columns))
    named = dict(zip(site.columns, values.T, strict=True))
    points = rr.Points3D.columns(
        positions=places(site.look, named),
        colors=colors(site.look, named),
        labels=[_label(site.columns, row) for row in values],
    ).partition(counts)
    more = rr.AnyValues.columns(**named).partition(counts)
    return [*points, *more]


def places(look: PointsLook, named: Mapping[str, np.ndarray]) -> np.ndarray:
    """Points in the sensor's axes, float64 [N, 3], of columns by name."""
    distance, azimuth, elevation = (
        named[name] for name in (look.range_m, look.azimuth_rad, look.elevation_rad)
    )
    level = distance * np.cos(elevation)
    ahead, left = level * np.cos(azimuth), level * np.sin(azimuth)
    return np.stack([ahead, left, distance * np.sin(elevation)], axis=1)


def colors(look: PointsLook, named: Mapping[str, np.ndarray]) -> np.ndarray:
    """uint8 [N, 3]: from red over grey at 0 to blue."""
    low, high = look.span
    stops = np.array([low, 0.0, high])
    tones = np.array([RED, GREY, BLUE], float)
    mixed = [np.interp(named[look.color], stops, tones[:, i]) for i in range(3)]
    return np.rint(np.stack(mixed, axis=1)).astype(np.uint8)


def _label(columns: Sequence[str], row: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(columns, row, strict=True))
