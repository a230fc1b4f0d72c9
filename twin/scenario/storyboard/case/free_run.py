"""Cases of free driving: how far the robot drove, and whether a full braking had a cause."""

from __future__ import annotations

import math

import numpy as np

from schemas.sections.free_driving import FreeDriving
from twin.scenario.driver import BRAKED
from twin.scenario.protocol import FirstContact, Rows, Scalars, Verdict

FREE_SCALARS = (
    *("driven_m", "driven_fast_m", "partial_brakings", "full_braking_s", "full_braking_ttc_s"),
    "false_brakings",
)
"""Scalars of free driving."""
FAST_MPS = 50.0 / 3.6
"""Speed above which distance counts as fast, 50 km/h [m/s]."""


class FreeRun:
    """One case of free driving, from its rows alone."""

    def __init__(self, free: FreeDriving) -> None:
        """``free`` says which full brakings are false."""
        self._free = free

    def scalars(self, rows: Rows) -> Scalars:
        """Values of :data:`FREE_SCALARS`."""
        values: Scalars = dict.fromkeys(FREE_SCALARS)
        full = full_braking(rows)
        last = rows.rows - 1 if full is None else full
        values["driven_m"] = _driven_m(rows, last, 0.0)
        values["driven_fast_m"] = _driven_m(rows, last, FAST_MPS)
        braking = (rows.valid("aeb") & (rows.column("aeb") != 0))[: last + 1]
        begins = braking & ~np.concatenate([[False], braking[:-1]])
        values["partial_brakings"] = int(begins.sum()) - int(full is not None and begins[full])
        values["false_brakings"] = 0
        if full is not None:
            ttc_s = self._least_ttc_s(rows, full)
            values["full_braking_s"] = float(rows.column("sim_time_ns")[full] / 1e9)
            values["full_braking_ttc_s"] = ttc_s if math.isfinite(ttc_s) else None
            values["false_brakings"] = int(self._is_false(ttc_s))
        return values

    def verdict(self, rows: Rows, contact: FirstContact | None) -> Verdict:
        """``false_reaction`` if the first full braking had no cause, ``collision``, ``pass``, or
        ``time_up`` if the storyboard still runs."""
        full = full_braking(rows)
        reasons = []
        if full is not None:
            time_s = float(rows.column("sim_time_ns")[full] / 1e9)
            speed_mps = float(rows.column("speed_mps")[full])
            ttc_s = self._least_ttc_s(rows, full)
            near = f"{ttc_s:.2f} s" if math.isfinite(ttc_s) else "none"
            reasons.append(
                f"the stack braked fully after {time_s:.2f} s, at {speed_mps:.2f} m/s; least time "
                f"to a collision then: {near}, near is below {self._free.near_ttc_s:g} s"
            )
            if self._is_false(ttc_s):
                return Verdict("false_reaction", reasons)
        if contact is not None:
            what = f" with {contact.thing.words}" if contact.thing is not None else ""
            how = f"collision at {contact.speed_mps:.2f} m/s after {contact.time_s:.3f} s{what}"
            return Verdict("collision", [how, *reasons])
        if full is None:
            driven_m = _driven_m(rows, rows.rows - 1, 0.0)
            reasons.append(f"{driven_m:.0f} m without a full braking")
            if rows.column("storyboard_running")[-1] != 0.0:
                return Verdict("time_up", [*reasons, "and the storyboard still runs"])
        return Verdict("pass", reasons)

    def _least_ttc_s(self, rows: Rows, full: int) -> float:
        """Least time to a collision until a row, shortly before; infinite: there was none. After
        it nobody steers, and what a car that leaves its lane comes near to is its own doing."""
        time_s = rows.column("sim_time_ns") / 1e9
        at_s = float(time_s[full])
        seen = (time_s >= at_s - self._free.before_s) & (time_s <= at_s) & rows.valid("way_ttc_s")
        return float(rows.column("way_ttc_s")[seen].min()) if seen.any() else math.inf

    def _is_false(self, ttc_s: float) -> bool:
        return ttc_s >= self._free.near_ttc_s


def full_braking(rows: Rows) -> int | None:
    """Row of the first full braking, with which the robot let go; None: there was none."""
    kind = rows.valid("intervention_kind") & (rows.column("intervention_kind") == BRAKED)
    taken = np.flatnonzero(kind)
    return int(taken[0]) if len(taken) else None


def _driven_m(rows: Rows, last: int, above_mps: float) -> float:
    """Way up to a row, of the parts that were begun faster than a speed; an exact sum, so that its
    last bit depends on no order."""
    x, y = rows.column("x_m")[: last + 1], rows.column("y_m")[: last + 1]
    dx, dy = np.diff(x), np.diff(y)
    fast = rows.column("speed_mps")[:last] > above_mps
    return math.fsum(np.sqrt(dx * dx + dy * dy)[fast].tolist())
