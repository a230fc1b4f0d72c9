"""Messages of the view plane -> what Rerun logs: lists of (entity path, archetype). No I/O."""

from __future__ import annotations

import math

import rerun as rr

from schemas.messages import Detection
from schemas.view import Box, CaseEnd, CaseStart, StateSample
from viewer import naming
from viewer.scenery import (
    BLUE,
    CYAN,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    Color,
    Logged,
    eyes,
    movers,
    outline,
    verdict_color,
)
from viewer.summary import ended_text, running_text

LABEL_SHARE = 0.05
"""A box narrower than this share of the picture has no room for a label [-]."""


class CaseConverter:
    """Converts the messages of one attempt, in order; remembers only what makes an event."""

    def __init__(self, start: CaseStart) -> None:
        self._start = start
        self._aeb = False
        self._seen = False
        self._planner = ""
        self.hand = ""
        """What somebody has done to the case, as of the latest state."""

    def start(self) -> list[Logged]:
        """Static scene, intrinsics and styles; logged without a time.

        A world that comes as a mesh is not drawn here.
        """
        start, stage = self._start, self._start.stage
        return [
            (naming.WORLD, rr.ViewCoordinates.FLU),
            *([] if start.scene_sha256 else outline(stage)),
            *eyes(start),
            (
                naming.EGO_BODY,
                rr.Boxes3D(
                    centers=[stage.ego_center_m],
                    sizes=[stage.ego_size_m],
                    colors=[BLUE],
                    fill_mode="solid",
                ),
            ),
            (naming.SPEED, _line("speed [m/s]", BLUE)),
            (naming.ACCEL, _line("acceleration [m/s²]", GREY)),
            (naming.DTC, _line("distance to collision [m]", GREEN)),
            (naming.TTC, _line("time to collision [s]", CYAN)),
            (naming.THROTTLE, _line("throttle", BLUE)),
            (naming.BRAKE, _line("brake", ORANGE)),
            (naming.AEB, _line("AEB", RED, width=5.0)),
            (naming.PLANNER, _planner_styles()),
            (naming.SUMMARY, _document(running_text(start))),
        ]

    def state(self, sample: StateSample) -> list[Logged]:
        """One KPI row: pose, plots and what camera and stack saw."""
        controls = sample.controls
        braking = controls is not None and controls.aeb
        logged: list[Logged] = [
            (naming.EGO, _pose(sample)),
            (
                naming.TRAIL,
                rr.Points3D([[sample.x_m, sample.y_m, 0.08]], colors=[BLUE], radii=0.12),
            ),
            (naming.GAP, self._gap(sample, braking)),
            (naming.SPEED, rr.Scalars(sample.speed_mps)),
            (naming.ACCEL, rr.Scalars(sample.accel_mps2)),
            (naming.DTC, rr.Scalars(sample.dtc_m)),
        ]
        if sample.ttc_s is not None:
            logged.append((naming.TTC, rr.Scalars(sample.ttc_s)))
        if controls is not None:
            logged += [
                (naming.THROTTLE, rr.Scalars(controls.throttle)),
                (naming.BRAKE, rr.Scalars(controls.brake)),
                (naming.AEB, rr.Scalars(float(controls.aeb))),
            ]
            # Between frames nothing is looked at; the boxes of the last one stay.
            if sample.boxes is not None or controls.detections:
                logged += self._detections(controls.detections, braking)
            logged += self._events(sample, controls.detections, braking)
        if sample.boxes is not None:
            logged.append((naming.TRUTH, _truth(sample.boxes)))
        if sample.movers:
            logged.append((naming.MOVERS, movers(sample.movers)))
        return logged + self._hand(sample) + self._planner_state(sample, braking)

    def camera(self, jpeg: bytes, name: str = "camera") -> list[Logged]:
        """A picture of the camera whose messages are called ``name``, passed through untouched."""
        return [(naming.sensor(name), rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))]

    def end(self, end: CaseEnd) -> list[Logged]:
        """The verdict as an event."""
        if not end.outcome:
            text = "attempt given up: the case was taken back"
            return [(naming.EVENTS, rr.TextLog(text, level="WARN", color=GREY))]
        text = ": ".join([end.verdict or end.outcome, *end.reasons])
        level = "INFO" if end.passed else "ERROR"
        return [(naming.EVENTS, rr.TextLog(text, level=level, color=verdict_color(end.verdict)))]

    def summary(self, end: CaseEnd | None, lost: int) -> list[Logged]:
        """What the case came to, static."""
        return [(naming.SUMMARY, _document(ended_text(self._start, end, lost)))]

    def touched(self) -> list[Logged]:
        """What stands above the case after a hand has done something to it, static."""
        return [(naming.SUMMARY, _document(running_text(self._start, self.hand)))]

    def _events(
        self, sample: StateSample, detections: list[Detection], braking: bool
    ) -> list[Logged]:
        logged: list[Logged] = []
        if detections and not self._seen:
            self._seen = True
            first = detections[0]
            text = f"first detection: {first.label} {first.confidence:.2f} at {sample.dtc_m:.1f} m"
            logged.append((naming.EVENTS, rr.TextLog(text, level="INFO", color=ORANGE)))
        if braking and not self._aeb:
            text = f"AEB triggered at {sample.dtc_m:.1f} m, {sample.speed_mps:.1f} m/s"
            logged.append((naming.EVENTS, rr.TextLog(text, level="WARN", color=RED)))
        self._aeb = braking
        return logged

    def _hand(self, sample: StateSample) -> list[Logged]:
        """An event where somebody begins or ceases to do something to the case."""
        if sample.hand == self.hand:
            return []
        self.hand = sample.hand
        text = f"by hand: {sample.hand or 'nothing'}"
        return [(naming.EVENTS, rr.TextLog(text, level="WARN", color=VIOLET))]

    def _planner_state(self, sample: StateSample, braking: bool) -> list[Logged]:
        """A coloured bar, logged where it changes."""
        state = "collision" if sample.collisions else "AEB" if braking else "driving"
        if state == self._planner:
            return []
        self._planner = state
        return [(naming.PLANNER, rr.StateChange(state=[state]))]

    def _detections(self, detections: list[Detection], braking: bool) -> list[Logged]:
        """Near and far ones apart: labels of far ones would hide each other."""
        width_px = LABEL_SHARE * self._start.width
        near = [d for d in detections if d.width_px >= width_px]
        far = [d for d in detections if d.width_px < width_px]
        return [
            (naming.DETECTIONS, _boxes(near, braking, labelled=True)),
            (naming.DETECTIONS_FAR, _boxes(far, braking, labelled=False)),
        ]

    def _gap(self, sample: StateSample, braking: bool) -> rr.LineStrips3D:
        """From the ego's nose to the obstacle's rear, labelled with the distance."""
        stage = self._start.stage
        nose = stage.ego_center_m[0] + stage.ego_size_m[0] / 2
        x_m = sample.x_m + nose * math.cos(sample.yaw_rad)
        y_m = sample.y_m + nose * math.sin(sample.yaw_rad)
        center = stage.obstacle_center_m
        half, yaw = stage.obstacle_size_m[0] / 2, stage.obstacle_yaw_rad
        rear = [center[0] - half * math.cos(yaw), center[1] - half * math.sin(yaw), 0.3]
        return rr.LineStrips3D(
            [[[x_m, y_m, 0.3], rear]],
            colors=[RED if braking else GREEN],
            radii=0.06,
            labels=[f"{sample.dtc_m:.1f} m"],
            show_labels=True,
        )


def _pose(sample: StateSample) -> rr.Transform3D:
    axis = rr.RotationAxisAngle([0, 0, 1], rr.Angle(rad=sample.yaw_rad))
    return rr.Transform3D(translation=[sample.x_m, sample.y_m, 0.0], rotation_axis_angle=axis)


def _boxes(detections: list[Detection], braking: bool, *, labelled: bool) -> rr.Boxes2D:
    return rr.Boxes2D(
        array=[[d.x_px, d.y_px, d.width_px, d.height_px] for d in detections],
        array_format=rr.Box2DFormat.XYWH,
        colors=[RED if braking else ORANGE],
        labels=[f"{d.label} {d.confidence:.2f}" for d in detections],
        radii=rr.Radius.ui_points(1.5),
        show_labels=labelled,
        draw_order=30.0,
    )


def _truth(boxes: list[Box]) -> rr.Boxes2D:
    return rr.Boxes2D(
        array=[[b.x_px, b.y_px, b.width_px, b.height_px] for b in boxes],
        array_format=rr.Box2DFormat.XYWH,
        colors=[CYAN],
        labels=[f"{b.label} {b.distance_m:.0f} m" for b in boxes],
        radii=rr.Radius.ui_points(0.75),
        show_labels=False,
        draw_order=20.0,
    )


def _planner_styles() -> rr.StateConfiguration:
    return rr.StateConfiguration(values=["driving", "AEB", "collision"], colors=[BLUE, ORANGE, RED])


def _line(name: str, color: Color, width: float = 2.0) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=[color], widths=width)


def _document(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type="text/markdown")
