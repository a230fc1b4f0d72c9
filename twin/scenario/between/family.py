"""``between``: start before the first of two things, and judge where the ego comes to rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schemas.kinds.scenarios.between import KIND, BetweenConfig
from twin.road.lane import LanePath
from twin.scenario.protocol import Rows, Scalars, Verdict
from twin.scenario.surroundings import Surroundings


class Between:
    """One case of stopping between two things."""

    def __init__(
        self, _config: BetweenConfig, ground: Surroundings, x_m: float, y_m: float
    ) -> None:
        self._lane = ground.lane
        nose_m = ground.centre_offset_m + ground.half_length_m
        first, last = _hulls(ground)
        self._first_m = _station_m(ground.lane, first) - nose_m
        self._last_m = _station_m(ground.lane, last) - nose_m
        self._station_m = float(ground.lane.locate(x_m, y_m).s_m)

    @classmethod
    def start(cls, config: BetweenConfig, ground: Surroundings) -> tuple[float, float, float]:
        """So far before the first thing; both must stand in the scene, in this order."""
        first, last = _hulls(ground)
        if _station_m(ground.lane, first) >= _station_m(ground.lane, last):
            raise ValueError(f"scene {ground.scene}: {KIND.name}: the second thing stands first")
        pose = ground.lane.at(_station_m(ground.lane, first) - config.approach_m)
        return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)

    def observe(self, x_m: np.ndarray, y_m: np.ndarray) -> None:
        """Where along the lane it is."""
        if len(x_m):
            self._station_m = float(self._lane.locate(x_m[-1], y_m[-1]).s_m)

    def columns(self) -> Mapping[str, float]:
        """None of its own."""
        return {}

    def ended(self) -> bool:
        """It is past the second thing."""
        return self._station_m > self._last_m

    def scalars(self, _rows: Rows) -> Scalars:
        """None of its own."""
        return {}

    def judge(self, rows: Rows, _moved: bool) -> Verdict:
        """At rest between both passes."""
        speed_mps, left_m = rows.column("speed_mps")[-1], self._last_m - self._station_m
        if left_m < 0.0:
            return Verdict("too_far", [f"{-left_m:.2f} m past the second"])
        if speed_mps > 0.0:
            return Verdict("time_up", [f"time is up at {speed_mps:.2f} m/s"])
        if self._station_m < self._first_m:
            return Verdict("too_near", [f"{self._first_m - self._station_m:.2f} m short"])
        return Verdict("pass", [f"stopped {left_m:.2f} m before the second"])


def _hulls(ground: Surroundings) -> tuple[np.ndarray, np.ndarray]:
    first, (last,) = ground.target, ground.further
    if first is None or last is None:
        names = (KIND.target, *KIND.further_targets)
        lacking = " and ".join(n for n, h in zip(names, (first, last), strict=True) if h is None)
        raise ValueError(f"scene {ground.scene}: {KIND.name} needs {lacking}, not in this scene")
    return first, last


def _station_m(lane: LanePath, hull: np.ndarray) -> float:
    return float(lane.locate(float(hull[0]), float(hull[1])).s_m)
