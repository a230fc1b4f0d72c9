"""The picture of a scenario from above: lanes, ways of everybody, places where events began."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from schemas.escape import escape
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.validate.road_picture import draw_roads
from twin.validate.scenario_play import ScenarioPlay

_WIDTH_IN = 15.0
_HEIGHT_MAX_IN = 13.0
_MARGIN_M = 12.0
_ASPECT_MAX = 14.0
"""A longer picture than this is stretched across the road, and says so."""
_GHOSTS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 600.0)
"""Times between two outlines of a moving body, of which the first counts that is long enough."""
_GHOSTS_MAX = 120
"""Outlines of a picture; more would hide each other."""
_EGO_COLOR = "#2a4bd0"
_COLORS = (
    *("#d4472f", "#e08a1e", "#2f8f4e", "#8a4fb5", "#c23b7a", "#1f8a94", "#7a5a2f", "#b0a020"),
    *("#5a6fb0", "#9a3030", "#4f7f2f", "#b5602f", "#6a4a9a", "#2f6f6f", "#a04f8f", "#5f5f2f"),
)


def write_scenario_picture(path: Path, roads: RoadMap | None, play: ScenarioPlay) -> None:
    """Write a picture of a scenario that was played; folders are made if they are not there.

    Args:
        path: a PNG or SVG file.
        roads: of the program; None: open ground.
        play: what happened.

    Raises:
        OSError: it cannot be written.
        ValueError: its suffix is none of a picture.
    """
    if path.suffix not in (".png", ".svg"):
        raise ValueError(f"{path}: a picture is a .png or .svg file")
    figures = importlib.import_module("matplotlib.figure")
    box = _box(play)
    wide, high = box[2] - box[0], box[3] - box[1]
    stretch = max(1.0, wide / high / _ASPECT_MAX)
    height_in = float(np.clip(_WIDTH_IN * stretch * high / wide, 2.0, _HEIGHT_MAX_IN))
    figure = figures.Figure(figsize=(_WIDTH_IN, height_in + 1.3), layout="constrained")
    axes = figure.subplots()
    if roads is not None:
        draw_roads(axes, roads, box)
    axes.set_xlim(box[0], box[2])
    axes.set_ylim(box[1], box[3])
    axes.set_aspect(stretch, adjustable="box")
    period_s = _period(play)
    for index, entity in enumerate(play.program.entities):
        _draw_entity(axes, play, index, entity, period_s)
    _draw_events(axes, play)
    name = escape(play.program.name, 120).replace("$", r"\$")
    scale = "" if stretch == 1.0 else f"; {stretch:.1f} times as wide across as along"
    axes.set_title(
        f"{name}: {play.time_s[-1]:.1f} s, outlines every {period_s:.0f} s{scale}", loc="left"
    )
    figure.legend(loc="outside lower center", ncols=6, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Software": None} if path.suffix == ".png" else {"Date": None, "Creator": None}
    figure.savefig(path, dpi=110, facecolor="white", bbox_inches="tight", metadata=metadata)


def _box(play: ScenarioPlay) -> tuple[float, float, float, float]:
    """Everybody's ways with a margin, not too flat."""
    x0, x1 = float(np.nanmin(play.x_m)) - _MARGIN_M, float(np.nanmax(play.x_m)) + _MARGIN_M
    y0, y1 = float(np.nanmin(play.y_m)) - _MARGIN_M, float(np.nanmax(play.y_m)) + _MARGIN_M
    if x1 - x0 < y1 - y0:
        more = 0.5 * (y1 - y0 - (x1 - x0))
        x0, x1 = x0 - more, x1 + more
    return x0, y0, x1, y1


def _color(play: ScenarioPlay, index: int) -> str:
    if play.program.entities[index].ego:
        return _EGO_COLOR
    return _COLORS[(index - 1) % len(_COLORS)]


def _period(play: ScenarioPlay) -> float:
    """Time between outlines, so that there are not too many [s]."""
    seconds = len(play.program.entities) * float(play.time_s[-1])
    return next((p for p in _GHOSTS_S if seconds / p <= _GHOSTS_MAX), _GHOSTS_S[-1])


def _draw_entity(
    axes: Any, play: ScenarioPlay, index: int, entity: StoryboardEntity, period_s: float
) -> None:
    """Way, an outline at every period, and where it ended."""
    color = _color(play, index)
    middle = play.middle(entity.name)
    axes.plot(middle[:, 0], middle[:, 1], color=color, linewidth=1.6, zorder=10)
    label = escape(entity.name, 40)
    moments = [play.at(t) for t in np.arange(0.0, play.time_s[-1] + 1e-9, period_s)]
    for moment in moments:
        _outline(axes, play, index, moment, entity, facecolor=color, edgecolor="white", alpha=0.4)
    _outline(
        axes,
        play,
        index,
        len(play.time_s) - 1,
        entity,
        facecolor=color,
        edgecolor="white",
        alpha=0.9,
        label=f"{label} ({escape(entity.catalog_entry or entity.category.name.lower(), 40)})",
    )


def _outline(
    axes: Any, play: ScenarioPlay, index: int, moment: int, entity: StoryboardEntity, **look: Any
) -> None:
    box, heading = entity.box, play.heading_rad[moment, index]
    if np.isnan(heading):
        return
    ahead = box.centre_x_m + 0.5 * box.length_m * np.array([1.0, 1.0, 0.6, -1.0, -1.0, 0.6])
    aside = box.centre_y_m + 0.5 * box.width_m * np.array([0.4, -0.4, -1.0, -1.0, 1.0, 1.0])
    c, s = np.cos(heading), np.sin(heading)
    x = play.x_m[moment, index] + c * ahead - s * aside
    y = play.y_m[moment, index] + s * ahead + c * aside
    axes.fill(x, y, linewidth=0.8, zorder=11, **look)


def _draw_events(axes: Any, play: ScenarioPlay) -> None:
    """A dot where an actor's events began, and their names beside it."""
    began: dict[tuple[str, float], list[str]] = {}
    for event in play.events:
        if event.started and event.actor and not event.belongs:
            began.setdefault((event.actor, event.time_s), []).append(event.name)
    for number, ((actor, time_s), names) in enumerate(began.items()):
        x, y = play.middle(actor)[play.at(time_s)]
        if np.isnan(x):
            continue
        color = _color(play, play.entity(actor))
        axes.plot([x], [y], marker="o", markersize=6, color=color, mec="white", zorder=13)
        # Labels that follow one another stand on different sides and at different heights.
        above = 26.0 + 15.0 * (number % 4)
        words = escape(f"{time_s:.2f} s {actor}: {', '.join(names)}", 120).replace("$", r"\$")
        axes.annotate(
            words,
            (x, y),
            (8.0, above if number % 2 == 0 else -above),
            textcoords="offset points",
            fontsize=9,
            color=color,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.7},
            bbox={"boxstyle": "round,pad=0.2", "facecolor": "#ffffffd0", "edgecolor": "none"},
            zorder=14,
        )
