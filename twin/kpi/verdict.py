"""When a case ends, its scalars, and its verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.campaign import Scenario
from schemas.files.kpi import SCALARS
from twin.kpi.course import Course
from twin.kpi.lane_progress import LaneProgress
from twin.kpi.recorder import CaseRows
from twin.vehicle.columns import COLUMN, PHYSICS_STEP_NS
from twin.world.things import Thing

Scalars = dict[str, float | int | None]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a finished case comes to."""

    verdict: str
    """``pass``, ``collision``, ``false_braking`` or ``time_up``; of lane keeping also
    ``lane_departure``. Only ``pass`` counts as passed (:mod:`schemas.verdict`)."""
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


def scalars(
    recorder: CaseRows, state: np.ndarray, lane: LaneProgress | None, hit: Thing | None = None
) -> Scalars:
    """Scalars of :data:`schemas.files.kpi.SCALARS` from the rows; None where missing."""
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
    for name, column in (("nearest_min_m", "nearest_m"), ("nearest_ttc_min_s", "nearest_ttc_s")):
        least = _least(recorder, column)
        values[name] = None if least is None else float(recorder.column(column)[least])
    if state[COLUMN["collisions"]] > 0:
        # Between two rows, at the impact, it was 0: what moves may be away again by now.
        values["nearest_min_m"] = 0.0
        values["hit_hull"] = hit.hull if hit else None
    return values


def names(recorder: CaseRows, state: np.ndarray, hit: Thing | None) -> dict[str, str]:
    """Scalars of :data:`schemas.files.kpi.NAMES`; a missing one is left out."""
    found = {}
    for name, column in (
        ("nearest_object", "nearest_m"),
        ("nearest_ttc_object", "nearest_ttc_s"),
    ):
        least = _least(recorder, column)
        if least is not None:
            found[name] = recorder.name(name, least)
    if hit is not None and state[COLUMN["collisions"]] > 0:
        found |= {"hit_object": hit.name, "hit_class": hit.kind, "nearest_object": hit.name}
    return found


def _least(recorder: CaseRows, column: str) -> int | None:
    """The first row in which a column is least; None: it has no value."""
    valid = np.flatnonzero(recorder.valid(column))
    if not len(valid):
        return None
    return int(valid[np.argmin(recorder.column(column)[valid])])


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float((values * values).sum()) / len(values))


def judge(
    scenario: Scenario,
    recorder: CaseRows,
    state: np.ndarray,
    lane: LaneProgress | None,
    course: Course,
    hit: Thing | None,
) -> Verdict:
    """The verdict of an ended case; ``lane`` is given in lane keeping, ``hit`` is what the ego hit
    first, if anything."""
    if state[COLUMN["collisions"]] > 0:
        speed = state[COLUMN["impact_speed_mps"]]
        at = state[COLUMN["impact_step"]] * PHYSICS_STEP_NS / 1e9
        what = f" with {hit.words}" if hit else ""
        return Verdict("collision", [f"collision at {speed:.2f} m/s after {at:.3f} s{what}"])
    if lane is not None:
        return _judge_lane_keeping(scenario, recorder, lane)
    if course.target is None:
        return _judge_free_lane(recorder, state)
    return _judge_jump_scare(scenario, recorder, state, course)


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
        return Verdict("lane_departure", [reason])
    rms_m = _rms(recorder.column("lateral_error_m"))
    kept = f"lateral error {rms_m:.3f} m RMS"
    if rms_m > scenario.lateral_rms_limit_m:
        reason = f"{kept} {driven}; allowed: {scenario.lateral_rms_limit_m:g} m"
        return Verdict("lane_departure", [reason])
    if lane.distance_m >= scenario.distance_m:
        return Verdict("pass", [f"drove {lane.distance_m:.1f} m, {kept}"])
    speed_mps = recorder.column("speed_mps")[-1]
    if speed_mps == 0.0 and (recorder.column("speed_mps") > 0.0).any():
        return Verdict("false_braking", [f"came to rest {driven}"])
    return Verdict("time_up", [f"time is up at {speed_mps:.2f} m/s, {driven}"])


def _judge_jump_scare(
    scenario: Scenario, recorder: CaseRows, state: np.ndarray, course: Course
) -> Verdict:
    """Does the ego stop for the obstacle? The verdict without a collision.

    ``pass``: it came to rest within ``false_braking_m`` of the obstacle, or went round it.
    ``false_braking``: any rest (standing still after having moved, at a control tick) further away
    and before it went round, even if it drove on later; or it never moved, further away.
    ``time_up``: neither: it still moves before the obstacle when time is up, or never moved though
    it stood near from the start. Nobody knows what it would have done.
    """
    dtc, speed = recorder.column("dtc_m"), recorder.column("speed_mps")
    limit = scenario.false_braking_m
    began = _began_to_move(recorder, state)
    if began is None:
        reasons = [f"the ego never moved, {dtc[-1]:.2f} m from the obstacle"]
        return Verdict("false_braking" if dtc[-1] > limit else "time_up", reasons)
    past = course.past_from(recorder)
    far = began + np.flatnonzero((speed[began:past] == 0.0) & (dtc[began:past] > limit))
    if len(far):
        reason = (
            f"came to rest {dtc[far[0]]:.2f} m from the obstacle; further than {limit:g} m is "
            "false braking"
        )
        return Verdict("false_braking", [reason])
    if past is not None:
        at_s = recorder.column("sim_time_ns")[past] / 1e9
        return Verdict("pass", [f"went round the obstacle without touching it, by {at_s:.3f} s"])
    if speed[-1] == 0.0:
        return Verdict("pass", [f"came to rest {dtc[-1]:.2f} m from the obstacle"])
    reason = (
        f"time is up at {speed[-1]:.2f} m/s, {dtc[-1]:.2f} m from the obstacle: the ego has "
        "neither stopped for it nor gone round it"
    )
    return Verdict("time_up", [reason])


def _judge_free_lane(recorder: CaseRows, state: np.ndarray) -> Verdict:
    """The verdict without a collision where no obstacle stands: nothing is a reason to stop."""
    speed = recorder.column("speed_mps")
    began = _began_to_move(recorder, state)
    if began is None:
        return Verdict("false_braking", ["the ego never moved; nothing stood in its way"])
    rests = began + np.flatnonzero(speed[began:] == 0.0)
    if len(rests):
        at_s = recorder.column("sim_time_ns")[rests[0]] / 1e9
        return Verdict("false_braking", [f"at rest after {at_s:.3f} s; nothing stood in its way"])
    reason = f"drove until time was up, at {speed[-1]:.2f} m/s; nothing stood in its way"
    return Verdict("pass", [reason])


def _began_to_move(recorder: CaseRows, state: np.ndarray) -> int | None:
    """The first row at which the ego moves, forward or back; the last one if it moved only between
    two rows; None: never."""
    moving = np.flatnonzero(recorder.column("speed_mps") != 0.0)
    if len(moving):
        return int(moving[0])
    return recorder.rows - 1 if state[COLUMN["moved"]] != 0 else None
