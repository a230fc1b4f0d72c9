"""Made-up drives for the fusion stack: a flat road, boxes on it, and what each sensor sees of them.

Pure functions of the time: a drive is the same in any slot and beside any neighbour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from camera_sites import camera_site

from devkit.reference.view import CameraView
from devkit.stack import Observation
from schemas.messages import BOXES_MAX, Episode, LidarSite
from schemas.sections.lidar import POINT_COLUMNS
from schemas.sections.perception import GroundTruthPerception

WIDTH, HEIGHT = 160, 90
CHANNELS, COLUMNS = 32, 1024
PERIOD_NS = 50_000_000
TICK_M = 2.0 * math.pi * 0.36 / 44.0
ROOF = LidarSite(
    name="roof",
    message="lidar.roof",
    hz=10,
    channels=CHANNELS,
    columns=COLUMNS,
    fields=list(POINT_COLUMNS),
    position_m=[1.3, 0.0, 1.93],
    rotation_deg=[0.0, 0.0, 0.0],
)


@dataclass(frozen=True)
class Thing:
    """A box on the road: near end, middle and size at the drive's start [m], its speed [m/s]."""

    x_m: float
    y_m: float
    width_m: float = 1.8
    height_m: float = 1.5
    vx_mps: float = 0.0
    vy_mps: float = 0.0
    class_id: int = 0
    from_s: float = 0.0
    until_s: float = 1e9
    by: str = "camera lidar"
    """Sensors that see it."""

    def at(self, time_s: float, ego_m: float) -> tuple[float, float] | None:
        """Near end and middle in the car's axes; None: it is not there."""
        if not self.from_s <= time_s < self.until_s:
            return None
        return self.x_m + self.vx_mps * time_s - ego_m, self.y_m + self.vy_mps * time_s


@dataclass(frozen=True)
class MadeUpCase:
    """A case: a car of constant speed, things around it, the weather."""

    token: int
    things: Sequence[Thing] = ()
    speed_mps: float = 8.0
    fog_per_m: float = 0.0
    lidar: bool = True
    lidar_dead_s: float = 1e9
    """From then on no ray comes back."""
    radar: bool = False

    def episode(self, slot: int) -> Episode:
        """Its episode message."""
        return Episode(
            v=1,
            seq=0,
            slot=slot,
            token=self.token,
            case=f"case-{self.token}",
            seed=1,
            model="default",
            perception=GroundTruthPerception(),
            camera="front_right",
            width=WIDTH,
            height=HEIGHT,
            hfov_deg=70.0,
            control_period_ns=PERIOD_NS,
            cameras=[camera_site(WIDTH, HEIGHT)],
            lidars=[ROOF] if self.lidar else [],
            ticks_per_rev=44.0,
        )

    def box_rows(self, time_s: float) -> list[list[float]]:
        """Rows of the box sensor, with the pinhole of the camera."""
        view = CameraView.of_site(camera_site(WIDTH, HEIGHT))
        rows = []
        for thing in self.things:
            place = thing.at(time_s, self.speed_mps * time_s)
            if place is None or "camera" not in thing.by or place[0] < view.forward_m + 1.0:
                continue
            ahead_m = place[0] - view.forward_m
            scale = view.lens.fx_px / ahead_m
            left = view.lens.cx_px - (place[1] + 0.5 * thing.width_m - view.lateral_m) * scale
            right = left + thing.width_m * scale
            foot = view.lens.cy_px + view.above_m * scale
            left, right = max(left, 0.0), min(right, WIDTH)
            top, foot = max(foot - thing.height_m * scale, 0.0), min(foot, HEIGHT)
            if right - left >= 1.0 and foot - top >= 1.0:
                size = right - left, foot - top
                rows.append([thing.class_id, left, top, *size, size[0] * size[1], ahead_m])
        return rows

    def picture(self, rows: list[list[float]]) -> np.ndarray:
        """A grey street with dark things."""
        image = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
        for _, x, y, width, height, _, _ in rows:
            image[int(y) : int(y + height) + 1, int(x) : int(x + width) + 1] = (60, 50, 50)
        return image

    def sweep(self, time_s: float) -> np.ndarray:
        """Points of the LiDAR, float32 [N, 7]: rays end on the road or on near sides."""
        points = np.full((CHANNELS * COLUMNS, len(POINT_COLUMNS)), np.nan, np.float32)
        points[:, 4:] = 0.0
        if time_s >= self.lidar_dead_s:
            return points
        down = np.radians(np.linspace(-10.64, 30.59, CHANNELS))[:, None]
        turn = np.radians(np.arange(COLUMNS) * 360.0 / COLUMNS)[None]
        dx, dy = np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn)
        dz = -np.sin(down) + 0.0 * turn
        sx, _, sz = ROOF.position_m
        reach = np.where(dz < 0.0, sz / np.maximum(-dz, 1e-9), np.inf)
        for thing in self.things:
            place = thing.at(time_s, self.speed_mps * time_s)
            if place is None or "lidar" not in thing.by:
                continue
            way = np.where(dx > 0.01, (place[0] - sx) / np.maximum(dx, 0.01), 1e9)
            across = np.abs(way * dy - place[1]) < 0.5 * thing.width_m
            height = sz + way * dz
            hit = (way > 0.0) & across & (height > 0.0) & (height < thing.height_m)
            reach = np.where(hit, np.minimum(reach, way), reach)
        reach = np.where(reach < 100.0, reach, np.nan)
        for column, direction in enumerate((dx, dy, dz)):
            points[:, column] = (reach * direction).reshape(-1)
        points[:, 3] = reach.reshape(-1)
        return points

    def echoes(self, time_s: float) -> list[list[float]]:
        """Radar detections of the things that it sees."""
        rows = []
        for thing in self.things:
            place = thing.at(time_s, self.speed_mps * time_s)
            if place is None or "radar" not in thing.by or place[0] < 4.6:
                continue
            x, y = place[0] - 4.1, place[1]
            range_m = math.hypot(x, y)
            speed = ((thing.vx_mps - self.speed_mps) * x + thing.vy_mps * y) / range_m
            rows.append([range_m, math.atan2(y, x), 0.0, speed, 10.0, 30.0])
        return rows


def observe(cases: Sequence[MadeUpCase | None], tick: int) -> Observation:
    """What S slots see at a tick; LiDAR and camera at every second one."""
    slots, time_s = len(cases), tick * PERIOD_NS * 1e-9
    vehicle, environment = np.zeros((slots, 7)), np.zeros((slots, 2))
    encoders, imu = np.zeros((slots, 4), np.int64), np.zeros((slots, 6))
    pictures = np.zeros((slots, HEIGHT, WIDTH, 3), np.uint8)
    boxes, count = np.zeros((slots, BOXES_MAX, 7), np.float32), np.zeros(slots, np.int32)
    points = np.zeros((slots, CHANNELS * COLUMNS, len(POINT_COLUMNS)), np.float32)
    radar, echoes = np.zeros((slots, 128, 6), np.float32), np.zeros(slots, np.int32)
    token = np.zeros(slots, np.int64)
    due = tick % 2 == 0
    for slot, case in enumerate(cases):
        if case is None:
            continue
        token[slot] = case.token
        vehicle[slot, 0] = case.speed_mps
        environment[slot] = 5e4, case.fog_per_m
        encoders[slot] = math.floor(case.speed_mps * time_s / TICK_M)
        imu[slot, 2] = 9.80665
        rows = case.box_rows(time_s)
        count[slot] = len(rows)
        boxes[slot, : len(rows)] = np.reshape(rows, (-1, 7))
        detections = case.echoes(time_s)
        echoes[slot] = len(detections)
        radar[slot, : len(detections)] = np.reshape(detections, (-1, 6))
        if due:
            pictures[slot] = case.picture(rows)
            if case.lidar:
                points[slot] = case.sweep(time_s)
    sensors = {"vehicle": vehicle, "environment": environment, "encoders": encoders, "imu": imu}
    counts = {}
    if due:
        sensors |= {"camera": pictures, "boxes": boxes}
        counts["boxes"] = count
        if any(case is not None and case.lidar for case in cases):
            sensors["lidar.roof"] = points
    if any(case is not None and case.radar for case in cases):
        sensors["radar"], counts["radar"] = radar, echoes
    return Observation(
        seq=tick,
        active=np.array([case is not None for case in cases]),
        token=token,
        tick=np.full(slots, tick, np.int32),
        sim_time_ns=np.full(slots, tick * PERIOD_NS, np.int64),
        sensors=sensors,
        counts=counts,
    )
