"""Verdicts of trials, on rows by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from trial_drives import HandDrive, hand_ground

from schemas.kinds.scenarios.storyboard import StoryboardConfig
from schemas.sections.trial import Trial
from twin.scenario.protocol import Scalars, Verdict
from twin.scenario.storyboard.case.family import StoryboardFamily
from twin.scenario.storyboard.case.trial import TARGET_COLUMNS

AVOID = Trial(rule="avoid", speed_kmh=72)
LIMIT = Trial(rule="limit", speed_kmh=72, impact_kmh=[[60, 0], [72, 36]])
NEGATIVE = Trial(rule="no_reaction", speed_kmh=72)
NEVER = HandDrive()
ALWAYS = HandDrive(brakes_s=0.0)
LATE = HandDrive(brakes_s=4.0)
"""Brakes 18 m before: 20 m/s become sqrt(400 - 2 * 8 * 18) = 10.58 m/s."""


def judged(trial: Trial, drive: HandDrive) -> tuple[Verdict, Scalars]:
    driver = "robot" if drive.robot else "stack"
    config = StoryboardConfig(storyboard="s", driver=driver, trial=trial)
    run = StoryboardFamily(config, hand_ground(drive), 0.0, 0.0)
    rows, contact = drive.rows()
    verdict = run.trial_verdict(rows, contact)
    assert verdict is not None
    return verdict, run.trial_scalars(rows, contact)


@pytest.mark.parametrize("trial", [AVOID, LIMIT])
@pytest.mark.parametrize("robot", [True, False])
def test_a_stack_that_never_brakes_fails_what_is_to_be_avoided(trial: Trial, robot: bool) -> None:
    verdict, scalars = judged(trial, NEVER.changed(robot=robot))
    assert verdict.verdict == {"avoid": "not_mitigated", "limit": "fail"}[trial.rule]
    assert scalars["impact_relative_mps"] == pytest.approx(20.0)
    assert scalars["speed_reduction_mps"] == pytest.approx(0.0)
    assert scalars["trial_acted_s"] is None


@pytest.mark.parametrize("trial", [AVOID, LIMIT])
@pytest.mark.parametrize("robot", [True, False])
def test_a_stack_that_always_brakes_passes_it(trial: Trial, robot: bool) -> None:
    verdict, scalars = judged(trial, ALWAYS.changed(robot=robot))
    assert verdict.verdict == {"avoid": "avoided", "limit": "pass"}[trial.rule]
    assert scalars["impact_relative_mps"] is None
    assert scalars["trial_acted_s"] == 0.0


def test_where_nothing_is_to_be_done_it_is_the_other_way_round() -> None:
    beside = {"target": (100.0, 3.5)}
    assert judged(NEGATIVE, NEVER.changed(**beside))[0].verdict == "pass"
    verdict, _ = judged(NEGATIVE, ALWAYS.changed(**beside))
    assert verdict.verdict == "false_reaction"
    assert "slowed down by 8.00 m/s2, first after 0.00 s" in verdict.reasons[0]


def test_a_weak_reaction_is_none() -> None:
    drive = ALWAYS.changed(target=(200.0, 3.5), deceleration=0.9)
    assert judged(NEGATIVE, drive)[0].verdict == "pass"
    assert judged(NEGATIVE, drive.changed(deceleration=1.1))[0].verdict == "false_reaction"


def test_what_the_scenario_slows_down_is_no_reaction() -> None:
    slowed = NEVER.changed(target=(100.0, 3.5), more={"accel_mps2": -3.0})
    assert judged(NEGATIVE, slowed)[0].verdict == "pass"


def test_who_only_warns_slows_nothing_down() -> None:
    slowed = NEVER.changed(target=(100.0, 3.5), more={"accel_mps2": -3.0}, warns_s=1.0)
    assert judged(NEGATIVE, slowed)[0].verdict == "pass"


def test_a_contact_in_a_test_without_a_reason_to_react_fails() -> None:
    assert judged(NEGATIVE, NEVER)[0].verdict == "fail"


def test_the_impact_is_that_of_the_moment_between_two_rows() -> None:
    verdict, scalars = judged(AVOID, LATE)
    expected = math.sqrt(20.0**2 - 2 * 8.0 * 18.0)
    assert scalars["impact_relative_mps"] == pytest.approx(expected, abs=0.01)
    assert scalars["speed_reduction_mps"] == pytest.approx(20.0 - expected, abs=0.01)
    assert verdict.verdict == "mitigated"
    assert "38.1 km/h relative to the target, 33.9 km/h slower" in verdict.reasons[0]


@pytest.mark.parametrize(
    ("threshold", "verdict"), [(33.8, "mitigated"), (34.0, "not_mitigated"), (0.0, "mitigated")]
)
def test_a_contact_is_mitigated_from_a_threshold_on(threshold: float, verdict: str) -> None:
    trial = Trial(rule="avoid", speed_kmh=72, reduced_kmh=threshold)
    assert judged(trial, LATE)[0].verdict == verdict


@pytest.mark.parametrize(("limit", "verdict"), [(38.2, "pass"), (38.0, "fail"), (0.0, "fail")])
def test_a_limit_is_kept_or_not(limit: float, verdict: str) -> None:
    trial = Trial(rule="limit", speed_kmh=72, impact_kmh_max=limit)
    assert judged(trial, LATE)[0].verdict == verdict


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_the_impact_is_relative_to_a_moving_target(heading: float) -> None:
    drive = NEVER.changed(target=(60.0, 0.0), velocity=(5.0, 0.0), heading=heading)
    _, scalars = judged(AVOID, drive)
    assert scalars["impact_relative_mps"] == pytest.approx(15.0)
    assert scalars["trial_closing_mps"] == pytest.approx(15.0)
    assert scalars["trial_begin_s"] == 0.0, "58 m at 15 m/s are 3.87 s"


def test_a_braking_target_is_as_fast_as_at_the_contact() -> None:
    drive = NEVER.changed(target=(40.0, 0.0), velocity=(20.0, 0.0), target_braking=6.0)
    contact = drive.meets()
    assert contact is not None
    expected = 20.0 - max(0.0, 20.0 - 6.0 * contact.time_s)
    _, scalars = judged(AVOID, drive)
    assert scalars["impact_relative_mps"] == pytest.approx(expected, abs=1e-6)


def test_a_crossing_target_has_no_speed_ahead() -> None:
    drive = NEVER.changed(target=(82.0, -6.0), velocity=(0.0, 1.5), heading=0.4)
    _, scalars = judged(AVOID, drive)
    assert scalars["impact_relative_mps"] == pytest.approx(20.0)
    # 82 m to its middle take 4.1 s, in which it goes 6.15 m.
    assert scalars["trial_lateral_m"] == pytest.approx(0.15, abs=1e-6)


def test_a_target_that_has_left_is_met_nowhere_whoever_judges() -> None:
    drive = NEVER.changed(target=(100.0, 3.5))
    rows, contact = drive.rows()
    left = np.where(np.arange(rows.rows) < rows.rows - 5, 0.0, np.nan)
    rows = rows.changed(**{name: rows.column(name) + left for name in TARGET_COLUMNS})
    config = StoryboardConfig(storyboard="s", driver="robot", trial=AVOID)
    run = StoryboardFamily(config, hand_ground(drive), 0.0, 0.0)
    scalars = run.trial_scalars(rows, contact)
    assert scalars["trial_lateral_m"] is None
    assert scalars["trial_begin_s"] is not None
    assert run.trial_scalars(rows.as_files_have_them(), contact) == scalars


def test_the_test_begins_at_its_time_to_collision() -> None:
    _, scalars = judged(AVOID, NEVER.changed(target=(122.0, 0.0)))
    assert scalars["trial_begin_s"] == pytest.approx(2.0, abs=0.021)
    _, near = judged(AVOID, NEVER.changed(target=(52.0, 0.0)))
    assert near["trial_begin_s"] == 0.0, "nearer than this, it begins with the case"


@pytest.mark.parametrize(
    ("off_kmh", "verdict"), [(1.1, "inconclusive"), (-1.1, "inconclusive"), (0.9, "fail")]
)
def test_an_ego_that_is_off_its_speed_is_inconclusive_and_says_so(
    off_kmh: float, verdict: str
) -> None:
    trial = Trial(rule="limit", speed_kmh=72 - off_kmh)
    found, _ = judged(trial, NEVER)
    assert found.verdict == verdict
    if verdict == "inconclusive":
        how = "faster" if off_kmh > 0 else "slower"
        assert f"the ego was 1.10 km/h {how} than the planned" in found.reasons[0]
        assert "allowed: -1 to +1 km/h" in found.reasons[0]


def test_tolerances_need_not_be_the_same_on_both_sides() -> None:
    for planned, verdict in ((72, "fail"), (73.9, "fail"), (74.1, "inconclusive")):
        trial = Trial(rule="limit", speed_kmh=planned, speed_tolerance_kmh=[-2, 0])
        assert judged(trial, NEVER)[0].verdict == verdict
    trial = Trial(rule="limit", speed_kmh=71.5, speed_tolerance_kmh=[-2, 0])
    assert judged(trial, NEVER)[0].verdict == "inconclusive"


@pytest.mark.parametrize(
    ("fields", "more", "words"),
    [
        ({"light_lux_min": 1000}, {"light_lx": 999.0}, "999 lx of light; needed: 1000 lx"),
        ({"friction_min": 0.9}, {"road_friction": 0.89}, "friction of 0.89; needed: 0.9"),
        ({"straight_s": 2.0}, {}, "driven for 0.90 s when the test began; needed: 2 s"),
    ],
)
def test_each_precondition_is_looked_at(
    fields: dict[str, Any], more: dict[str, float], words: str
) -> None:
    verdict, _ = judged(Trial(rule="avoid", speed_kmh=72, **fields), NEVER.changed(more=more))
    assert verdict.verdict == "inconclusive"
    assert words in verdict.reasons[0]
    assert judged(AVOID, NEVER.changed(more=more))[0].verdict == "not_mitigated"


@pytest.mark.parametrize(("aside", "verdict"), [(0.15, "not_mitigated"), (0.25, "inconclusive")])
def test_the_target_must_be_met_where_it_is_planned(aside: float, verdict: str) -> None:
    trial = Trial(rule="avoid", speed_kmh=72, lateral_tolerance_m=0.2)
    found, _ = judged(trial, NEVER.changed(target=(100.0, -aside)))
    assert found.verdict == verdict
    planned = Trial(rule="avoid", speed_kmh=72, lateral_m=-aside, lateral_tolerance_m=0.2)
    assert judged(planned, NEVER.changed(target=(100.0, -aside)))[0].verdict == "not_mitigated"


def test_a_turn_before_the_stack_acts_is_inconclusive() -> None:
    trial = Trial(rule="avoid", speed_kmh=72, yaw_rate_tolerance_degps=1.0)
    rows, contact = NEVER.rows()
    turned = np.radians(np.maximum(0.0, np.arange(rows.rows) - 100.0) * 0.02 * 1.5)
    config = StoryboardConfig(storyboard="s", driver="robot", trial=trial)
    run = StoryboardFamily(config, hand_ground(NEVER), 0.0, 0.0)
    verdict = run.trial_verdict(rows.changed(yaw_rad=turned), contact)
    assert verdict is not None
    assert verdict.verdict == "inconclusive"
    assert "turned by 1.50 deg/s" in verdict.reasons[0]


def test_preconditions_end_where_the_stack_acts() -> None:
    """Slower is who brakes before the test has begun; that is no missed precondition."""
    verdict, scalars = judged(AVOID, HandDrive(brakes_s=0.4))
    assert verdict.verdict == "avoided"
    assert scalars["trial_speed_mps"] == pytest.approx(20.0)


def test_a_contact_with_something_else_is_no_success() -> None:
    for trial, word in ((AVOID, "not_mitigated"), (LIMIT, "fail")):
        verdict, scalars = judged(trial, LATE.changed(hits="parked car"))
        assert verdict.verdict == word
        assert "'parked car' (car)" in verdict.reasons[0]
        assert scalars["impact_relative_mps"] is None


def test_a_run_without_danger_says_nothing_of_a_stack_that_does_nothing() -> None:
    for trial in (AVOID, LIMIT):
        verdict, _ = judged(trial, NEVER.changed(target=(100.0, 5.0)))
        assert verdict.verdict == "inconclusive"
        assert "it was in no danger" in verdict.reasons[0]


def test_time_that_is_up_at_speed_decides_nothing() -> None:
    slow = HandDrive(brakes_s=0.0, deceleration=0.5, seconds=3.0, running=True)
    verdict, _ = judged(AVOID, slow)
    assert verdict.verdict == "inconclusive"
    assert "time was up at 18.50 m/s" in verdict.reasons[0]
    assert judged(AVOID, ALWAYS.changed(running=True))[0].verdict == "avoided", "it stands"


@pytest.mark.parametrize(
    ("warns_s", "fields", "verdict"),
    [
        (None, {}, "fail"),
        (3.0, {"warn_before_braking_s": 0.8}, "pass"),
        (3.4, {"warn_before_braking_s": 0.8}, "fail"),
        (3.0, {"warn_ttc_s": 1.7}, "pass"),
        (3.5, {"warn_ttc_s": 1.7}, "fail"),
    ],
)
def test_a_warning_comes_in_time_or_not(
    warns_s: float | None, fields: dict[str, float], verdict: str
) -> None:
    trial = Trial(rule="warn", speed_kmh=72, **fields)
    assert judged(trial, LATE.changed(warns_s=warns_s))[0].verdict == verdict


def test_without_a_trial_there_is_neither_verdict_nor_scalar() -> None:
    run = StoryboardFamily(StoryboardConfig(storyboard="s"), hand_ground(NEVER), 0.0, 0.0)
    rows, contact = NEVER.rows()
    assert run.trial_verdict(rows, contact) is None
    assert set(run.trial_scalars(rows, contact).values()) == {None}
