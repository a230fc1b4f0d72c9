"""What each axis of the matrix does: shares of passed cases by its values, with intervals."""

from __future__ import annotations

import html
import json
import statistics
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from conductor.report.analysis.statistics import wilson
from conductor.report.reading.axes import axis_label, axis_value, axis_values, varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier

_COLUMNS = 3
_ROW_PX = 270
_COLOR = "#0072B2"


@dataclass(frozen=True, slots=True)
class Level:
    """One value of an axis; cases without a verdict are left out and counted apart."""

    value: str
    passed: int
    total: int
    """Cases with a verdict."""
    missing: int
    """Cases without a verdict."""
    low: float | None
    """Bounds of the share at 95 % (Wilson), 0 to 1; None: no case has a verdict."""
    high: float | None
    closest_m: float | None
    """Median of the smallest distances of cases without a collision [m]."""

    @property
    def share(self) -> float | None:
        """Share of passed cases in those with a verdict, 0 to 1."""
        return self.passed / self.total if self.total else None


@dataclass(frozen=True, slots=True)
class Effect:
    """The main effect of one axis."""

    axis: str
    label: str
    levels: list[Level]


def main_effects(dossier: Dossier) -> list[Effect]:
    """The main effect of every axis that is varied, in the order of the page."""
    effects = []
    for axis in varied_axes(dossier):
        groups: dict[Any, list[CaseRow]] = {value: [] for value in axis_values(dossier, axis)}
        for row in dossier.rows:
            groups[axis_value(row.case, axis)].append(row)
        levels = [_level(str(value), rows) for value, rows in groups.items()]
        effects.append(Effect(axis, axis_label(axis), levels))
    return effects


def _level(value: str, rows: list[CaseRow]) -> Level:
    decided = [row for row in rows if row.passed is not None]
    passed = [row for row in decided if row.passed]
    low, high = wilson(len(passed), len(decided)) if decided else (None, None)
    unhurt = [row for row in decided if row.no_collision]
    known = [d for row in unhurt if (d := row.scalar("dtc_min_m")) is not None]
    return Level(
        value=value,
        passed=len(passed),
        total=len(decided),
        missing=len(rows) - len(decided),
        low=low,
        high=high,
        closest_m=statistics.median(known) if known else None,
    )


def effects_figure(effects: list[Effect], *, columns_max: int = _COLUMNS) -> dict[str, Any] | None:
    """Plotly JSON, a small plot per axis; None where nothing is varied or decided."""
    shown = [e for e in effects if any(level.total for level in e.levels)]
    if not shown:
        return None
    columns = min(columns_max, len(shown))
    rows = -(-len(shown) // columns)
    figure = make_subplots(
        rows=rows,
        cols=columns,
        shared_yaxes="all",
        horizontal_spacing=0.06,
        vertical_spacing=0.38 / rows,
        subplot_titles=[effect.label for effect in shown],
    )
    for note in figure.layout.annotations:
        note.update(font={"size": 13, "weight": 600})
    for number, effect in enumerate(shown):
        row, column = number // columns + 1, number % columns + 1
        figure.add_trace(_points(effect), row=row, col=column)
        figure.update_xaxes(type="category", row=row, col=column)
        if column == 1:
            figure.update_yaxes(title={"text": "passed [%]"}, row=row, col=column)
    figure.update_yaxes(range=[-4, 104], tickvals=[0, 25, 50, 75, 100])
    figure.update_layout(
        template=go.layout.Template(),
        height=70 + _ROW_PX * rows,
        margin={"l": 64, "r": 12, "t": 34, "b": 70},
        hovermode="closest",
        showlegend=False,
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain


def _points(effect: Effect) -> Any:
    levels = [level for level in effect.levels if level.share is not None]
    shares = [100 * (level.share or 0.0) for level in levels]
    return go.Scatter(
        x=[html.escape(level.value.replace("_", " "), quote=False) for level in levels],
        y=shares,
        mode="lines+markers",
        line={"color": _COLOR, "width": 1.2, "dash": "dot"},
        marker={"size": 8, "color": _COLOR},
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [
                100 * (level.high or 0.0) - s for level, s in zip(levels, shares, strict=True)
            ],
            "arrayminus": [
                s - 100 * (level.low or 0.0) for level, s in zip(levels, shares, strict=True)
            ],
            "thickness": 1.2,
            "width": 4,
            "color": _COLOR,
        },
        text=[_told(level) for level in levels],
        hovertemplate="%{x}<br>%{text}<extra></extra>",
    )


def _told(level: Level) -> str:
    lines = [
        f"{level.passed} of {level.total} passed",
        f"95 %: {100 * (level.low or 0):.1f} to {100 * (level.high or 0):.1f} %",
    ]
    if level.missing:
        lines.append(f"{level.missing} without a verdict")
    if level.closest_m is not None:
        lines.append(f"closest, median of passes: {level.closest_m:.2f} m")
    return "<br>".join(lines)
