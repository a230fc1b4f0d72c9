"""Layout of a played scenario: views from above on the left, speeds and the log on the right."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import rerun.blueprint as rrb

from schemas.escape import escape
from schemas.files.played_scenario import PlayFile
from twin.records.play_file import poses_of
from viewer.playing import paths
from viewer.recording import naming
from viewer.recording.blueprint import BACKGROUND

_AHEAD = 0.25
"""Place below the eye that follows, before the ego, as a share of the eye's height."""
FAR_M = (40.0, 6_000.0)
"""Lowest and highest place of the eye that sees all [m]."""
TRAIL_S = 1e6
"""Length of a trail; longer than any scenario [s]."""
_HALF_FIELD = math.tan(math.radians(55.0) / 2.0)
"""Half of the height that Rerun's eye sees at a distance of 1 m."""
_ASPECT = 2.4
"""About how much wider than high a view is."""


def play_blueprint(
    play: PlayFile, origin_m: np.ndarray, *, speed: float = 1.0, paused: bool = False
) -> rrb.Blueprint:
    """Views from above, speeds, log and summary.

    Args:
        play: what is shown.
        origin_m: was taken off all places [3].
        speed: of playing, 1: as in sim time.
        paused: it waits; else it plays as soon as it is opened.
    """
    speeds = rrb.TimeSeriesView(
        origin=paths.SPEEDS,
        name="Speeds [m/s]",
        plot_legend=rrb.PlotLegend("LeftTop", visible=len(play.entities) <= 16),
    )
    log = rrb.TextLogView(
        origin=paths.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["body"], timeline_columns=[naming.SIM_TIME]),
        rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "DEBUG"]),
    )
    about = rrb.TextDocumentView(origin=paths.SUMMARY, name="Scenario")
    right = rrb.Vertical(about, speeds, log, row_shares=[0.75, 1.2, 2.0])
    left = rrb.Vertical(*_views(play, origin_m), row_shares=[1.7, 1.0])
    play_state: Literal["playing", "paused"] = "paused" if paused else "playing"
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1.6, 1.0]),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(
            state="collapsed",
            timeline=naming.SIM_TIME,
            play_state=play_state,
            playback_speed=speed,
        ),
        auto_layout=False,
        auto_views=False,
    )


def _views(play: PlayFile, origin_m: np.ndarray) -> list[rrb.Spatial3DView]:
    number = paths.followed(play)
    whole = _whole(play, origin_m)
    if number < 0:
        return [whole]
    heading, eye_m = paths.right_rad(play), paths.eye_height_m(play)
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0]) * _AHEAD * eye_m
    name = f"Around {escape(play.entities[number].name, 40)}"
    return [_from_above(play, f"/{paths.CENTRE}", name, ahead, eye_m, heading), whole]


def _whole(play: PlayFile, origin_m: np.ndarray) -> rrb.Spatial3DView:
    """All places of all entities, their longest extent from the left to the right."""
    rows = [poses_of(entity.poses)[:, 1:4] for entity in play.entities]
    places = np.concatenate([*rows, np.zeros((0, 3))]) - origin_m
    if not len(places):
        places = np.zeros((1, 3))
    heading = paths.right_rad(play)
    along = places @ [math.cos(heading), math.sin(heading), 0.0]
    across = places @ [-math.sin(heading), math.cos(heading), 0.0]
    if np.ptp(across) > np.ptp(along):
        heading, along, across = heading + 0.5 * math.pi, across, -along
    middle_x, middle_y = (float(axis.min() + axis.max()) / 2.0 for axis in (along, across))
    c, s = math.cos(heading), math.sin(heading)
    centre = np.array(
        [c * middle_x - s * middle_y, s * middle_x + c * middle_y, float(places[:, 2].mean())]
    )
    needed = max(float(np.ptp(along)) / _ASPECT, float(np.ptp(across))) / 2.0 + 8.0
    height = min(max(needed / _HALF_FIELD, FAR_M[0]), FAR_M[1])
    return _from_above(play, f"/{paths.ROOT}", "Whole scene", centre, height, heading)


def _from_above(
    play: PlayFile,
    origin: str,
    name: str,
    below: np.ndarray,
    height_m: float,
    heading_rad: float,
) -> rrb.Spatial3DView:
    """A view straight down on a place; ``heading_rad`` points to the right."""
    so_far = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            naming.SIM_TIME,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=rrb.TimeRangeBoundary.cursor_relative(seconds=0),
        )
    )
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=[f"+ /{paths.ROOT}/**"],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=below + np.array([0.0, 0.0, height_m]),
            look_target=below,
            eye_up=[-math.sin(heading_rad), math.cos(heading_rad), 0.0],
        ),
        line_grid=False,
        background=BACKGROUND,
        overrides={f"/{paths.TRAILS}/{part}": so_far for part in paths.entity_names(play)},
    )
