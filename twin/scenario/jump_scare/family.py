"""``jump_scare``: start before the broken-down car, and judge whether the ego stops for it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schemas.kinds.scenarios.jump_scare import JumpScareConfig
from twin.scenario.jump_scare.passing import past_from
from twin.scenario.protocol import Rows, Scalars, Verdict
from twin.scenario.surroundings import Surroundings


class JumpScare:
    """One case of a jump scare; a scene without a target is a free lane."""

    def __init__(
        self, config: JumpScareConfig, ground: Surroundings, _x_m: float, _y_m: float
    ) -> None:
        self._limit_m = config.false_braking_m
        self._ground = ground

    @classmethod
    def start(cls, config: JumpScareConfig, ground: Surroundings) -> tuple[float, float, float]:
        """Start pose on the lane, ``ego_start_m`` before the target, from bumper to bumper."""
        return ground.before_target(config.ego_start_m + ground.front_offset_m)

    def observe(self, _x_m: np.ndarray, _y_m: np.ndarray) -> None:
        """Observe nothing: all that counts stands in the rows."""

    def columns(self) -> Mapping[str, float]:
        """None of its own."""
        return {}

    def ended(self) -> bool:
        """Never before collision, rest or time."""
        return False

    def scalars(self, _rows: Rows) -> Scalars:
        """None of its own."""
        return {}

    def judge(self, rows: Rows, moved: bool) -> Verdict:
        """Whether the ego stops for the target; without one nothing is a reason to stop."""
        began = _began_to_move(rows, moved=moved)
        if self._ground.target is None:
            return _judge_free_lane(rows, began)
        return self._judge(rows, began)

    def _judge(self, rows: Rows, began: int | None) -> Verdict:
        """The verdict where a target stands.

        ``pass``: it came to rest within ``false_braking_m`` of the obstacle, or went round it.
        ``false_braking``: any rest (standing still after having moved, at a control tick) further
        away and before it went round, even if it drove on later; or it never moved, further away.
        ``time_up``: neither: it still moves before the obstacle when time is up, or never moved
        though it stood near from the start. Nobody knows what it would have done.
        """
        dtc, speed = rows.column("dtc_m"), rows.column("speed_mps")
        limit = self._limit_m
        if began is None:
            reasons = [f"the ego never moved, {dtc[-1]:.2f} m from the obstacle"]
            return Verdict("false_braking" if dtc[-1] > limit else "time_up", reasons)
        past = past_from(self._ground, rows)
        far: np.ndarray = began + np.flatnonzero(
            (speed[began:past] == 0.0) & (dtc[began:past] > limit)
        )
        if len(far):
            reason = (
                f"came to rest {dtc[far[0]]:.2f} m from the obstacle; further than {limit:g} m is "
                "false braking"
            )
            return Verdict("false_braking", [reason])
        if past is not None:
            at_s = rows.column("sim_time_ns")[past] / 1e9
            reason = f"went round the obstacle without touching it, by {at_s:.3f} s"
            return Verdict("pass", [reason])
        if speed[-1] == 0.0:
            return Verdict("pass", [f"came to rest {dtc[-1]:.2f} m from the obstacle"])
        reason = (
            f"time is up at {speed[-1]:.2f} m/s, {dtc[-1]:.2f} m from the obstacle: the ego has "
            "neither stopped for it nor gone round it"
        )
        return Verdict("time_up", [reason])


def _judge_free_lane(rows: Rows, began: int | None) -> Verdict:
    """The verdict without a collision where no obstacle stands: nothing is a reason to stop."""
    speed = rows.column("speed_mps")
    if began is None:
        return Verdict("false_braking", ["the ego never moved; nothing stood in its way"])
    rests: np.ndarray = began + np.flatnonzero(speed[began:] == 0.0)
    if len(rests):
        at_s = rows.column("sim_time_ns")[rests[0]] / 1e9
        return Verdict("false_braking", [f"at rest after {at_s:.3f} s; nothing stood in its way"])
    reason = f"drove until time was up, at {speed[-1]:.2f} m/s; nothing stood in its way"
    return Verdict("pass", [reason])


def _began_to_move(rows: Rows, *, moved: bool) -> int | None:
    """The first row at which the ego moves, forward or back; the last one if it moved only between
    two rows; None: never."""
    moving = np.flatnonzero(rows.column("speed_mps") != 0.0)
    if len(moving):
        return int(moving[0])
    return rows.rows - 1 if moved else None
