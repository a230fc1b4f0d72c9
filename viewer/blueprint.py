"""Layouts: what stands where on the screen."""

from __future__ import annotations

import rerun.blueprint as rrb

from schemas.view import Stage
from viewer import naming

_BOXES = (naming.DETECTIONS, naming.DETECTIONS_FAR, naming.TRUTH)

TRAIL_SECONDS_MAX = 3600
"""How far back the ego's trail is shown; longer than any case [s]."""


def case_blueprint(stage: Stage) -> rrb.Blueprint:
    """Camera and street on the left, verdict and plots on the right."""
    center = stage.obstacle_center_m
    camera = rrb.Spatial2DView(origin=naming.CAMERA, name="Camera, detections, truth (thin)")
    street = rrb.Spatial3DView(
        origin=naming.WORLD,
        name="Street",
        contents=["$origin/**", *(f"- {path}" for path in _BOXES)],
        eye_controls=rrb.EyeControls3D(
            tracking_entity=naming.EGO,
            position=[center[0] - 50.0, -9.0, 9.0],
            look_target=[center[0] - 30.0, 1.0, 0.0],
        ),
        line_grid=False,
        background=(18, 20, 25),
        overrides={naming.TRAIL: _trail()},
    )
    plots = [
        _plot("Speed [m/s]", [naming.SPEED]),
        _plot("Distance to collision [m]", [naming.DTC]),
        _plot("Throttle, brake, AEB", [naming.THROTTLE, naming.BRAKE, naming.AEB], (0.0, 1.05)),
    ]
    right = rrb.Vertical(
        rrb.TextDocumentView(origin=naming.SUMMARY, name="Case"),
        *plots,
        rrb.TextLogView(origin=naming.EVENTS, name="Events", columns=_event_columns()),
        row_shares=[1.25, 1, 1, 1.1, 1.1],
    )
    left = rrb.Vertical(camera, street, row_shares=[1, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1.7, 1]),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=naming.SIM_TIME),
        auto_layout=False,
        auto_views=False,
    )


def overview_blueprint() -> rrb.Blueprint:
    """The mosaic, and the cases as text beside it."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial2DView(origin=naming.MOSAIC, name="Cases", background=(18, 20, 25)),
            rrb.TextDocumentView(origin=naming.CASES, name="Running and latest"),
            column_shares=[2.2, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=naming.WALL, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _plot(
    name: str, paths: list[str], range_: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/",
        name=name,
        contents=paths,
        axis_y=rrb.ScalarAxis(range=range_) if range_ else None,
        plot_legend=rrb.PlotLegend("LeftTop", visible=len(paths) > 1),
    )


def _event_columns() -> rrb.TextLogColumns:
    return rrb.TextLogColumns(text_log_columns=["body"], timeline_columns=[naming.SIM_TIME])


def _trail() -> rrb.VisibleTimeRanges:
    """Everything up to the time cursor."""
    return rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            naming.SIM_TIME,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_SECONDS_MAX),
            end=rrb.TimeRangeBoundary.cursor_relative(seconds=0),
        )
    )
