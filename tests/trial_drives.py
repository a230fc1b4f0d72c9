"""Drives of a trial as rows by hand: an ego on a straight line, and a target with constant velocity
or constant braking."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from twin.road.lane import straight
from twin.scenario.protocol import FirstContact
from twin.scenario.surroundings import Surroundings
from twin.world.things import Thing

PERIOD_S = 0.02
HALF_LENGTH_M, HALF_WIDTH_M = 2.5, 1.0
"""Half of the ego's box, whose middle is 1.5 m ahead of its reference point."""
CENTRE_M = 1.5
TARGET = (2.0, 0.9)
"""Half length and width of the target."""


class HandRows:
    """Rows whose columns are arrays; what is not given is missing in all of them."""

    def __init__(self, rows: int, **columns: np.ndarray) -> None:
        self.rows = rows
        self._columns = columns

    def changed(self, **columns: np.ndarray) -> HandRows:
        """The same with other columns."""
        return HandRows(self.rows, **{**self._columns, **columns})

    def as_files_have_them(self) -> HandRows:
        """The same as a reader of KPI files sees them: what is missing is NaN, not 0."""
        return _FileRows(self.rows, **self._columns)

    def column(self, name: str) -> np.ndarray:
        values = self._columns.get(name, np.zeros(self.rows))
        return np.where(np.isnan(values), 0.0, values)

    def valid(self, name: str) -> np.ndarray:
        return ~np.isnan(self._columns.get(name, np.full(self.rows, np.nan)))

    def name(self, column: str, row: int) -> str:
        return ""


class _FileRows(HandRows):
    def column(self, name: str) -> np.ndarray:
        return self._columns.get(name, np.full(self.rows, np.nan))


@dataclass(frozen=True)
class HandDrive:
    """What is driven. The ego's front is at 0 when it begins; speeds in m/s, the target's place is
    that of its middle."""

    speed: float = 20.0
    brakes_s: float | None = None
    """When the stack brakes; None: never."""
    deceleration: float = 8.0
    target: tuple[float, float] = (100.0, 0.0)
    velocity: tuple[float, float] = (0.0, 0.0)
    target_braking: float = 0.0
    heading: float = 0.0
    """Of everything, about the ego's start [rad]."""
    seconds: float = 12.0
    running: bool = False
    """Whether the storyboard still runs at the end."""
    robot: bool = True
    more: dict[str, float] = field(default_factory=dict)
    """Columns with one value."""
    hits: str = "target"
    warns_s: float | None = None

    def changed(self, **changes: object) -> HandDrive:
        return replace(self, **changes)

    def ego_m(self, time_s: float) -> tuple[float, float]:
        """Way and speed of the ego."""
        return _way(self.speed, self.brakes_s, self.deceleration, time_s)

    def target_at(self, time_s: float) -> tuple[float, float, float]:
        """Place of the target's middle, and its speed ahead."""
        way, ahead = _way(self.velocity[0], 0.0, self.target_braking, time_s)
        return self.target[0] + way, self.target[1] + self.velocity[1] * time_s, ahead

    def meets(self) -> FirstContact | None:
        """The first moment at which both boxes touch, to 1 ms."""
        for time_s in np.arange(0.0, self.seconds, 0.001).tolist():
            way, speed = self.ego_m(time_s)
            x, y, _ = self.target_at(time_s)
            middle = way - HALF_LENGTH_M
            if abs(x - middle) <= HALF_LENGTH_M + TARGET[0] and abs(y) <= HALF_WIDTH_M + TARGET[1]:
                return FirstContact(time_s, speed, Thing(self.hits, "car"))
        return None

    def rows(self) -> tuple[HandRows, FirstContact | None]:
        """Rows of all ticks until the contact or the end, and the contact."""
        contact = self.meets()
        last_s = self.seconds if contact is None else contact.time_s + PERIOD_S
        times = np.arange(0, math.ceil(last_s / PERIOD_S) + 1) * PERIOD_S
        ego = np.array([self.ego_m(time_s) for time_s in times.tolist()])
        target = np.array([self.target_at(time_s) for time_s in times.tolist()])
        if contact is not None:
            ego[times > contact.time_s, 1] = 0.0
        rows = len(times)
        c, s = math.cos(self.heading), math.sin(self.heading)
        ahead = ego[:, 0] - HALF_LENGTH_M - CENTRE_M
        acted = times >= (self.brakes_s if self.brakes_s is not None else np.inf) - 1e-9
        running = np.ones(rows)
        if contact is None and not self.running:
            running[-1] = 0.0
        vx, vy = target[:, 2], np.full(rows, self.velocity[1])
        columns = {
            "sim_time_ns": np.rint(times * 1e9),
            "x_m": ahead * c,
            "y_m": ahead * s,
            "yaw_rad": np.full(rows, self.heading),
            "speed_mps": ego[:, 1],
            "accel_mps2": np.where(acted & (ego[:, 1] > 0), -self.deceleration, 0.0),
            "storyboard_running": running,
            "target_x_m": target[:, 0] * c - target[:, 1] * s,
            "target_y_m": target[:, 0] * s + target[:, 1] * c,
            "target_yaw_rad": np.full(rows, self.heading),
            "target_vx_mps": vx * c - vy * s,
            "target_vy_mps": vx * s + vy * c,
            "light_lx": np.full(rows, 50_000.0),
            "road_friction": np.full(rows, 0.9),
            "aeb": acted.astype(float),
            "brake": np.where(acted, 0.8, 0.0),
        }
        if self.robot:
            columns["robot_drives"] = np.where(acted, 0.0, 1.0)
            columns["intervention_kind"] = np.where(acted, 1.0, np.nan)
        if self.warns_s is not None:
            columns["warning"] = (times >= self.warns_s - 1e-9).astype(float)
        columns |= {name: np.full(rows, value) for name, value in self.more.items()}
        return HandRows(rows, **columns), contact


def _way(
    speed: float, from_s: float | None, deceleration: float, time_s: float
) -> tuple[float, float]:
    """Way and speed after a time, with constant braking from a moment on until it stands."""
    braked_s = max(0.0, time_s - from_s) if from_s is not None else 0.0
    if deceleration:
        braked_s = min(braked_s, speed / deceleration)
    elif from_s is not None:
        braked_s = 0.0
    free_s = time_s if from_s is None or not deceleration else min(time_s, from_s)
    way = speed * free_s + speed * braked_s - deceleration * braked_s**2 / 2
    return way, speed - deceleration * braked_s


def hand_ground(drive: HandDrive) -> Surroundings:
    """Ego and target of a drive."""
    hull = np.array([*drive.target, drive.heading, *TARGET])
    return Surroundings(
        straight(0.0, 100.0), hull, CENTRE_M, HALF_LENGTH_M, HALF_WIDTH_M, target_name="target"
    )
