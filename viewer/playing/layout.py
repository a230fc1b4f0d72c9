"""Layout of a played scenario: views from above on the left, speeds and the log on the right."""

from __future__ import annotations

from typing import Literal

import numpy as np
import rerun.blueprint as rrb

from schemas.escape import escape
from schemas.files.played_scenario import PlayFile
from viewer.playing import paths
from viewer.playing.eyes import TopEye, far_eye, near_eye
from viewer.recording import naming
from viewer.recording.blueprint import BACKGROUND

TRAIL_S = 1e6
"""Length of a trail; longer than any scenario [s]."""


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
    near, far = near_eye(play), far_eye(play, origin_m)
    whole = _from_above(play, f"/{paths.ROOT}", "Whole scene", far)
    if near is None:
        return [whole]
    name = f"Around {escape(play.entities[paths.followed(play)].name, 40)}"
    return [_from_above(play, f"/{paths.CENTRE}", name, near), whole]


def _from_above(play: PlayFile, origin: str, name: str, eye: TopEye) -> rrb.Spatial3DView:
    """A view straight down, with the names that are meant for it."""
    so_far = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            naming.SIM_TIME,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=rrb.TimeRangeBoundary.cursor_relative(seconds=0),
        )
    )
    x, y, z = eye.below
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=[
            f"+ /{paths.ROOT}/**",
            f"- /{paths.NAMES}/**",
            f"+ /{paths.NAMES}/{eye.key}/**",
        ],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(x, y, z + eye.height_m),
            look_target=eye.below,
            eye_up=eye.upwards(1.0) / eye.pixel_m,
        ),
        line_grid=False,
        background=BACKGROUND,
        overrides={f"/{paths.TRAILS}/{part}": so_far for part in paths.entity_names(play)},
    )
