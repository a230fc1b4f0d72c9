"""Rows of sensors that see, as points: radar detections by their declaration's look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from schemas.kinds.point_look import colors, places
from schemas.wire.view import RowsSite, StateSample
from viewer.recording import naming
from viewer.recording.rows import EntityRows, rows_at
from viewer.recording.scenery import Logged, rotation

POINT_RADIUS = 3.0
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


def _label(columns: Sequence[str], row: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(columns, row, strict=True))
