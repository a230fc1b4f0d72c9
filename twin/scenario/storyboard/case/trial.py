"""Trials of storyboards: preconditions, what the stack did, and the verdict; from the rows alone.

Longitudinal means along the ego's heading, as UN R152 (2.) has it: the time to collision is the
longitudinal distance between ego and target over their longitudinal relative speed, and the
relative impact speed is the difference of their longitudinal speeds at the contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.kinds.scenarios.storyboard import StoryboardConfig
from schemas.sections.trial import Trial
from twin.road.opendrive.grid import sine_cosine
from twin.scenario.protocol import FirstContact, Rows, Scalars, Verdict
from twin.scenario.surroundings import Surroundings

TARGET_COLUMNS = (
    *("target_x_m", "target_y_m", "target_yaw_rad", "target_vx_mps", "target_vy_mps"),
)
"""Columns of what a trial is about: middle, heading, velocity of the middle."""
TRIAL_SCALARS = (
    *("trial_begin_s", "trial_speed_mps", "trial_closing_mps", "trial_lateral_m"),
    *("trial_acted_s", "impact_relative_mps", "speed_reduction_mps"),
)
"""Scalars of a trial."""
_KMH = 3.6
_EXACT_KMH = 1e-6
"""Speeds that differ by less are equal: sums of floats [km/h]."""
_SLOWED_MPS = 0.5
"""An ego that is so much slower than when the test began has been slowed down [m/s]."""
_REST_MPS = 0.1
"""Slower than this the ego stands [m/s]."""


@dataclass(frozen=True, slots=True)
class _Course:
    """Ego and target over the rows of a case [rows]."""

    time_s: np.ndarray
    speed_mps: np.ndarray
    gap_m: np.ndarray
    """From the ego's front to the target's nearest side, along the ego's heading."""
    middle_m: np.ndarray
    """From the ego's front to the target's middle, along the ego's heading."""
    left_m: np.ndarray
    """From the ego's middle to the target's, to the left."""
    closing_mps: np.ndarray
    """Longitudinal relative speed."""
    left_mps: np.ndarray
    """Speed of the target to the left of the ego."""

    @property
    def ttc_s(self) -> np.ndarray:
        """Time to collision; infinite where they do not close in, or are beside each other."""
        closes = (self.closing_mps > 0.0) & (self.gap_m >= 0.0)
        safe = np.where(closes, self.closing_mps, 1.0)
        return np.where(closes, self.gap_m / safe, np.inf)


@dataclass(frozen=True, slots=True)
class _Measured:
    """What a trial looks at."""

    begin: int | None
    """Row at which the test began."""
    acted: int | None
    """Row at which the stack first acted."""
    checked: int
    """Row at which speeds are looked at: the test began, or the stack acted before."""
    until: int
    """Last row at which preconditions are looked at."""
    last: int
    """Last row before a contact, or of the case."""
    lateral_m: float | None
    on_target: bool
    """The first contact was with the target."""
    relative_mps: float | None
    """Relative speed at the contact with the target."""


class TrialRun:
    """The trial of one case."""

    def __init__(self, config: StoryboardConfig, ground: Surroundings) -> None:
        """``config`` has a trial; ``ground`` its target."""
        assert config.trial is not None
        self._trial: Trial = config.trial
        self._braking = config.robot_brake
        self._ground = ground

    def scalars(self, rows: Rows, contact: FirstContact | None) -> Scalars:
        """Values of :data:`TRIAL_SCALARS`."""
        course = self._course(rows)
        seen = self._measured(rows, course, contact)
        values: Scalars = dict.fromkeys(TRIAL_SCALARS)
        values["trial_speed_mps"] = float(course.speed_mps[seen.checked])
        values["trial_closing_mps"] = float(course.closing_mps[seen.checked])
        values["trial_lateral_m"] = seen.lateral_m
        if seen.begin is not None:
            values["trial_begin_s"] = float(course.time_s[seen.begin])
        if seen.acted is not None:
            values["trial_acted_s"] = float(course.time_s[seen.acted])
        if seen.relative_mps is not None and contact is not None:
            values["impact_relative_mps"] = seen.relative_mps
            slower_mps = float(course.speed_mps[seen.checked]) - contact.speed_mps
            values["speed_reduction_mps"] = slower_mps
        return values

    def verdict(self, rows: Rows, contact: FirstContact | None) -> Verdict:
        """``inconclusive`` where a precondition was missed, else as the trial's rule says."""
        course = self._course(rows)
        seen = self._measured(rows, course, contact)
        missed = self._missed(rows, course, seen)
        if missed:
            return Verdict("inconclusive", missed)
        judge = {
            "avoid": self._avoid,
            "limit": self._limit,
            "no_reaction": self._no_reaction,
            "warn": self._warn,
        }[self._trial.rule]
        return judge(rows, course, seen, contact)

    def _course(self, rows: Rows) -> _Course:
        ground = self._ground
        assert ground.target is not None, "a trial has a target"
        half_length_m, half_width_m = ground.target[3:].tolist()
        yaw = rows.column("yaw_rad")
        target_x_m, target_y_m, target_yaw, vx, vy = (_there(rows, n) for n in TARGET_COLUMNS)
        s, c = sine_cosine(yaw)
        turned = target_yaw - yaw
        turned_sine, turned_cosine = sine_cosine(turned)
        extent_m = half_length_m * np.abs(turned_cosine)
        extent_m += half_width_m * np.abs(turned_sine)
        east_m = target_x_m - rows.column("x_m")
        north_m = target_y_m - rows.column("y_m")
        front_m = ground.centre_offset_m + ground.half_length_m
        middle_m = east_m * c + north_m * s - front_m
        speed_mps = rows.column("speed_mps")
        return _Course(
            time_s=rows.column("sim_time_ns") / 1e9,
            speed_mps=speed_mps,
            gap_m=middle_m - extent_m,
            middle_m=middle_m,
            left_m=north_m * c - east_m * s,
            closing_mps=speed_mps - (vx * c + vy * s),
            left_mps=vy * c - vx * s,
        )

    def _measured(self, rows: Rows, course: _Course, contact: FirstContact | None) -> _Measured:
        last = rows.rows - 1
        if contact is not None:
            last = max(0, int(np.searchsorted(course.time_s, contact.time_s, "right")) - 1)
        begun = np.flatnonzero(course.ttc_s[: last + 1] <= self._trial.begins_ttc_s)
        begin = int(begun[0]) if len(begun) else None
        acts = np.flatnonzero(self._acts(rows)[: last + 1])
        acted = int(acts[0]) if len(acts) else None
        first = begin if begin is not None else 0
        checked = first if acted is None else min(first, acted)
        until = last if acted is None else acted
        on_target = contact is not None and (
            contact.thing is not None and contact.thing.name == self._ground.target_name
        )
        return _Measured(
            begin=begin,
            acted=acted,
            checked=checked,
            until=until,
            last=last,
            lateral_m=_lateral_m(course, until),
            on_target=on_target,
            relative_mps=self._relative_mps(rows, course, last, contact) if on_target else None,
        )

    def _acts(self, rows: Rows) -> np.ndarray:
        """Rows in which the stack acts [rows]; the robot's driving is none of it."""
        acts: np.ndarray = _switched(rows, "aeb") | _switched(rows, "warning")
        acts |= rows.valid("intervention_kind")
        if not rows.valid("robot_drives")[0]:
            acts |= rows.valid("brake") & (rows.column("brake") >= self._braking)
        return acts

    def _relative_mps(
        self, rows: Rows, course: _Course, last: int, contact: FirstContact | None
    ) -> float:
        """Relative speed at a contact: the target's velocity of that moment, between two rows,
        along the ego's heading before it."""
        assert contact is not None
        yaw = rows.column("yaw_rad")[last]
        s, c = sine_cosine(yaw)
        along = _there(rows, "target_vx_mps") * c + _there(rows, "target_vy_mps") * s
        after = min(last + 1, rows.rows - 1)
        after = after if math.isfinite(along[after]) else last
        span_s = float(course.time_s[after] - course.time_s[last])
        share = (contact.time_s - float(course.time_s[last])) / span_s if span_s > 0.0 else 0.0
        target_mps = float(along[last]) + share * float(along[after] - along[last])
        return contact.speed_mps - target_mps

    def _missed(self, rows: Rows, course: _Course, seen: _Measured) -> list[str]:
        """Preconditions that were missed, in words."""
        trial, missed = self._trial, list[str]()
        if trial.speed_kmh is not None:
            low, high = trial.speed_tolerance_kmh
            off = float(course.speed_mps[seen.checked]) * _KMH - trial.speed_kmh
            if not low - _EXACT_KMH <= off <= high + _EXACT_KMH:
                missed.append(
                    f"the ego was {abs(off):.2f} km/h {'faster' if off > 0 else 'slower'} than "
                    f"the planned {trial.speed_kmh:g} km/h when the test began; allowed: "
                    f"{low:+g} to {high:+g} km/h"
                )
        begun = seen.begin is not None and seen.checked == seen.begin
        if begun and trial.lateral_tolerance_m is not None and seen.lateral_m is not None:
            off = seen.lateral_m - trial.lateral_m
            if abs(off) > trial.lateral_tolerance_m:
                missed.append(
                    f"the target would be met {abs(off):.2f} m to the "
                    f"{'left' if off > 0 else 'right'} of where it is planned; allowed: "
                    f"{trial.lateral_tolerance_m:g} m"
                )
        driven_s = float(course.time_s[seen.checked])
        if begun and driven_s < trial.straight_s:
            missed.append(
                f"the ego had been driven for {driven_s:.2f} s when the test began; needed: "
                f"{trial.straight_s:g} s"
            )
        missed += self._turned(rows, course, seen)
        for name, least, what in (
            ("light_lx", trial.light_lux_min, "{:.0f} lx of light; needed: {:g} lx"),
            ("road_friction", trial.friction_min, "a friction of {:.2f}; needed: {:g}"),
        ):
            value = float(rows.column(name)[: seen.until + 1].min())
            if least is not None and value < least:
                missed.append(f"the road had {what.format(value, least)}")
        return missed

    def _turned(self, rows: Rows, course: _Course, seen: _Measured) -> list[str]:
        """Whether the ego turned more than it may from before the test on."""
        allowed_degps = self._trial.yaw_rate_tolerance_degps
        from_s = float(course.time_s[seen.checked]) - self._trial.straight_s
        first = int(np.searchsorted(course.time_s, from_s, "left"))
        times, yaw = (c[first : seen.until + 1] for c in (course.time_s, rows.column("yaw_rad")))
        if allowed_degps is None or len(times) < 2:
            return []
        turned = np.diff(yaw)
        turned -= 2.0 * np.pi * np.rint(turned / (2.0 * np.pi))
        fastest_degps = float(np.degrees(np.abs(turned / np.diff(times)).max()))
        if fastest_degps <= allowed_degps:
            return []
        return [
            f"the ego turned by {fastest_degps:.2f} deg/s before the stack acted; allowed: "
            f"{allowed_degps:g} deg/s"
        ]

    def _undecided(self, rows: Rows, course: _Course, seen: _Measured) -> Verdict | None:
        """A case without a contact that says nothing of the stack."""
        if rows.column("storyboard_running")[-1] != 0.0 and course.speed_mps[-1] > _REST_MPS:
            how = f"time was up at {course.speed_mps[-1]:.2f} m/s before the storyboard's end"
            return Verdict("inconclusive", [how])
        slowed = course.speed_mps[seen.checked] - course.speed_mps.min() >= _SLOWED_MPS
        if seen.acted is None and not slowed:
            how = "nothing was touched although the stack did not act: it was in no danger"
            return Verdict("inconclusive", [how])
        return None

    def _avoid(
        self, rows: Rows, course: _Course, seen: _Measured, contact: FirstContact | None
    ) -> Verdict:
        if contact is None:
            return self._undecided(rows, course, seen) or Verdict("avoided", ["no contact"])
        if not seen.on_target:
            return Verdict("not_mitigated", [_strange(contact)])
        assert seen.relative_mps is not None
        reduced_kmh = (float(course.speed_mps[seen.checked]) - contact.speed_mps) * _KMH
        how = (
            f"contact at {contact.speed_mps * _KMH:.1f} km/h, {seen.relative_mps * _KMH:.1f} km/h "
            f"relative to the target, {reduced_kmh:.1f} km/h slower than the test began"
        )
        enough = reduced_kmh >= self._trial.reduced_kmh - _EXACT_KMH
        return Verdict("mitigated" if enough else "not_mitigated", [how])

    def _limit(
        self, rows: Rows, course: _Course, seen: _Measured, contact: FirstContact | None
    ) -> Verdict:
        limit_kmh = self._trial.limit_kmh()
        if contact is None:
            return self._undecided(rows, course, seen) or Verdict("pass", ["no contact"])
        if not seen.on_target:
            return Verdict("fail", [_strange(contact)])
        assert seen.relative_mps is not None
        relative_kmh = seen.relative_mps * _KMH
        how = f"contact at {relative_kmh:.1f} km/h relative to the target, allowed: "
        how += f"{limit_kmh:g} km/h" if limit_kmh else "no contact"
        kept = limit_kmh > 0.0 and relative_kmh <= limit_kmh + _EXACT_KMH
        return Verdict("pass" if kept else "fail", [how])

    def _no_reaction(
        self, rows: Rows, course: _Course, seen: _Measured, contact: FirstContact | None
    ) -> Verdict:
        # Before the stack acts, it is the scenario that slows the ego down, and as long as a robot
        # drives: a stack that has only warned brakes nothing.
        begin = seen.last + 1 if seen.acted is None else seen.acted
        driven = rows.valid("robot_drives") & (rows.column("robot_drives") != 0.0)
        begin = max(begin, int(driven.nonzero()[0].max(initial=-1)) + 1)
        slows = -rows.column("accel_mps2")[: seen.last + 1]
        slows[:begin] = 0.0
        over = np.flatnonzero(slows >= self._trial.reaction_mps2)
        allowed = f"below {self._trial.reaction_mps2:g} m/s2 is no reaction"
        if len(over):
            at_s = float(course.time_s[over[0]])
            how = f"the ego slowed down by {slows.max():.2f} m/s2, first after {at_s:.2f} s; "
            return Verdict("false_reaction", [how + allowed])
        if contact is not None:
            return Verdict("fail", [_strange(contact)])
        if rows.column("storyboard_running")[-1] != 0.0:
            how = "time was up before the storyboard's end, without a reaction until then"
            return Verdict("inconclusive", [how])
        most = max(float(slows.max()), 0.0)
        return Verdict("pass", [f"the ego slowed down by {most:.2f} m/s2 at most; {allowed}"])

    def _warn(
        self, rows: Rows, course: _Course, seen: _Measured, contact: FirstContact | None
    ) -> Verdict:
        warned = np.flatnonzero(_switched(rows, "warning")[: seen.last + 1])
        if not len(warned):
            undecided = self._undecided(rows, course, seen) if contact is None else None
            return undecided or Verdict("fail", ["the stack did not warn"])
        first, trial = int(warned[0]), self._trial
        at_s, ttc_s = float(course.time_s[first]), float(course.ttc_s[first])
        told = f"the stack warned after {at_s:.2f} s, {ttc_s:.2f} s before the collision"
        late = []
        if trial.warn_ttc_s is not None and ttc_s < trial.warn_ttc_s:
            late.append(f"needed: {trial.warn_ttc_s:g} s")
        brakes = rows.valid("intervention_kind") | _switched(rows, "aeb")
        braked = np.flatnonzero(brakes[: seen.last + 1])
        if trial.warn_before_braking_s is not None and len(braked):
            before_s = float(course.time_s[braked[0]]) - at_s
            if before_s < trial.warn_before_braking_s:
                late.append(
                    f"{before_s:.2f} s before it braked; needed: {trial.warn_before_braking_s:g} s"
                )
        return Verdict("fail" if late else "pass", ["; ".join([told, *late])])


def _there(rows: Rows, name: str) -> np.ndarray:
    """A column of the target [rows]; NaN, in memory as in files, where the target is not there."""
    return np.where(rows.valid(name), rows.column(name), np.nan)


def _switched(rows: Rows, name: str) -> np.ndarray:
    """Rows in which a switch is on; a column that older files do not have is off."""
    try:
        return np.asarray(rows.valid(name) & (rows.column(name) != 0))
    except KeyError:
        return np.zeros(rows.rows, np.bool_)


def _lateral_m(course: _Course, row: int) -> float | None:
    """Offset of the target to the left where it and the ego's front would meet, as both move at a
    row; None: they do not close in, or the target is not there."""
    closing_mps = float(course.closing_mps[row])
    if closing_mps <= 0.0 or course.middle_m[row] < 0.0:
        return None
    meets_s = float(course.middle_m[row]) / closing_mps
    offset_m = float(course.left_m[row]) + float(course.left_mps[row]) * meets_s
    return offset_m if math.isfinite(offset_m) else None


def _strange(contact: FirstContact) -> str:
    """A contact that ends a test otherwise than it was meant to."""
    what = f" with {contact.thing.words}" if contact.thing is not None else ""
    return f"contact{what} at {contact.speed_mps * _KMH:.1f} km/h after {contact.time_s:.3f} s"
