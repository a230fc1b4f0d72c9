"""Findings: the sentence, the number in it, the cases behind it; missing stays missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.report.analysis import losses
from conductor.report.analysis.findings import Finding, findings
from conductor.report.analysis.losses import counts_by
from conductor.report.reading.dossier import open_dossier
from schemas.names import WEATHERS

replace = msgspec.structs.replace


def data(models: list[str]) -> dict[str, Any]:
    return campaign_data(
        autonomy={"perception": {name: {"type": "ground_truth"} for name in models}},
        matrix={
            "model": models,
            "weather": list(WEATHERS),
            "time_of_day": ["05:00", "09:00", "13:00", "17:00"],
        },
    )


def verdict(end: Any, *, passed: bool, **scalars: float | None) -> Any:
    name = "pass" if passed else "collision"
    return replace(end, verdict=name, scalars={**end.scalars, **scalars})


def found(
    folder: Path, models: list[str], change: Any, campaign: dict[str, Any] | None = None
) -> list[Finding]:
    make_campaign(folder, campaign or data(models), change)
    return findings(open_dossier(folder))


def of_kind(found: list[Finding], kind: str) -> list[Finding]:
    return [each for each in found if each.kind == kind]


def test_a_difference_between_systems_and_the_axis_behind_it(tmp_path: Path) -> None:
    def change(case, end):
        foggy = case.variation.model == "worse" and "fog" in case.variation.weather
        return verdict(end, passed=not foggy, aeb_dtc_m=20.0, dtc_end_m=5.0)

    all_ = found(tmp_path, ["better", "worse"], change)
    (pair,) = of_kind(all_, "systems")
    assert pair.text.startswith("better passed 8 cases that worse lost under the same conditions")
    assert "the other way round 0 (of 32 pairs" in pair.text
    assert pair.p_value == pytest.approx(2 / 2**8)
    assert len(pair.cases) == 16
    first, second = of_kind(all_, "passed")
    assert first.text.startswith("better passed 32 of 32 cases (100.0 %, 95 % interval 89.3 %")
    assert second.text.startswith("worse passed 24 of 32 cases (75.0 %")
    assert len(second.cases) == 8
    weather, hour = sorted(of_kind(all_, "axis"), key=lambda each: each.p_value or 0)
    assert "worse: passing depends on weather (exact test, corrected p < 0.001)" in weather.text
    assert "fewest passed 0 of 4 at light fog, 0 of 4 at heavy fog; most 4 of 4" in weather.text
    assert set(weather.cases) == set(second.cases)
    assert (
        hour.text == "worse: no effect of time of day was found (exact test, corrected p = 1.000)."
    )
    (hidden,) = of_kind(all_, "hidden")
    assert hidden.text == "Of 56 cases without a collision, 0 did not pass."
    assert hidden.cases == ()


def test_what_the_absence_of_a_collision_hides(tmp_path: Path) -> None:
    verdicts = {"cloudy": "false_braking", "light_fog": "time_up", "heavy_snow": "collision"}
    triggers = {"clear": 61.0, "heavy_fog": 60.0, "cloudy": 90.0, "heavy_snow": 100.0}

    def change(case, end):
        scalars = {
            **end.scalars,
            "aeb_dtc_m": triggers.get(case.variation.weather),
            "aeb_time_s": None,
        }
        return replace(end, verdict=verdicts.get(case.variation.weather, "pass"), scalars=scalars)

    all_ = found(tmp_path, ["one", "two"], change)
    (hidden,) = of_kind(all_, "hidden")
    # The same cases as the verdict's own columns: no second limit, no distance of its own.
    assert hidden.text == (
        "Of 56 cases without a collision, 16 did not pass: 8 false braking (one 4, two 4), "
        "8 time up (one 4, two 4)."
    )
    assert {name.split("-")[-1] for name in hidden.cases} == {"cloudy", "light_fog"}
    (early,) = of_kind(all_, "early")
    assert early.text == (
        "Of 40 passes, 8 first triggered AEB further than 60 m from the obstacle, 2 times the "
        "limit of false braking, and drove on (one 4, two 4)."
    )
    assert {name.split("-")[-1] for name in early.cases} == {"clear"}
    (hit,) = of_kind(all_, "collision")
    assert hit.text == "Of 8 collisions, 8 came without any AEB trigger and 0 in spite of one."


def test_findings_make_sense_where_nothing_stands_in_the_lane(tmp_path: Path) -> None:
    def change(case, end):
        scalars = {**end.scalars, "dtc_min_m": None, "dtc_end_m": None, "aeb_dtc_m": None}
        stopped = case.variation.weather == "clear"
        return replace(end, verdict="false_braking" if stopped else "pass", scalars=scalars)

    all_ = found(tmp_path, ["one"], change)
    (hidden,) = of_kind(all_, "hidden")
    assert hidden.text == "Of 32 cases without a collision, 4 did not pass: 4 false braking."
    assert not of_kind(all_, "missing")
    assert not of_kind(all_, "early")
    assert not any("obstacle" in each.text for each in all_)


def test_missing_is_said_and_never_counted_as_passed(tmp_path: Path) -> None:
    def change(case, end):
        if case.variation.weather == "clear":
            return replace(end, outcome="unresolved", verdict="", passed=True, scalars={})
        if case.variation.weather == "cloudy":
            return replace(end, outcome="", verdict="", scalars={})
        return verdict(
            end, passed=True, dtc_min_m=None if case.variation.weather == "heavy_fog" else 3.0
        )

    all_ = found(tmp_path, ["one"], change)
    undecided, blind = of_kind(all_, "missing")
    assert undecided.text == (
        "8 of 32 cases have no verdict (4 not ended, 4 unresolved); none of them counts as passed."
    )
    assert blind.text.startswith("Of 4 cases with a verdict the smallest distance is missing")
    assert not of_kind(all_, "passed"), "cases are left"
    assert not of_kind(all_, "axis")  # of the cases with a verdict none is lost


def test_systems_that_do_not_differ_are_said_so(tmp_path: Path) -> None:
    all_ = found(tmp_path, ["a", "b", "c"], lambda case, end: verdict(end, passed=True))
    (none,) = of_kind(all_, "systems")
    assert none.text.startswith("No difference between the 3 systems under test was found")


@pytest.mark.parametrize("outcome", ["", "failed", "cancelled"])
def test_a_campaign_without_a_single_verdict(tmp_path: Path, outcome: str) -> None:
    all_ = found(
        tmp_path,
        ["a", "b"],
        lambda case, end: replace(end, outcome=outcome, verdict="", scalars={}),
    )
    assert [each.kind for each in all_] == ["missing", *(["passed"] * 2 if outcome else [])]
    assert "64 of 64 cases have no verdict" in all_[0].text
    if outcome:
        assert all_[1].text.startswith("a passed 0 of 32 cases (0.0 %")


def test_counts_by_value_and_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_campaign(
        tmp_path,
        change=lambda c, e: msgspec.structs.replace(
            e,
            verdict="pass"
            if c.variation.weather == "clear" or c.variation.model == "yolov3"
            else "collision",
        ),
    )
    dossier = open_dossier(tmp_path)
    assert counts_by(dossier, "weather", "collision") == [
        ("heavy_fog", {"yolov3": "0 of 2", "yolov2-tiny": "2 of 2"})
    ]
    monkeypatch.setattr(losses, "AXIS_VALUES_MAX", 1)
    assert counts_by(dossier, "weather", "collision") == []


def test_every_repeat_of_a_case_is_a_pair_of_its_own(tmp_path: Path) -> None:
    """Eight repeats lost but for the last one: a difference that one pair per point would hide."""
    several = data(["better", "worse"])
    several["matrix"] = {"model": ["better", "worse"], "repeat": list(range(9))}

    def change(case: Any, end: Any) -> Any:
        lost = case.variation.model == "worse" and case.variation.repeat < 8
        return verdict(end, passed=not lost, aeb_dtc_m=20.0, dtc_end_m=5.0)

    (pair,) = of_kind(found(tmp_path, ["better", "worse"], change, several), "systems")
    assert pair.text.startswith("better passed 8 cases that worse lost under the same conditions")
    assert "(of 9 pairs" in pair.text
    assert pair.p_value == pytest.approx(2 / 2**8)
