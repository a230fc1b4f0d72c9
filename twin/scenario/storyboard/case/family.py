"""``storyboard``: a case ends with its storyboard, and passes if the ego hit nothing until then."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schemas.kinds.scenarios.storyboard import StoryboardConfig
from twin.scenario.driver import BRAKED
from twin.scenario.protocol import FirstContact, Rows, Scalars, Verdict
from twin.scenario.storyboard.case.free_run import FREE_SCALARS, FreeRun
from twin.scenario.storyboard.case.trial import TRIAL_SCALARS, TrialRun
from twin.scenario.surroundings import Surroundings


class StoryboardFamily:
    """One case of a storyboard, as far as its rows tell it; the bodies move elsewhere."""

    def __init__(
        self, config: StoryboardConfig, ground: Surroundings, _x_m: float, _y_m: float
    ) -> None:
        self._events = ground.events
        self._trial = TrialRun(config, ground) if config.trial is not None else None
        self._free = FreeRun(config.free_driving) if config.free_driving is not None else None

    @classmethod
    def start(cls, _config: StoryboardConfig, ground: Surroundings) -> tuple[float, float, float]:
        """Start pose where the lane begins; the storyboard says another."""
        return ground.before_target(0.0)

    def observe(self, _x_m: np.ndarray, _y_m: np.ndarray) -> None:
        """Observe nothing: all that counts stands in the rows."""

    def columns(self) -> Mapping[str, float]:
        """None of its own: who moves the bodies gives them."""
        return {}

    def ended(self) -> bool:
        """Never of itself: who moves the bodies says it."""
        return False

    def scalars(self, rows: Rows) -> Scalars:
        """When the storyboard ended, and the last of its events."""
        over = np.flatnonzero(rows.column("storyboard_running") == 0.0)
        begun = bool(rows.valid("event_last")[-1])
        return {
            "storyboard_end_s": float(rows.column("sim_time_ns")[over[0]] / 1e9)
            if len(over)
            else None,
            "events_started": int(rows.column("events_started")[-1]),
            "event_last": int(rows.column("event_last")[-1]) if begun else None,
            "event_last_s": float(rows.column("event_last_s")[-1]) if begun else None,
            **_intervention(rows),
            **_warning(rows),
            **(self._free.scalars(rows) if self._free else dict.fromkeys(FREE_SCALARS)),
        }

    def judge(self, rows: Rows, moved: bool) -> Verdict:
        """``pass`` if the storyboard has ended; else time was up before."""
        speed_mps = rows.column("speed_mps")[-1]
        if rows.column("storyboard_running")[-1] == 0.0:
            how = "" if moved else "; the ego never moved"
            reasons = [f"the storyboard ended without a collision{how}"]
            return Verdict("pass", [*reasons, *_intervention_words(rows)])
        reasons = [f"time is up at {speed_mps:.2f} m/s, and the storyboard still runs"]
        return Verdict("time_up", [*reasons, *self.before_end(rows)])

    def trial_scalars(self, rows: Rows, contact: FirstContact | None) -> Scalars:
        """Scalars of the trial; None without one."""
        none: Scalars = dict.fromkeys(TRIAL_SCALARS)
        return none if self._trial is None else self._trial.scalars(rows, contact)

    def trial_verdict(self, rows: Rows, contact: FirstContact | None) -> Verdict | None:
        """The verdict of the trial, or of free driving; None: the case is neither."""
        if self._free is not None:
            return self._free.verdict(rows, contact)
        if self._trial is None:
            return None
        verdict = self._trial.verdict(rows, contact)
        return Verdict(verdict.verdict, [*verdict.reasons, *_intervention_words(rows)])

    def before_end(self, rows: Rows) -> list[str]:
        """The last event before a case's end and the stack's intervention, in words."""
        if not rows.valid("event_last")[-1]:
            return ["no event of the storyboard had begun", *_intervention_words(rows)]
        number = int(rows.column("event_last")[-1])
        name = self._events[number - 1] if 0 < number <= len(self._events) else f"number {number}"
        event = f"the last event before was '{name}', at {rows.column('event_last_s')[-1]:.2f} s"
        return [event, *_intervention_words(rows)]


def _intervention(rows: Rows) -> Scalars:
    """When and how the stack took over from the robot; None: it did not."""
    names = ("kind", "time_s", "speed_mps", "dtc_m", "ttc_s")
    values: Scalars = {f"intervention_{name}": None for name in names}
    taken = np.flatnonzero(rows.valid("intervention_kind"))
    if not len(taken):
        return values
    first = int(taken[0])
    values["intervention_kind"] = int(rows.column("intervention_kind")[first])
    values["intervention_time_s"] = float(rows.column("sim_time_ns")[first] / 1e9)
    values["intervention_speed_mps"] = float(rows.column("speed_mps")[first])
    for name in ("dtc_m", "ttc_s"):
        if rows.valid(name)[first]:
            values[f"intervention_{name}"] = float(rows.column(name)[first])
    return values


def _warning(rows: Rows) -> Scalars:
    """When the stack first warned of a collision; None: it did not."""
    values: Scalars = {f"warning_{name}_s": None for name in ("time", "ttc", "before_braking")}
    time_s = rows.column("sim_time_ns") / 1e9
    warned = np.flatnonzero(rows.column("warning"))
    if not len(warned):
        return values
    first = int(warned[0])
    values["warning_time_s"] = float(time_s[first])
    if rows.valid("ttc_s")[first]:
        values["warning_ttc_s"] = float(rows.column("ttc_s")[first])
    braked = np.flatnonzero(rows.column("brake") > 0.0)
    if len(braked):
        values["warning_before_braking_s"] = float(time_s[braked[0]] - time_s[first])
    return values


def _intervention_words(rows: Rows) -> list[str]:
    """What the stack did while the robot drove; nothing where none did."""
    if not rows.valid("robot_drives")[0]:
        return []
    values = _intervention(rows)
    if values["intervention_kind"] is None:
        return ["the stack did not intervene, the robot drove to the end"]
    how = "braking" if values["intervention_kind"] == BRAKED else "steering"
    time_s, speed_mps = values["intervention_time_s"], values["intervention_speed_mps"]
    return [f"the stack intervened by {how} after {time_s:.2f} s, at {speed_mps:.2f} m/s"]
