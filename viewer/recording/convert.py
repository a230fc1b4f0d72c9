"""Messages of the view plane -> what Rerun is told: static values, and rows of columns. No I/O.

Many messages are converted together: a row alone costs Python's time once per entity, a column of
rows hardly more (1.2 and 0.2 ms per tick, measured).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import rerun as rr
from msgspec import structs

from schemas.messages import Detection
from schemas.wire.codec import decode, encode
from schemas.wire.view import CameraSample, CaseEnd, CaseStart, Controls, ImageBox, StateSample
from viewer.recording import naming
from viewer.recording.classes import class_id, contexts
from viewer.recording.rows import EntityRows, rows_at
from viewer.recording.scenery import (
    BLUE,
    CYAN,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    YELLOW,
    Color,
    Logged,
    eyes,
    movers,
    outline,
    quaternion,
    verdict_color,
)
from viewer.recording.sensor_points import mounted, points_of
from viewer.recording.summary import ended_text, running_text

LABEL_SHARE = 0.05
"""A box narrower than this share of the picture has no room for a label [-]."""

TRAIL_M = 0.08
"""Height of the trail above the road [m]."""


class CaseConverter:
    """Converts the messages of one attempt, in order; remembers only what makes an event."""

    def __init__(self, start: CaseStart) -> None:
        self._start = start
        self._aeb = False
        self._seen = False
        self._marked = False
        """The box that triggers emergency braking stands in the picture."""
        self._planner = ""
        self.hand = ""
        """What somebody has done to the case, as of the latest state."""
        self._tick = 0
        """Tick of the latest state."""
        self._moving = False
        """Objects that move are drawn."""
        self._leaning = 0.0, 0.0, 0.0
        """Height [m], pitch and roll [rad] of the ego in the latest state that has them."""

    def start(self) -> list[Logged]:
        """Static scene, intrinsics and styles; logged without a time.

        A world that comes as a mesh is not drawn here.
        """
        return [
            *_standing(_bare(self._start)),
            (naming.SUMMARY, _document(running_text(self._start))),
        ]

    def states(self, samples: Sequence[StateSample]) -> list[EntityRows]:
        """KPI rows: poses, plots and what camera and stack saw."""
        if not samples:
            return []
        asked = [(sample, sample.controls) for sample in samples if sample.controls is not None]
        rows = [
            *self._poses(samples),
            _plotted(naming.SPEED, samples, [s.speed_mps for s in samples]),
            _plotted(naming.ACCEL, samples, [s.accel_mps2 for s in samples]),
        ]
        measured = [(s, s.dtc_m) for s in samples if s.dtc_m is not None]
        if measured and self._start.stage.obstacle_center_m:  # else it is to what is nearest
            rows.append(rows_at(naming.GAP, [s for s, _ in measured], self._gaps(measured)))
        if measured:
            rows.append(_plotted(naming.DTC, [s for s, _ in measured], [d for _, d in measured]))
        closing = [(s, s.ttc_s) for s in samples if s.ttc_s is not None]
        rows.append(_plotted(naming.TTC, [s for s, _ in closing], [t for _, t in closing]))
        rows += _commanded(asked)
        rows += self._readings(samples)
        rows += points_of(self._start.rows, samples)
        # Between frames nothing is looked at; the boxes of the last one stay.
        looked = [(s, c) for s, c in asked if s.boxes is not None or c.detections]
        rows += self._detections(looked)
        rows.append(self._triggers(looked))
        rows.append(_truth([s for s in samples if s.boxes is not None]))
        rows.append(_moving([s for s in samples if self._has_moved(s)]))
        for sample in samples:
            rows += self._changes(sample)
        self._tick = samples[-1].tick
        return [entity for entity in rows if entity.ticks]

    def pictures(
        self, pictures: Sequence[tuple[CameraSample, bytes]], name: str = "camera"
    ) -> list[EntityRows]:
        """JPEGs of the camera or grid whose messages are called ``name``, passed through
        untouched."""
        if not pictures:
            return []
        columns = rr.EncodedImage.columns(
            blob=[jpeg for _, jpeg in pictures], media_type=["image/jpeg"] * len(pictures)
        )
        path = naming.grid(name) if name in self._start.grids else naming.sensor(name)
        return [rows_at(path, [sample for sample, _ in pictures], columns)]

    def end(self, end: CaseEnd) -> list[EntityRows]:
        """The verdict as an event."""
        if not end.outcome:
            text, level, color = "attempt given up: the case was taken back", "WARN", GREY
        else:
            text = ": ".join([end.verdict or end.outcome, *end.reasons])
            level = "INFO" if end.passed else "ERROR"
            color = verdict_color(end.verdict)
        return [_event(end.sim_time_ns, self._tick, text, level, color)]

    def summary(self, end: CaseEnd | None, lost: int) -> list[Logged]:
        """What the case came to, static."""
        return [(naming.SUMMARY, _document(ended_text(self._start, end, lost)))]

    def touched(self) -> list[Logged]:
        """Text above the case after an intervention, static."""
        return [(naming.SUMMARY, _document(running_text(self._start, self.hand)))]

    def _has_moved(self, sample: StateSample) -> bool:
        """Whether objects that move are to be drawn, or one that has gone is to be taken away. In
        the last row, which has no controls, nobody has looked at them: they stay."""
        if sample.controls is None:
            return bool(sample.movers)
        before, self._moving = self._moving, bool(sample.movers)
        return before or self._moving

    def _poses(self, samples: Sequence[StateSample]) -> list[EntityRows]:
        """The ego, and the points of its trail. The yaw stands apart from the rest of the turn,
        which :mod:`viewer.playback.frames` does without."""
        leaning = []
        for sample in samples:
            if sample.z_m is not None:
                self._leaning = sample.z_m, sample.pitch_rad, sample.roll_rad
            leaning.append(self._leaning)
        places = [[s.x_m, s.y_m, z_m] for s, (z_m, _, _) in zip(samples, leaning, strict=True)]
        poses = rr.Transform3D.columns(
            translation=places,
            rotation_axis_angle=[
                rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=s.yaw_rad)) for s in samples
            ],
            quaternion=[quaternion(0.0, pitch, roll) for _, pitch, roll in leaning],
        )
        trail = rr.Points3D.columns(positions=[[x, y, z + TRAIL_M] for x, y, z in places])
        return [rows_at(naming.EGO, samples, poses), rows_at(naming.TRAIL, samples, trail)]

    def _readings(self, samples: Sequence[StateSample]) -> list[EntityRows]:
        """Plots of the sensors with a row of numbers, one per column."""
        plots = []
        for name, columns in self._start.sensors.items():
            read = [(s, s.sensors.get(name, [])) for s in samples]
            read = [(s, row) for s, row in read if len(row) == len(columns)]
            for place, column in enumerate(columns):
                values = [row[place] for _, row in read]
                plots.append(_plotted(naming.reading(name, column), [s for s, _ in read], values))
        return plots

    def _changes(self, sample: StateSample) -> list[EntityRows]:
        """Events, and a coloured bar of the planner's state where it changes."""
        controls = sample.controls
        braking = controls is not None and controls.aeb
        rows: list[EntityRows] = []
        at = sample.sim_time_ns, sample.tick
        if controls is not None:
            if controls.detections and not self._seen:
                self._seen = True
                first = controls.detections[0]
                detection = f"{first.label} {first.confidence:.2f}{self._at(sample)}"
                rows.append(_event(*at, f"first detection: {detection}", "INFO", ORANGE))
            if braking and not self._aeb:
                text = f"AEB triggered{self._at(sample)}, {sample.speed_mps:.1f} m/s"
                if (cause := triggering(controls)) is not None:
                    text += f", by {cause.label} {cause.confidence:.2f}"
                rows.append(_event(*at, text, "WARN", RED))
            self._aeb = braking
        if sample.hand != self.hand:
            self.hand = sample.hand
            rows.append(_event(*at, f"by hand: {sample.hand or 'nothing'}", "WARN", VIOLET))
        state = "collision" if sample.collisions else "AEB" if braking else "driving"
        if state != self._planner:
            self._planner = state
            rows.append(rows_at(naming.PLANNER, [sample], rr.StateChange.columns(state=[state])))
        return rows

    def _at(self, sample: StateSample) -> str:
        """`` (obstacle 12.3 m ahead)``, where something stands in the lane: how far that is, not
        what a detection takes for it."""
        if sample.dtc_m is None:
            return ""
        if self._start.stage.obstacle_center_m:
            return f" (obstacle {sample.dtc_m:.1f} m ahead)"
        return f" (distance to collision {sample.dtc_m:.1f} m)"

    def _detections(self, asked: list[tuple[StateSample, Controls]]) -> list[EntityRows]:
        """Near and far ones apart: labels of far ones would hide each other."""
        if not asked:
            return []
        width_px = LABEL_SHARE * self._start.width
        samples = [sample for sample, _ in asked]
        colors = [RED if controls.aeb else ORANGE for _, controls in asked]
        near = [[d for d in c.detections if d.width_px >= width_px] for _, c in asked]
        far = [[d for d in c.detections if d.width_px < width_px] for _, c in asked]
        rows = []
        for path, boxes in ((naming.DETECTIONS, near), (naming.DETECTIONS_FAR, far)):
            labels = [f"{d.label} {d.confidence:.2f}" for row in boxes for d in row]
            columns = [*rr.Boxes2D.columns(colors=colors), *_marks(boxes, labels)]
            rows.append(rows_at(path, samples, columns))
        return rows

    def _triggers(self, asked: list[tuple[StateSample, Controls]]) -> EntityRows:
        """The box that emergency braking begins for; the next frame takes it away."""
        samples, rows = [], []
        for sample, controls in asked:
            cause = triggering(controls)
            if cause is not None or self._marked:
                samples.append(sample)
                rows.append([] if cause is None else [cause])
            self._marked = cause is not None
        labels = [f"{d.label} {d.confidence:.2f}" for row in rows for d in row]
        return rows_at(naming.TRIGGER, samples, _marks(rows, labels))

    def _gaps(self, measured: Sequence[tuple[StateSample, float]]) -> list[rr.ComponentColumn]:
        """Lines from the ego's nose to the obstacle's rear, labelled with the distance [m]."""
        stage = self._start.stage
        nose = stage.ego_center_m[0] + stage.ego_size_m[0] / 2
        center = stage.obstacle_center_m
        half, yaw = stage.obstacle_size_m[0] / 2, stage.obstacle_yaw_rad
        rear = [center[0] - half * math.cos(yaw), center[1] - half * math.sin(yaw), 0.3]
        strips = []
        for s, _ in measured:
            front = [s.x_m + nose * math.cos(s.yaw_rad), s.y_m + nose * math.sin(s.yaw_rad), 0.3]
            strips.append([front, rear])
        braking = [s.controls is not None and s.controls.aeb for s, _ in measured]
        return list(
            rr.LineStrips3D.columns(
                strips=strips,
                colors=[RED if aeb else GREEN for aeb in braking],
                labels=[f"{dtc_m:.1f} m" for _, dtc_m in measured],
            )
        )


def triggering(controls: Controls) -> Detection | None:
    """The detection that emergency braking begins for; None: none does, or nobody says which."""
    place = controls.trigger
    if place is None or not 0 <= place < len(controls.detections):
        return None
    return controls.detections[place]


def _bare(start: CaseStart) -> bytes:
    """Start without what differs from case to case of a campaign."""
    return encode(
        structs.replace(
            start,
            seq=0,
            token=0,
            case="",
            attempt=0,
            folder="",
            model="",
            weather="",
            time_of_day_min=0,
            seed=0,
        )
    )


@lru_cache(maxsize=16)
def _standing(bare: bytes) -> list[Logged]:
    """Rows that are static and the same in all cases that begin alike; 2 ms to make."""
    start = decode(bare, CaseStart)
    stage = start.stage
    return [
        (naming.WORLD, rr.ViewCoordinates.FLU),
        (naming.WORLD, contexts()),
        *([] if start.scene_sha256 else outline(stage)),
        *eyes(start),
        *mounted(start.rows),
        (
            naming.EGO_BODY,
            rr.Boxes3D(
                centers=[stage.ego_center_m],
                sizes=[stage.ego_size_m],
                colors=[BLUE],
                fill_mode="solid",
            ),
        ),
        (naming.TRAIL, rr.Points3D.from_fields(colors=[BLUE], radii=0.12)),
        (naming.GAP, rr.LineStrips3D.from_fields(radii=0.06, show_labels=True)),
        (naming.DETECTIONS, _box_style(1.5, labelled=True, draw_order=30.0)),
        (naming.DETECTIONS_FAR, _box_style(1.5, labelled=False, draw_order=30.0)),
        (naming.TRIGGER, _box_style(4.0, labelled=False, draw_order=40.0, color=YELLOW)),
        # Without colours of their own: those of their classes.
        (naming.TRUTH, _box_style(0.75, labelled=False, draw_order=20.0)),
        (naming.MOVERS, rr.Boxes3D.from_fields(colors=[ORANGE], fill_mode="solid")),
        (naming.SPEED, _line("speed [m/s]", BLUE)),
        (naming.ACCEL, _line("acceleration [m/s²]", GREY)),
        (naming.DTC, _line("distance to collision [m]", GREEN)),
        (naming.TTC, _line("time to collision [s]", CYAN)),
        (naming.THROTTLE, _line("throttle", BLUE)),
        (naming.BRAKE, _line("brake", ORANGE)),
        (naming.AEB, _line("AEB", RED, width=5.0)),
        (naming.PLANNER, _planner_styles()),
    ]


def _plotted(path: str, samples: Sequence[StateSample], values: list[float]) -> EntityRows:
    return rows_at(path, samples, rr.Scalars.columns(scalars=np.array(values, np.float64)))


def _commanded(asked: list[tuple[StateSample, Controls]]) -> list[EntityRows]:
    samples = [sample for sample, _ in asked]
    return [
        _plotted(naming.THROTTLE, samples, [c.throttle for _, c in asked]),
        _plotted(naming.BRAKE, samples, [c.brake for _, c in asked]),
        _plotted(naming.AEB, samples, [float(c.aeb) for _, c in asked]),
    ]


def _marks(
    boxes: Sequence[Sequence[Detection | ImageBox]], labels: list[str]
) -> list[rr.ComponentColumn]:
    """Boxes of several rows; one label per box."""
    flat = [mark for row in boxes for mark in row]
    corners = np.array([[m.x_px, m.y_px] for m in flat], np.float32).reshape(-1, 2)
    halves = np.array([[m.width_px, m.height_px] for m in flat], np.float32).reshape(-1, 2) / 2
    columns = rr.Boxes2D.columns(
        half_sizes=halves,
        centers=corners + halves,
        labels=labels,
        class_ids=np.array([class_id(mark.label) for mark in flat], np.uint16),
    )
    return list(columns.partition([len(row) for row in boxes]))


def _truth(samples: Sequence[StateSample]) -> EntityRows:
    boxes = [sample.boxes or [] for sample in samples]
    labels = [f"{box.label} {box.distance_m:.0f} m" for row in boxes for box in row]
    return rows_at(naming.TRUTH, samples, _marks(boxes, labels))


def _moving(samples: Sequence[StateSample]) -> EntityRows:
    rows = [(sample.movers, sample.mover_tilts) for sample in samples]
    return rows_at(naming.MOVERS, samples, movers(rows) if rows else [])


def _event(sim_time_ns: int, tick: int, text: str, level: str, color: Color) -> EntityRows:
    columns = rr.TextLog.columns(text=[text], level=[level], color=[color])
    return EntityRows(naming.EVENTS, [sim_time_ns], [tick], list(columns))


def _box_style(
    radius_points: float, *, labelled: bool, draw_order: float, color: Color | None = None
) -> rr.Boxes2D:
    return rr.Boxes2D.from_fields(
        radii=rr.Radius.ui_points(radius_points),
        show_labels=labelled,
        draw_order=draw_order,
        colors=None if color is None else [color],
    )


def _planner_styles() -> rr.StateConfiguration:
    return rr.StateConfiguration(values=["driving", "AEB", "collision"], colors=[BLUE, ORANGE, RED])


def _line(name: str, color: Color, width: float = 2.0) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=[color], widths=width)


def _document(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type="text/markdown")
