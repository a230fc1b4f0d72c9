"""The shipped rulebooks of UN R152 against tables and limits worked out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

import conductor.campaigns
from schemas.case import Case
from schemas.files.yaml_file import load_yaml
from schemas.kinds.scenario import trial_of
from schemas.plan import Plan, parse_plan

FOLDER = Path(conductor.campaigns.__file__).parent
LIMITS = {
    ("un-r152", "car-stationary"): {
        "running": {20: 0, 42: 0, 60: 35},
        "max": {20: 0, 40: 0, 60: 35},
    },
    ("un-r152", "car-moving"): {"running": {30: 0, 60: 0}, "max": {30: 0, 60: 0}},
    ("un-r152", "pedestrian"): {"running": {20: 0, 42: 0, 60: 35}, "max": {20: 0, 40: 0, 60: 35}},
    ("un-r152", "bicycle"): {"running": {20: 0, 40: 0, 60: 40}, "max": {20: 0, 38: 0, 60: 40}},
    ("un-r152-n1", "car-stationary"): {
        "running": {20: 0, 42: 0, 60: 35},
        "max": {20: 0, 38: 0, 60: 40},
    },
    ("un-r152-n1", "car-moving"): {"running": {30: 0, 60: 0}, "max": {30: 0, 60: 10}},
    ("un-r152-n1", "pedestrian"): {
        "running": {20: 0, 42: 0, 60: 35},
        "max": {20: 0, 38: 0, 60: 40},
    },
    ("un-r152-n1", "bicycle"): {"running": {20: 0, 40: 0, 60: 40}, "max": {20: 0, 36: 0, 60: 45}},
}
"""Largest relative impact speeds [km/h] of the planned test speeds, by hand. A target at 20 km/h:
the relative speeds are 10 and 40 km/h, whose rows hold."""


def plan_of_shipped(name: str) -> Plan:
    plan, mistakes = parse_plan(load_yaml(FOLDER / f"{name}.yaml"))
    assert plan is not None, mistakes
    return plan


def dangers(plan: Plan) -> list[Case]:
    """Cases in which the stack has to act."""
    return [c for c in plan.cases if trial_of(c.variation.scenario).rule != "no_reaction"]


@pytest.fixture(scope="module", params=["un-r152", "un-r152-n1"])
def shipped(request) -> tuple[str, Plan]:  # type: ignore[no-untyped-def]
    return request.param, plan_of_shipped(request.param)


def test_every_test_speed_has_the_limit_of_the_table(shipped: tuple[str, Plan]) -> None:
    name, plan = shipped
    limits: dict[tuple[str, str], dict[str, dict[int, float]]] = {}
    for case in plan.cases:
        trial = trial_of(case.variation.scenario)
        if trial.rule != "limit":
            continue
        test, _, mass = trial.row.rpartition("-")
        test = test.removesuffix("-20").removesuffix("-30")
        speeds = limits.setdefault((name, test), {}).setdefault(mass, {})
        speeds[round(trial.speed_kmh)] = trial.limit_kmh()
    assert limits == {key: value for key, value in LIMITS.items() if key[0] == name}


@pytest.mark.parametrize(
    ("row", "speed", "limit"),
    [
        ("car-stationary-running", 10, 0),
        ("car-stationary-running", 42, 0),
        ("car-stationary-running", 43, 15),
        ("car-stationary-running", 45.1, 25),
        ("car-stationary-max", 41, 10),
        ("car-stationary-max", 55, 30),
        ("pedestrian-max", 40.5, 10),
        ("pedestrian-running", 50, 25),
        ("bicycle-max", 39, 10),
        ("bicycle-max", 41, 25),
        ("bicycle-running", 52, 35),
    ],
)
def test_the_next_higher_row_holds(row: str, speed: float, limit: float) -> None:
    plan = plan_of_shipped("un-r152")
    rulebook = plan.campaign.rulebook
    trial = rulebook.row(row).trial
    rows = [pair for pair in trial.impact_kmh if pair[0] >= speed]
    assert rows[0][1] == limit
    given = type(trial)(rule="limit", impact_kmh=trial.impact_kmh, speed_kmh=speed)
    assert given.limit_kmh() == limit


def test_limits_never_fall_with_speed_nor_with_mass(shipped: tuple[str, Plan]) -> None:
    _, plan = shipped
    rows = {row.row: row for row in plan.campaign.rulebook.rows if row.trial.rule == "limit"}
    assert len(rows) == 16
    for name, row in rows.items():
        limits = [limit for _, limit in row.trial.impact_kmh]
        assert limits == sorted(limits)
        if name.endswith("-running"):
            heavy = rows[name.removesuffix("running") + "max"].trial.impact_kmh
            assert [at for at, _ in heavy] == [at for at, _ in row.trial.impact_kmh]
            assert all(more >= less for (_, more), less in zip(heavy, limits, strict=True))


def test_shares_of_failures_tolerances_and_conditions(shipped: tuple[str, Plan]) -> None:
    _, plan = shipped
    rulebook = plan.campaign.rulebook
    shares = {name: group.failures_max for name, group in rulebook.groups.items()}
    assert shares == {
        "car": 0.1,
        "pedestrian": 0.1,
        "warning": 0.1,
        "bicycle": 0.2,
        "no-reaction": 0.0,
    }
    assert all(row.repetitions == 2 for row in rulebook.rows)
    for case in dangers(plan):
        scenario = case.variation.scenario
        trial = trial_of(scenario)
        low, high = trial.speed_tolerance_kmh
        assert (low, high) == ((0, 2) if trial.speed_kmh in (20, 30) else (-2, 0))
        driven = scenario.numbers["ego.speed_kmh"]
        assert low <= driven - trial.speed_kmh <= high
        car = trial.row.startswith("car")
        assert trial.light_lux_min == (1000 if car else 2000)
        assert abs(scenario.numbers["ego.offset_m"]) <= trial.lateral_tolerance_m
        assert trial.friction_min == case.variation.environment.friction == 0.9
        heavy = trial.row.endswith("-max")
        assert 586 <= scenario.load_kg <= 711 if heavy else 0 <= scenario.load_kg <= 125
        assert trial.begins_ttc_s == 4.0
        assert scenario.driver == "robot"


def test_two_runs_of_a_point_are_no_copies(shipped: tuple[str, Plan]) -> None:
    _, plan = shipped
    for first, second in zip(plan.cases[::2], plan.cases[1::2], strict=True):
        assert first.id.removesuffix("-r0") == second.id.removesuffix("-r1")
        one, other = first.variation.scenario, second.variation.scenario
        assert one.load_kg != other.load_kg
    for first, second in zip(dangers(plan)[::2], dangers(plan)[1::2], strict=True):
        one, other = first.variation.scenario, second.variation.scenario
        for name in ("ego.speed_kmh", "ego.offset_m"):
            assert one.numbers[name] != other.numbers[name]


def test_rows_with_a_danger_share_a_rig_and_the_others_have_three(
    shipped: tuple[str, Plan],
) -> None:
    _, plan = shipped
    assert {case.rig.scene for case in dangers(plan)} == {"track"}
    scenes = {case.rig.scene for case in plan.cases}
    assert scenes == {"track", "crossroads", "bend", "motorway"}


def test_there_are_four_situations_without_a_reason_to_react(shipped: tuple[str, Plan]) -> None:
    """Of which turning left and turning right are one."""
    _, plan = shipped
    rows = [row for row in plan.campaign.rulebook.rows if row.trial.rule == "no_reaction"]
    assert [row.row.removeprefix("no-reaction-") for row in rows] == [
        *("turn-left", "turn-right", "lead-turns-off", "bend", "construction-site")
    ]
    for row in rows:
        assert (row.group, row.rank, row.clause) == ("no-reaction", "C", "Annex 3, Appendix 2")
        assert "ours" in row.note
        assert row.trial.friction_min == 0.9
        assert row.trial.light_lux_min == 1000
