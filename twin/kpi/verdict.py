"""When a case ends, its scalars, and its verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.campaign import Scenario
from schemas.case import Variation
from schemas.files.kpi import SCALARS
from schemas.kinds.kpi import KpiKind
from schemas.kinds.scenario import kind_of
from twin.kpi.computed import computed_scalars
from twin.kpi.recorder import CaseRows
from twin.kpi.robustness import formula_scalars
from twin.scenario.protocol import (
    FirstContact,
    HoldsTrial,
    Scalars,
    ScenarioRun,
    TellsEvents,
    Verdict,
)
from twin.vehicle.columns import COLUMN, PHYSICS_STEP_NS
from twin.world.things import Thing


@dataclass(frozen=True, slots=True)
class Limits:
    """Latest ends of the cases of all slots; 0 where none runs."""

    duration_ns: np.ndarray
    """Longest sim time of the cases, int64 [S] [ns]."""
    standstill_ns: np.ndarray
    """Time at rest after which a case ends, int64 [S] [ns]; -1: it does not end so."""

    @classmethod
    def of(cls, slots: int) -> Limits:
        """Limits of ``slots`` empty slots."""
        return cls(np.zeros(slots, np.int64), np.zeros(slots, np.int64))

    def begin(self, slot: int, scenario: Scenario) -> None:
        """A case begins in a slot."""
        self.duration_ns[slot] = round(scenario.duration_s * 1e9)
        rests = kind_of(scenario).ends_at_rest
        self.standstill_ns[slot] = round(scenario.standstill_s * 1e9) if rests else -1


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
    rested &= limits.standstill_ns >= 0
    crashed = state[:, COLUMN["collisions"]] > 0
    ended: np.ndarray = crashed | rested | (sim_time_ns >= limits.duration_ns)
    return ended


def case_scalars(
    case: Variation,
    recorder: CaseRows,
    state: np.ndarray,
    run: ScenarioRun,
    hit: Thing | None = None,
) -> Scalars:
    """All scalars of a case: :func:`scalars` with those of its family, and of its formula."""
    kinds = kind_of(case.scenario).scalars
    return scalars(recorder, state, run, hit, kinds) | formula_scalars(case.formula, recorder)


def scalars(
    recorder: CaseRows,
    state: np.ndarray,
    run: ScenarioRun,
    hit: Thing | None = None,
    kinds: Sequence[KpiKind] = (),
) -> Scalars:
    """Scalars of :data:`schemas.files.kpi.SCALARS` from the rows, those of the scenario's family,
    and those of ``kinds`` that a function computes; None where missing."""
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
    values |= run.scalars(recorder)
    if isinstance(run, HoldsTrial):
        values |= run.trial_scalars(recorder, contact_of(state, hit))
    values |= computed_scalars(kinds, recorder)
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
    name_of = {}
    for name, column in (
        ("nearest_object", "nearest_m"),
        ("nearest_ttc_object", "nearest_ttc_s"),
    ):
        least = _least(recorder, column)
        if least is not None:
            name_of[name] = recorder.name(name, least)
    if hit is not None and state[COLUMN["collisions"]] > 0:
        name_of |= {"hit_object": hit.name, "hit_class": hit.kind, "nearest_object": hit.name}
    return name_of


def _least(recorder: CaseRows, column: str) -> int | None:
    """The first row in which a column is least; None: it has no value."""
    valid = np.flatnonzero(recorder.valid(column))
    if not len(valid):
        return None
    return int(valid[np.argmin(recorder.column(column)[valid])])


def contact_of(state: np.ndarray, hit: Thing | None) -> FirstContact | None:
    """The first collision of a case; None: there was none."""
    if not state[COLUMN["collisions"]] > 0:
        return None
    time_s = float(state[COLUMN["impact_step"]] * PHYSICS_STEP_NS / 1e9)
    return FirstContact(time_s, float(state[COLUMN["impact_speed_mps"]]), hit)


def judge(rows: CaseRows, state: np.ndarray, run: ScenarioRun, hit: Thing | None) -> Verdict:
    """The verdict of an ended case; ``hit`` is what the ego hit first, if anything."""
    if isinstance(run, HoldsTrial):
        verdict = run.trial_verdict(rows, contact_of(state, hit))
        if verdict is not None:
            return verdict
    if state[COLUMN["collisions"]] > 0:
        speed = state[COLUMN["impact_speed_mps"]]
        at = state[COLUMN["impact_step"]] * PHYSICS_STEP_NS / 1e9
        what = f" with {hit.words}" if hit else ""
        reasons = [f"collision at {speed:.2f} m/s after {at:.3f} s{what}"]
        if isinstance(run, TellsEvents):
            reasons += run.before_end(rows)
        return Verdict("collision", reasons)
    return run.judge(rows, bool(state[COLUMN["moved"]] != 0))
