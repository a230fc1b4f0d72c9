"""``lane_keeping``: start where the lane begins, and judge whether the ego stays in its middle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from schemas.kinds.scenarios.lane_keeping import KIND, LaneKeepingConfig
from twin.road.lane import LanePath
from twin.scenario.lane_keeping.progress import LaneProgress
from twin.scenario.protocol import Rows, Scalars, Verdict
from twin.scenario.surroundings import Surroundings


class LaneKeeping:
    """One case of lane keeping."""

    def __init__(
        self, config: LaneKeepingConfig, ground: Surroundings, x_m: float, y_m: float
    ) -> None:
        self._config = config
        self.progress = LaneProgress(ground.lane, x_m, y_m)

    @classmethod
    def start(cls, config: LaneKeepingConfig, ground: Surroundings) -> tuple[float, float, float]:
        """Start pose where the lane begins; the lane must be long enough and free."""
        _check_lane(config, ground)
        pose = ground.lane.at(0.0)
        return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)

    def observe(self, x_m: np.ndarray, y_m: np.ndarray) -> None:
        """Add up the way along the lane."""
        self.progress.move(x_m, y_m)

    @classmethod
    def observe_together(
        cls, runs: Sequence[LaneKeeping], x_m: np.ndarray, y_m: np.ndarray
    ) -> None:
        """See :class:`twin.scenario.protocol.ObservesTogether`."""
        LaneProgress.move_together([run.progress for run in runs], x_m, y_m)

    def columns(self) -> Mapping[str, float]:
        """Distance from the lane's centre."""
        return {"lateral_error_m": self.progress.lateral_m}

    def ended(self) -> bool:
        """The ego has come far enough, or is out of its lane."""
        lane, config = self.progress, self._config
        arrived = lane.distance_m >= config.distance_m
        return arrived or abs(lane.lateral_m) > config.lateral_limit_m

    def scalars(self, rows: Rows) -> Scalars:
        """The way along the lane, and how far beside its centre."""
        error = rows.column("lateral_error_m")
        return {
            "distance_m": self.progress.distance_m,
            "lateral_error_rms_m": _rms(error),
            "lateral_error_max_m": float(np.abs(error).max()),
        }

    def judge(self, rows: Rows, _moved: bool) -> Verdict:
        """Out of the lane, or out of its middle for long, is ``lane_departure``. Nothing stands in
        the lane, so a rest before the end is false braking."""
        config, lane = self._config, self.progress
        driven = f"after {lane.distance_m:.1f} m of {config.distance_m:g} m"
        if abs(lane.lateral_m) > config.lateral_limit_m:
            side = "left" if lane.lateral_m > 0.0 else "right"
            reason = (
                f"{abs(lane.lateral_m):.2f} m {side} of the lane's centre {driven}; "
                f"allowed: {config.lateral_limit_m:g} m"
            )
            return Verdict("lane_departure", [reason])
        rms_m = _rms(rows.column("lateral_error_m"))
        kept = f"lateral error {rms_m:.3f} m RMS"
        if rms_m > config.lateral_rms_limit_m:
            reason = f"{kept} {driven}; allowed: {config.lateral_rms_limit_m:g} m"
            return Verdict("lane_departure", [reason])
        if lane.distance_m >= config.distance_m:
            return Verdict("pass", [f"drove {lane.distance_m:.1f} m, {kept}"])
        speed_mps = rows.column("speed_mps")[-1]
        if speed_mps == 0.0 and (rows.column("speed_mps") > 0.0).any():
            return Verdict("false_braking", [f"came to rest {driven}"])
        return Verdict("time_up", [f"time is up at {speed_mps:.2f} m/s, {driven}"])


def lane_mistake(config: LaneKeepingConfig, scene: str, lane: LanePath | None) -> str:
    """Why a lane, None: the scene has none, does not do; empty: it does."""
    if lane is None:
        return f"scene {scene}: {KIND.name} needs a lane: a generated street or OpenDRIVE roads"
    if lane.closed or lane.length_m >= config.distance_m:
        return ""
    return (
        f"scene {scene}: {KIND.name} over {config.distance_m:g} m, but its lane is "
        f"{lane.length_m:.5g} m long; set scenario.distance_m, or take a closed road such as "
        "downtown-loop"
    )


def _check_lane(config: LaneKeepingConfig, ground: Surroundings) -> None:
    lane, name = ground.lane, f"scene {ground.scene}: {KIND.name}"
    if mistake := lane_mistake(config, ground.scene, lane if ground.street else None):
        raise ValueError(mistake)
    if ground.target is None:
        return
    x_m, y_m, _, half_length_m, half_width_m = ground.target
    place = lane.locate(x_m, y_m)
    gap_m = abs(float(place.lateral_m)) - half_width_m - ground.half_width_m
    free_m = float(place.s_m) - half_length_m - ground.front_offset_m
    if gap_m <= 0.0 and (lane.closed or free_m < config.distance_m):
        raise ValueError(f"{name}: the broken-down car stands in the lane; set obstacle.y_m")


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float((values * values).sum()) / len(values))
