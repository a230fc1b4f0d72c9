"""Layouts: what stands where on the screen."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal

import rerun.blueprint as rrb

from schemas.messages import CameraSite, LidarSite
from schemas.wire.view import Stage
from viewer.recording import naming

_BOXES = (naming.DETECTIONS, naming.DETECTIONS_FAR, naming.TRIGGER, naming.TRUTH)

BACKGROUND = (18, 20, 25)
SKY = (118, 138, 160)

ABOVE_AHEAD_M, ABOVE_M = 40.0, 65.0
"""Where the eye of the view from above is: before the ego, and over the road [m]."""

WALL_SECONDS = 300
"""Length of the past that the overview's plots show [s]."""

NAMES = uuid.UUID("6c0c39b5-6a29-5f0f-9a5e-0c4b6e1a3d57")
"""Namespace of the ids of a layout's parts."""

TRAIL_SECONDS_MAX = 3600
"""Length of the ego's trail; longer than any case [s]."""


def case_blueprint(
    stage: Stage,
    cameras: Sequence[CameraSite] = (),
    lidars: Sequence[LidarSite] = (),
    sensors: Mapping[str, Sequence[str]] = MappingProxyType({}),
    *,
    grids: Sequence[str] = (),
    rows: Sequence[str] = (),
    live: bool = False,
) -> rrb.Blueprint:
    """Cameras, street and events on the left, verdict and plots on the right.

    Args:
        stage: what stands still.
        cameras: all of the ego's that see; empty, unless ``live``: the main one.
        lidars: of the ego; their points are shown in the street.
        sensors: with a row of numbers -> names of the columns; a plot for each.
        grids: sensors whose grids are drawn as pictures, beside those of the cameras.
        rows: sensors whose rows are drawn as points; a view from above for them.
        live: the newest is followed, and the eye drives behind the ego.
    """
    names = [site.message for site in cameras] if cameras or live else ["camera"]
    views = [_camera(name, main=name == names[0]) for name in names]
    views += [rrb.Spatial2DView(origin=naming.grid(name), name=name) for name in grids]
    plots = [
        _plot("Speed [m/s]", [naming.SPEED]),
        _plot("Distance to collision [m]", [naming.DTC]),
        _plot("Throttle, brake, AEB", [naming.THROTTLE, naming.BRAKE, naming.AEB], (0.0, 1.05)),
    ]
    read = [
        _plot(f"Sensor {name}", [naming.reading(name, column) for column in columns])
        for name, columns in sensors.items()
    ]
    right = rrb.Vertical(
        rrb.TextDocumentView(origin=naming.SUMMARY, name="Case"),
        rrb.StateTimelineView(origin=naming.PLANNER, name="Planner"),
        *plots,
        *read,
        # In 1280 x 720 pixels nothing is cut: what is said of a case, the planner's bar, legends.
        row_shares=[2.1, 0.95, 1, 1, 1.2, *([1.0] * len(read))],
    )
    events = rrb.TextLogView(origin=naming.EVENTS, name="Events", columns=_event_columns())
    street = _chase(lidars) if live else _street(stage)
    pictures = [rrb.Grid(*views)] if len(views) > 1 else views
    below = [street, _from_above(rows)] if rows else [street]
    beside = [rrb.Horizontal(*below, column_shares=[1.5, 1])] if rows else below
    left = rrb.Vertical(*pictures, *beside, events, row_shares=[3, 2.1, 1])
    play_state: Literal["following", "paused"] = "following" if live else "paused"
    return rrb.Blueprint(
        _named(rrb.Horizontal(left, right, column_shares=[1.4, 1])),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=naming.SIM_TIME, play_state=play_state),
        auto_layout=False,
        auto_views=False,
    )


def overview_blueprint(*, bare: bool = False) -> rrb.Blueprint:
    """The wall on the left; cases as text, throughput, workers and events on the right.

    ``bare``: for a picture, without what one clicks on.
    """
    right = rrb.Vertical(
        rrb.TextDocumentView(origin=naming.CASES, name="Running and latest"),
        _wall_plot("Cases per minute", [naming.THROUGHPUT]),
        _wall_plot("Running cases, workers", [naming.RUNNING, naming.WORKERS_PRESENT]),
        _wall_plot("Cases per worker", [f"{naming.WORKERS}/**"], legend=False),
        rrb.TextLogView(origin=naming.EVENTS, name="Conductor", columns=_wall_columns()),
        row_shares=[1.9, 0.8, 0.8, 0.8, 1.3],
    )
    return rrb.Blueprint(
        _named(
            rrb.Horizontal(
                rrb.Spatial2DView(
                    origin=naming.MOSAIC,
                    name="Cases",
                    background=BACKGROUND,
                ),
                right,
                column_shares=[2.0, 1],
            )
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        *([rrb.TopPanel(state="hidden")] if bare else []),
        rrb.TimePanel(
            state="hidden" if bare else "collapsed", timeline=naming.WALL, play_state="following"
        ),
        auto_layout=False,
        auto_views=False,
    )


def _named(part: rrb.Container) -> rrb.Container:
    """``part`` with ids that say what its parts are, instead of random ones.

    Rerun keeps every name of an entity that it has met: 6 kB for a layout with names of its own.
    """
    parts: list[rrb.Container | rrb.View] = [part]
    for number, member in enumerate(parts):
        if isinstance(member, rrb.Container):
            parts += member.contents
            words = f"container {number}"
        else:
            # A viewer may remember what belongs to an id: never another kind of view.
            words = f"{member.class_identifier} {member.name} {number}"
        member.id = uuid.uuid5(NAMES, words)
    return part


def _camera(message: str, *, main: bool) -> rrb.Spatial2DView:
    """A camera's picture; detections and truth are of the main one."""
    name = "Camera, detections, truth (thin)" if main else message.partition(".")[2]
    return rrb.Spatial2DView(origin=naming.sensor(message), name=name)


def _street(stage: Stage) -> rrb.Spatial3DView:
    """View from above, beside the street: its buildings are as flat as their plan."""
    x_m = (stage.obstacle_center_m or [stage.lane[0][0] + 80.0])[0]
    return rrb.Spatial3DView(
        origin=naming.WORLD,
        name="Street",
        contents=["$origin/**", *(f"- {path}" for path in _BOXES)],
        eye_controls=rrb.EyeControls3D(
            tracking_entity=naming.EGO,
            position=[x_m - 50.0, -9.0, 9.0],
            look_target=[x_m - 30.0, 1.0, 0.0],
        ),
        line_grid=False,
        background=BACKGROUND,
        overrides={naming.TRAIL: _trail()},
    )


def _chase(lidars: Sequence[LidarSite]) -> rrb.Spatial3DView:
    """View from behind the ego, in its own axes: the walls beside the street are solid."""
    return rrb.Spatial3DView(
        origin=naming.EGO,
        name="Street, lidar" if lidars else "Street",
        contents=[f"/{naming.WORLD}/**", *(f"- /{path}" for path in _BOXES)],
        eye_controls=rrb.EyeControls3D(
            position=[-10.0, 2.2, 4.6],
            look_target=[14.0, 0.0, 0.5],
        ),
        line_grid=False,
        background=SKY,
        overrides={f"/{naming.TRAIL}": _trail()},
    )


def _from_above(rows: Sequence[str]) -> rrb.Spatial3DView:
    """What sensors see by rows, from above, the way ahead of the ego to the right."""
    return rrb.Spatial3DView(
        origin=naming.EGO,
        name=f"{', '.join(rows)} from above".capitalize(),
        contents=[
            *(f"/{naming.sensor(name)}" for name in rows),
            f"/{naming.EGO_BODY}",
            f"/{naming.MOVERS}",
            f"/{naming.STREET}",
            f"/{naming.OBSTACLE}",
            f"/{naming.PARKED}",
        ],
        eye_controls=rrb.EyeControls3D(
            position=[ABOVE_AHEAD_M, 0.0, ABOVE_M],
            look_target=[ABOVE_AHEAD_M, 0.0, 0.0],
            eye_up=[0.0, 1.0, 0.0],
        ),
        line_grid=False,
        background=BACKGROUND,
    )


def _wall_plot(name: str, paths: list[str], *, legend: bool = True) -> rrb.TimeSeriesView:
    """The latest minutes of the wall clock."""
    return rrb.TimeSeriesView(
        origin="/",
        name=name,
        contents=paths,
        axis_x=rrb.TimeAxis(
            view_range=rrb.TimeRange(
                start=rrb.TimeRangeBoundary.cursor_relative(seconds=-WALL_SECONDS),
                end=rrb.TimeRangeBoundary.cursor_relative(seconds=0),
            )
        ),
        plot_legend=rrb.PlotLegend("LeftTop", visible=legend and len(paths) > 1),
    )


def _wall_columns() -> rrb.TextLogColumns:
    return rrb.TextLogColumns(text_log_columns=["body"], timeline_columns=[naming.WALL])


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
