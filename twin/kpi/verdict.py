"""When a case ends, its scalars, and its verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.campaign import Scenario
from schemas.kpi import SCALARS
from twin.kpi.lane_progress import LaneProgress
from twin.kpi.recorder import CaseRows
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.state import COLUMN

Scalars = dict[str, float | int | None]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a finished case comes to."""

    verdict: str
    """``pass``, ``collision`` or ``false_braking``; of lane keeping also ``lane_departure`` and
    ``time_up``."""
    passed: bool
    """Jump scare: no collision, false braking is told apart by ``verdict``. Lane keeping: the whole
    distance, within the limits."""
    reasons: list[str]
    """Short sentences."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When the cases of all slots end at the latest; 0 where none runs."""

    duration_ns: np.ndarray
    """int64 [S]"""
    standstill_ns: np.ndarray
    """int64 [S]"""

    @classmethod
    def of(cls, slots: int) -> Limits:
        """For so many slots."""
        return cls(np.zeros(slots, np.int64), np.zeros(slots, np.int64))

    def begin(self, slot: int, scenario: Scenario) -> None:
        """A case begins in a slot."""
        self.duration_ns[slot] = round(scenario.duration_s * 1e9)
        self.standstill_ns[slot] = round(scenario.standstill_s * 1e9)


def have_ended(limits: Limits, sim_time_ns: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Which cases end at this control tick, bool [S]: collision, long enough at rest, or time up.

    Args:
        limits: of the slots.
        sim_time_ns: int64 [S].
        state: [S, T].
    """
    rest_step = state[:, COLUMN["rest_step"]]
    at_rest = rest_step >= 0.0  # -1: it moves, or has not moved yet
    rest_ns = np.where(at_rest, rest_step, 0.0).astype(np.int64) * PHYSICS_STEP_NS
    rested = at_rest & (sim_time_ns - rest_ns >= limits.standstill_ns)
    crashed = state[:, COLUMN["collisions"]] > 0
    ended: np.ndarray = crashed | rested | (sim_time_ns >= limits.duration_ns)
    return ended


def has_left(scenario: Scenario, lane: LaneProgress) -> bool:
    """Whether a case of lane keeping ends: the ego has come far enough, or is out of its lane."""
    return lane.distance_m >= scenario.distance_m or abs(lane.lateral_m) > scenario.lateral_limit_m


def scalars(recorder: CaseRows, state: np.ndarray, lane: LaneProgress | None) -> Scalars:
    """Scalars of :data:`schemas.kpi.SCALARS` from the rows; None where missing."""
    values: Scalars = {column.name: None for column in SCALARS}
    dtc = recorder.column("dtc_m")
    measured = bool(recorder.valid("dtc_m").all())
    values["sim_time_s"] = float(recorder.column("sim_time_ns")[-1] / 1e9)
    values["ticks"] = int(recorder.column("tick")[-1])
    if measured:
        values["dtc_min_m"] = float(dtc.min())
        values["dtc_end_m"] = float(dtc[-1])
    triggered = np.flatnonzero(recorder.column("aeb") & recorder.valid("aeb"))
    if len(triggered):
        first = int(triggered[0])
        values["aeb_time_s"] = float(recorder.column("sim_time_ns")[first] / 1e9)
        if measured:
            values["aeb_dtc_m"] = float(dtc[first])
        if recorder.valid("ttc_s")[first]:
            values["aeb_ttc_s"] = float(recorder.column("ttc_s")[first])
    if state[COLUMN["collisions"]] > 0:
        values["impact_speed_mps"] = float(state[COLUMN["impact_speed_mps"]])
    values["decel_peak_mps2"] = float(max(0.0, -recorder.column("accel_mps2").min()))
    # The last row of a collision shows the ego stopped; its impact may be the fastest moment.
    fastest = max(recorder.column("speed_mps").max(), state[COLUMN["impact_speed_mps"]])
    values["speed_max_mps"] = float(fastest)
    values["collisions"] = int(state[COLUMN["collisions"]])
    if lane is not None:
        error = recorder.column("lateral_error_m")
        values["distance_m"] = lane.distance_m
        values["lateral_error_rms_m"] = _rms(error)
        values["lateral_error_max_m"] = float(np.abs(error).max())
    return values


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float((values * values).sum()) / len(values))


def judge(
    scenario: Scenario, recorder: CaseRows, state: np.ndarray, lane: LaneProgress | None
) -> Verdict:
    """The verdict of an ended case; ``lane`` is given in lane keeping."""
    if state[COLUMN["collisions"]] > 0:
        speed = state[COLUMN["impact_speed_mps"]]
        at = state[COLUMN["impact_step"]] * PHYSICS_STEP_NS / 1e9
        return Verdict("collision", False, [f"collision at {speed:.2f} m/s after {at:.3f} s"])
    if lane is not None:
        return _judge_lane_keeping(scenario, recorder, lane)
    return _judge_jump_scare(scenario, recorder, state)


def _judge_lane_keeping(scenario: Scenario, recorder: CaseRows, lane: LaneProgress) -> Verdict:
    """Out of the lane, or out of its middle for long, is ``lane_departure``. Nothing stands in the
    lane, so a rest before the end is false braking."""
    driven = f"after {lane.distance_m:.1f} m of {scenario.distance_m:g} m"
    if abs(lane.lateral_m) > scenario.lateral_limit_m:
        side = "left" if lane.lateral_m > 0.0 else "right"
        reason = (
            f"{abs(lane.lateral_m):.2f} m {side} of the lane's centre {driven}; "
            f"allowed: {scenario.lateral_limit_m:g} m"
        )
        return Verdict("lane_departure", False, [reason])
    rms_m = _rms(recorder.column("lateral_error_m"))
    kept = f"lateral error {rms_m:.3f} m RMS"
    if rms_m > scenario.lateral_rms_limit_m:
        reason = f"{kept} {driven}; allowed: {scenario.lateral_rms_limit_m:g} m"
        return Verdict("lane_departure", False, [reason])
    if lane.distance_m >= scenario.distance_m:
        return Verdict("pass", True, [f"drove {lane.distance_m:.1f} m, {kept}"])
    speed_mps = recorder.column("speed_mps")[-1]
    if speed_mps == 0.0 and (recorder.column("speed_mps") > 0.0).any():
        return Verdict("false_braking", False, [f"came to rest {driven}"])
    return Verdict("time_up", False, [f"time is up at {speed_mps:.2f} m/s, {driven}"])


def _judge_jump_scare(scenario: Scenario, recorder: CaseRows, state: np.ndarray) -> Verdict:
    """The verdict without a collision.

    Any rest (standing still after having moved, at a control tick) further than
    ``false_braking_m`` from the obstacle is false braking, even if the ego drove on later; so is
    never having moved when time is up. Everything else passes, with a reason that says whether the
    ego stopped or time ran out.
    """
    dtc = recorder.column("dtc_m")
    speed = recorder.column("speed_mps")
    limit = scenario.false_braking_m
    moving = np.flatnonzero(speed > 0.0)
    if not len(moving) and state[COLUMN["moved"]] == 0:
        reasons = [f"the ego never moved, {dtc[-1]:.2f} m from the obstacle"]
        return Verdict("false_braking" if dtc[-1] > limit else "pass", True, reasons)
    first = int(moving[0]) if len(moving) else 0
    far = first + np.flatnonzero((speed[first:] == 0.0) & (dtc[first:] > limit))
    if len(far):
        reasons = [
            f"came to rest {dtc[far[0]]:.2f} m from the obstacle; further than {limit:g} m is "
            "false braking"
        ]
        return Verdict("false_braking", True, reasons)
    if speed[-1] == 0.0:
        return Verdict("pass", True, [f"came to rest {dtc[-1]:.2f} m from the obstacle"])
    reason = (
        f"time is up at {speed[-1]:.2f} m/s, {dtc[-1]:.2f} m from the obstacle, without a collision"
    )
    return Verdict("pass", True, [reason])
