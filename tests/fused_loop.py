"""The fusion stack in a closed loop: a point mass that it brakes, boxes around it, noisy sensors.

A second of it takes some milliseconds, so tests can try many situations. Pictures are left out:
what a camera would show becomes detections at once. Everything of a case follows from its number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from camera_sites import camera_site
from fused_drives import CHANNELS, COLUMNS, PERIOD_NS, ROOF, TICK_M, MadeUpCase

from devkit.fusion import FusionStack
from devkit.reference.view import CameraView
from devkit.stack import Observation
from schemas.messages import Command, Detection
from schemas.sections.lidar import POINT_COLUMNS

PERIOD_S = PERIOD_NS * 1e-9
FRONT_M, REAR_M, HALF_WIDTH_M = 4.1, -1.07, 1.01
BRAKE_MPS2, BRAKE_LAG_S, STEP_S = 8.8, 0.12, 0.005
DIVE_RAD_PER_MPS2 = 0.0053
"""How far the nose dives per deceleration: 0.043 rad in a full braking of opencav."""
SIDE_MIN_PX, VISIBLE_MIN_PX, RADAR_RANGE_M = 20.0, 6.0, 150.0
VIEW = CameraView.of_site(camera_site())
DOWN = np.radians(np.linspace(-10.64, 30.59, CHANNELS))[:, None]
TURN = np.radians((np.arange(COLUMNS) + 0.5) * 360.0 / COLUMNS)[None]
RAYS = np.cos(DOWN) * np.cos(TURN), np.cos(DOWN) * np.sin(TURN), -np.sin(DOWN) + 0.0 * TURN


@dataclass(frozen=True, kw_only=True)
class Mover:
    """A box that stands, then moves: its near end, middle and size [m], speed [m/s]."""

    x_m: float
    y_m: float = 0.0
    vx_mps: float = 0.0
    vy_mps: float = 0.0
    length_m: float = 4.0
    width_m: float = 1.8
    height_m: float = 1.5
    label: str = "car"
    rcs_dbsm: float = 10.0
    from_s: float = 0.0
    until_s: float = 1e9
    brakes_s: float = 1e9
    """When it begins to brake by 4 m/s^2, along x."""
    wheels: bool = True
    """Whether some of its echoes are of wheels."""

    def at(self, time_s: float) -> tuple[float, float, float, float]:
        """Place and speed."""
        moved_s = min(max(time_s - self.from_s, 0.0), self.until_s - self.from_s)
        moves = self.from_s <= time_s < self.until_s
        since_s = max(time_s - self.brakes_s, 0.0)
        braked_s = min(since_s, max(self.vx_mps, 0.0) / 4.0)
        lost_m = 2.0 * braked_s * braked_s + 4.0 * braked_s * (since_s - braked_s)
        vx = (self.vx_mps - 4.0 * braked_s) * moves
        return (
            self.x_m + self.vx_mps * moved_s - lost_m,
            self.y_m + self.vy_mps * moved_s,
            vx,
            self.vy_mps * moves,
        )


@dataclass(frozen=True)
class Situation:
    """The ego's speed, who is around, and for how long."""

    speed_mps: float
    movers: Sequence[Mover]
    duration_s: float = 9.0


@dataclass
class Driven:
    """What came of a situation."""

    speed_mps: float
    way_m: float = 0.0
    accel_mps2: float = 0.0
    braking: bool = False
    released_s: float | None = None
    """When the stack let go of the brake first."""
    warned_s: float | None = None
    braked_s: float | None = None
    impact_mps: float | None = None
    """Speed of the ego at a contact."""
    ended: bool = False

    def obey(self, command: Command, time_s: float) -> None:
        """Drive on for a period."""
        if command.warning and self.warned_s is None:
            self.warned_s = time_s
        if command.brake > 0.05:
            self.braked_s = time_s if self.braked_s is None else self.braked_s
            self.braking = True
        elif self.braked_s is not None and self.released_s is None:
            self.released_s = time_s
        wanted = -BRAKE_MPS2 * command.brake if self.braking else 0.0
        for _ in range(round(PERIOD_S / STEP_S)):
            self.accel_mps2 += (wanted - self.accel_mps2) * STEP_S / BRAKE_LAG_S
            self.speed_mps = max(0.0, self.speed_mps + self.accel_mps2 * STEP_S)
            self.way_m += self.speed_mps * STEP_S

    def touches(self, movers: Sequence[Mover], time_s: float) -> bool:
        """Whether the ego's box meets another one."""
        for mover in movers:
            x, y, _, _ = mover.at(time_s)
            along = x - self.way_m < FRONT_M and x + mover.length_m - self.way_m > REAR_M
            if along and abs(y) < HALF_WIDTH_M + 0.5 * mover.width_m:
                return True
        return False


def boxes(
    situation: Situation, way_m: float, time_s: float, rng: np.random.Generator
) -> list[Detection]:
    """What a network would make of the picture."""
    found = []
    for mover in situation.movers:
        x, y, _, _ = mover.at(time_s)
        ahead_m = x - way_m - VIEW.forward_m
        if ahead_m < 1.0:
            continue
        scales = VIEW.lens.fx_px / ahead_m, VIEW.lens.fx_px / (ahead_m + mover.length_m)
        ends = [y + 0.5 * mover.width_m - VIEW.lateral_m, y - 0.5 * mover.width_m - VIEW.lateral_m]
        left = min(VIEW.lens.cx_px - ends[0] * scale for scale in scales)
        right = max(VIEW.lens.cx_px - ends[1] * scale for scale in scales)
        foot = VIEW.lens.cy_px + VIEW.above_m * scales[0]
        top = foot - mover.height_m * scales[0]
        noise = rng.normal(0.0, 0.5 + 0.02 * np.array([right - left, right - left, foot - top] * 2))
        left, right = max(left + noise[0], 0.0), min(right + noise[1], VIEW.width_px)
        top, foot = max(top + noise[2], 0.0), min(foot + noise[5], VIEW.height_px)
        missed = rng.random() < 0.1
        if missed or min(right - left, foot - top) < VISIBLE_MIN_PX:
            continue
        if max(right - left, foot - top) >= SIDE_MIN_PX:
            found.append(Detection(mover.label, 0.9, left, top, right - left, foot - top))
    return found


def sweep(
    situation: Situation, way_m: float, time_s: float, rng: np.random.Generator
) -> np.ndarray:
    """Points of the LiDAR: rays end on the road or on boxes."""
    dx, dy, dz = RAYS
    sx, _, sz = ROOF.position_m
    reach = np.where(dz < 0.0, sz / np.maximum(-dz, 1e-9), 1e9)
    for mover in situation.movers:
        x, y, _, _ = mover.at(time_s)
        x -= way_m
        if not -5.0 < x < 75.0:
            continue
        along = (x - sx) / dx, (x + mover.length_m - sx) / dx
        across = (y - 0.5 * mover.width_m) / dy, (y + 0.5 * mover.width_m) / dy
        near = np.maximum(np.minimum(*along), np.minimum(*across))
        far = np.minimum(np.maximum(*along), np.maximum(*across))
        height = sz + near * dz
        hit = (near > 0.0) & (near < far) & (height > 0.0) & (height < mover.height_m)
        reach = np.where(hit, np.minimum(reach, near), reach)
    reach = np.where(reach < 100.0, reach + rng.normal(0.0, 0.03, reach.shape), np.nan)
    points = np.zeros((CHANNELS * COLUMNS, len(POINT_COLUMNS)), np.float32)
    for column, direction in enumerate(RAYS):
        points[:, column] = (reach * direction).reshape(-1)
    points[:, 3] = reach.reshape(-1)
    return points


def echoes(
    situation: Situation, car: Driven, time_s: float, rng: np.random.Generator
) -> list[list[float]]:
    """Detections of the radar; some are of wheels, a tenth is missed. The axes are those of a car
    that pitches."""
    rows, up_rad = [], -DIVE_RAD_PER_MPS2 * car.accel_mps2
    for mover in situation.movers:
        x, y, vx, vy = mover.at(time_s)
        x -= car.way_m + FRONT_M
        range_m = math.hypot(x, y)
        if x < 0.5 or range_m > RADAR_RANGE_M or abs(y) > x or rng.random() < 0.12:
            continue
        azimuth = math.atan2(y, x) + rng.normal(0.0, 0.008)
        radial = ((vx - car.speed_mps) * x + vy * y) / range_m
        for n in range(2 if mover.rcs_dbsm > 0.0 else 1):
            noise = rng.normal(0.0, 1.0, 3) * (0.1, 0.1, 4.0)
            near_m, speed = range_m + noise[0] + 0.4 * n, radial + noise[1]
            rows.append([near_m, azimuth, up_rad, speed, mover.rcs_dbsm + noise[2], 20.0])
        if mover.wheels and abs(vx) > 3.0 and rng.random() < 0.4:
            speed = radial + rng.uniform(-1.0, 1.0) * abs(vx)
            rcs = mover.rcs_dbsm - 5.0 + rng.normal(0.0, 4.0)
            rows.append([range_m + 0.5, azimuth, up_rad, speed, rcs, 20.0])
    return rows


def drive_all(situations: Sequence[Situation], **parameters: Any) -> list[Driven]:
    """Drive all situations together, a slot each."""
    slots = len(situations)
    stack = FusionStack(slots, steering="straight", cruise_speed_mps=40.0, **parameters)
    for slot in range(slots):
        episode = MadeUpCase(slot + 1).episode(slot)
        site = camera_site()
        changed = {"cameras": [site], "width": site.width, "height": site.height}
        stack.reset(slot, msgspec.structs.replace(episode, **changed))
    cars = [Driven(situation.speed_mps) for situation in situations]
    randoms = [np.random.default_rng(slot) for slot in range(slots)]
    seen: dict[int, list[Detection]] = {}
    stack._eyes.look = lambda _slots, _observation: seen  # type: ignore[method-assign]
    for tick in range(round(max(s.duration_s for s in situations) / PERIOD_S)):
        observation = _observe(situations, cars, randoms, tick, seen)
        for command in stack.step(observation):
            car, situation = cars[command.slot], situations[command.slot]
            car.obey(command, tick * PERIOD_S)
            after_s = (tick + 1) * PERIOD_S
            if car.touches(situation.movers, after_s):
                car.impact_mps = car.speed_mps
            stands = car.speed_mps < 0.05
            car.ended = car.impact_mps is not None or stands or after_s > situation.duration_s
        if all(car.ended for car in cars):
            break
    return cars


def _observe(
    situations: Sequence[Situation],
    cars: Sequence[Driven],
    randoms: Sequence[np.random.Generator],
    tick: int,
    seen: dict[int, list[Detection]],
) -> Observation:
    slots, time_s, due = len(cars), tick * PERIOD_S, tick % 2 == 0
    vehicle, environment = np.zeros((slots, 7)), np.zeros((slots, 2))
    encoders, imu = np.zeros((slots, 4), np.int64), np.zeros((slots, 6))
    points = np.full((slots, CHANNELS * COLUMNS, len(POINT_COLUMNS)), np.nan, np.float32)
    radar, count = np.zeros((slots, 128, 6), np.float32), np.zeros(slots, np.int32)
    environment[:, 0] = 5e4
    seen.clear()
    for slot, (situation, car, rng) in enumerate(zip(situations, cars, randoms, strict=True)):
        if car.ended:
            continue
        vehicle[slot, 0] = car.speed_mps
        encoders[slot] = math.floor(car.way_m / TICK_M)
        imu[slot, 0] = car.accel_mps2
        rows = echoes(situation, car, time_s, rng)
        count[slot] = len(rows)
        radar[slot, : len(rows)] = np.reshape(rows, (-1, 6))
        if due:
            seen[slot] = boxes(situation, car.way_m, time_s, rng)
            points[slot] = sweep(situation, car.way_m, time_s, rng)
    sensors = {"vehicle": vehicle, "environment": environment, "encoders": encoders, "imu": imu}
    sensors["radar"] = radar
    if due:
        sensors["lidar.roof"] = points
    active = np.array([not car.ended for car in cars])
    return Observation(
        seq=tick,
        active=active,
        token=np.where(active, np.arange(slots) + 1, 0),
        tick=np.full(slots, tick, np.int32),
        sim_time_ns=np.full(slots, tick * PERIOD_NS, np.int64),
        sensors=sensors,
        counts={"radar": count},
    )
