"""Drives for ``devkit check``: sensors of a car that nears an obstacle, functions of the tick.

No simulator: what a stack makes of them does not matter, only that it makes the same every time. So
they are coarse, but every array has the shape, the type and the rate that the campaign asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import structs

from schemas.case import Case
from schemas.kinds.sensor import MadeUpDrive, SensorKind, sensor_kinds
from schemas.messages import (
    BOX_COLUMNS,
    BOXES_MAX,
    ENVIRONMENT_COLUMNS,
    VEHICLE_COLUMNS,
    CameraSite,
    Episode,
    LidarSite,
)
from schemas.sections.lens import Lens
from schemas.sections.lidar import POINT_COLUMNS

CHANNELS, COLUMNS = 8, 64
"""Format of every lidar here: small, whatever the campaign's profile says."""

OBSTACLE = (60, 50, 50)
"""Colour of the obstacle, RGB."""


@dataclass(frozen=True, slots=True)
class CheckDrive:
    """One case's way to an obstacle."""

    case: str
    seed: int
    gap_m: float
    """Gap to the obstacle at tick 0 [m]."""
    speed_mps: float

    def distance_m(self, tick: int, period_s: float) -> float:
        """Distance to the obstacle; the car brakes evenly over the last metres."""
        return max(1.0, self.gap_m - self.speed_mps * tick * period_s)


def episode_of(case: Case, drive: CheckDrive, slot: int, token: int, seq: int) -> Episode:
    """The message that begins ``drive`` in ``slot``."""
    sites = [
        CameraSite(
            name=camera.name,
            message="camera" if index == 0 else f"camera.{camera.name}",
            width=camera.width,
            height=camera.height,
            hz=camera.hz,
            hfov_deg=camera.hfov_deg,
            position_m=[2.05, 0.0, 1.32],
            rotation_deg=[0.0, 0.0, 0.0],
            lens=Lens(),
        )
        for index, camera in enumerate(case.rig.seeing)
    ]
    lidars = [
        LidarSite(
            name=lidar.name,
            message=f"lidar.{lidar.name}",
            hz=lidar.hz or case.rig.control_hz,
            channels=CHANNELS,
            columns=COLUMNS,
            fields=list(POINT_COLUMNS),
            position_m=[1.3, 0.0, 1.93],
            rotation_deg=[0.0, 0.0, 0.0],
        )
        for lidar in case.rig.lidars
    ]
    return Episode.of(
        # Made up, so nothing has to be kept from the stack.
        structs.replace(
            case,
            variation=structs.replace(
                case.variation, id=drive.case, seed=drive.seed, tell=["case", "seed"]
            ),
        ),
        seq=seq,
        slot=slot,
        token=token,
        cameras=sites,
        lidars=lidars,
    )


def sense(case: Case, drives: list[CheckDrive | None], tick: int) -> dict[str, tuple[Any, Any]]:
    """Sensor messages that are due: array [S, ...], and count per slot (None: not ragged)."""
    messages: dict[str, tuple[Any, Any]] = {}
    rows = [_Row(case, drive, tick) if drive else None for drive in drives]
    messages["vehicle"] = _stack(rows, "vehicle", len(VEHICLE_COLUMNS)), None
    messages["environment"] = _stack(rows, "environment", len(ENVIRONMENT_COLUMNS)), None
    for name, hz in case.rig.sensor_hz.items():
        if tick % (case.rig.control_hz // hz) == 0:
            kind = sensor_kinds().find(name)
            messages[name] = _declared(kind, rows)
    for index, camera in enumerate(case.rig.seeing):
        if tick % (case.rig.control_hz // camera.hz):
            continue
        dot = "" if index == 0 else f".{camera.name}"
        images = np.zeros((len(drives), camera.height, camera.width, 3), np.uint8)
        boxes = np.zeros((len(drives), BOXES_MAX, len(BOX_COLUMNS)), np.float32)
        for slot, row in enumerate(rows):
            if row is not None:
                boxes[slot, 0] = row.box(camera.width, camera.height)
                images[slot] = row.image(boxes[slot, 0], camera.width, camera.height)
        messages[f"camera{dot}"] = images, None
        messages[f"boxes{dot}"] = boxes, [int(row is not None) for row in rows]
    for lidar in case.rig.lidars:
        if tick % (case.rig.control_hz // (lidar.hz or case.rig.control_hz)) == 0:
            points = np.full((len(drives), CHANNELS * COLUMNS, len(POINT_COLUMNS)), np.nan)
            for slot, row in enumerate(rows):
                points[slot] = 0.0 if row is None else row.points()
            count = [0 if row is None else CHANNELS * COLUMNS for row in rows]
            messages[f"lidar.{lidar.name}"] = points.astype(np.float32), count
    return messages


class _Row:
    """One slot at one tick."""

    def __init__(self, case: Case, drive: CheckDrive, tick: int) -> None:
        self._drive, self._tick = drive, tick
        time_s = tick / case.rig.control_hz
        speed = drive.speed_mps
        self.gap_m = drive.distance_m(tick, 1.0 / case.rig.control_hz)
        moment = MadeUpDrive(drive.seed, tick, time_s, speed)
        self.values: dict[str, Any] = {
            "vehicle": [speed, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0],
            "environment": [50_000.0, 0.0005],
            **{kind.name: kind.made_up(moment) for kind in sensor_kinds().declared},
        }

    def box(self, width: int, height: int) -> list[float]:
        """The obstacle as the box sensor sees it: a car of 1.8 by 1.5 m."""
        w_px, h_px = (
            min(size, 0.7 * width * m / self.gap_m) for size, m in ((width, 1.8), (height, 1.5))
        )
        return [
            *(0.0, 0.5 * (width - w_px), 0.5 * height - 0.4 * h_px),
            *(w_px, h_px, w_px * h_px, self.gap_m),
        ]

    def image(self, box: np.ndarray, width: int, height: int) -> np.ndarray:
        """A grey street with noise, and the obstacle on it."""
        noise = np.random.default_rng([self._drive.seed, self._tick])
        picture = np.full((height, width, 3), 120, np.uint8)
        x, y, w, h = (max(0, int(v)) for v in box[1:5])
        picture[y : y + max(1, h), x : x + max(1, w)] = OBSTACLE
        return picture + noise.integers(0, 6, picture.shape, np.uint8)

    def points(self) -> np.ndarray:
        """A wall at the obstacle's distance."""
        rows = np.zeros((CHANNELS * COLUMNS, len(POINT_COLUMNS)))
        rows[:, 0] = rows[:, 3] = self.gap_m
        rows[:, 1] = np.tile(np.linspace(-5, 5, COLUMNS), CHANNELS)
        rows[:, 2] = np.repeat(np.linspace(1, -1, CHANNELS), COLUMNS)
        rows[:, 4], rows[:, 6] = 30.0, 1.0
        return rows


def _declared(kind: SensorKind, rows: list[_Row | None]) -> tuple[Any, Any]:
    """Values of a sensor as it declares them, and valid rows per slot where they differ."""
    if not kind.looks:
        return _stack(rows, kind.name, len(kind.columns)).astype(kind.dtype), None
    values = np.zeros((len(rows), *kind.shape), kind.dtype)
    if kind.grid:
        for slot, row in enumerate(rows):
            for *place, value in [] if row is None else row.values[kind.name]:
                values[(slot, *place)] = value
        return values, None
    count = [0 if row is None else len(row.values[kind.name]) for row in rows]
    for slot, row in enumerate(rows):
        if row is not None:
            values[slot, : count[slot]] = row.values[kind.name]
    return values, count


def _stack(rows: list[_Row | None], name: str, width: int) -> np.ndarray:
    return np.array([row.values[name] if row else [0.0] * width for row in rows], np.float64)
