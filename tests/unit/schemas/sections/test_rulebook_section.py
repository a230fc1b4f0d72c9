"""Rows of a rulebook become cases; what is wrong with them is told all at once."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from rulebooks import BRAKING, CROSSING, rulebook_data

from schemas.campaign import cases_given, count_of
from schemas.identity import campaign_digest
from schemas.kinds.scenario import trial_of
from schemas.plan import Plan, parse_plan
from schemas.sections.trial import Trial


def plan_of_data(data: dict[str, Any]) -> Plan:
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    return plan


def lines(data: dict[str, Any]) -> list[str]:
    plan, mistakes = parse_plan(data)
    assert plan is None
    return [mistake.line("file") for mistake in mistakes]


def test_rows_become_cases_in_file_order_with_repetitions_last() -> None:
    plan = plan_of_data(rulebook_data())
    assert [case.id for case in plan.cases] == [
        *(f"braking-ego.speed_kmh_{v}-r{r}" for v in (20, 40, 60) for r in range(3)),
        *(
            f"crossing-actors.cyclist.speed_mps_{bicycle}-ego.speed_kmh_{ego}"
            for ego in (30, 50)
            for bicycle in (4.2, 5.6)
        ),
    ]
    assert len(plan.cases) == count_of(plan.campaign) == cases_given(rulebook_data())


def test_a_case_has_the_file_the_values_and_the_conditions_of_its_row() -> None:
    plan = plan_of_data(rulebook_data())
    case, point = plan.cases[-1], plan.points[-1]
    assert case.variation.scenario.storyboard == "crossing-cyclist"
    numbers = {"ego.speed_kmh": 50, "actors.cyclist.speed_mps": 5.6}
    assert case.variation.scenario.numbers == numbers
    assert case.variation.weather == "heavy_rain"
    assert case.variation.scenario.load_kg == 100
    trial = trial_of(case.variation.scenario)
    assert (trial.row, trial.speed_kmh, trial.limit_kmh()) == ("crossing", 50.0, 35.0)
    assert (point.row, point.values["storyboard.ego.speed_kmh"]) == ("crossing", 50)


def test_every_point_of_a_matrix_has_all_rows() -> None:
    plan = plan_of_data(rulebook_data(BRAKING, matrix={"weather": ["clear", "heavy_fog"]}))
    assert len(plan.cases) == 18 == count_of(plan.campaign)
    assert plan.cases[0].id == "braking-clear-ego.speed_kmh_20-r0"
    assert plan.cases[3].id == "braking-heavy_fog-ego.speed_kmh_20-r0"


def test_zipped_values_go_side_by_side_and_single_ones_with_all() -> None:
    row = {**BRAKING, "zipped": True, "repetitions": 1}
    row["values"] = {"ego.speed_kmh": [20, 40], "actors.lead.ahead_m": [15, 30], "end.after_s": 9}
    cases = plan_of_data(rulebook_data(row)).cases
    pairs = [(20, 15, 9), (40, 30, 9)]
    assert [tuple(case.variation.scenario.numbers.values()) for case in cases] == pairs


def test_the_first_run_is_as_written_and_others_draw_within_their_range() -> None:
    cases = plan_of_data(rulebook_data(BRAKING)).cases
    for first in range(0, 9, 3):
        written, *drawn = cases[first : first + 3]
        speed = written.variation.scenario.numbers["ego.speed_kmh"]
        assert speed in (20, 40, 60)
        assert trial_of(written.variation.scenario).written == {}
        speeds = [case.variation.scenario.numbers["ego.speed_kmh"] for case in drawn]
        assert len({speed, *speeds}) == 3, "a copy of a run is no repetition"
        assert all(abs(value - speed) <= 1.0 for value in speeds)
        for case in drawn:
            trial = trial_of(case.variation.scenario)
            assert trial.written == {"storyboard.ego.speed_kmh": speed}
            assert trial.speed_kmh == speed, "tolerances are those of the planned speed"


def test_another_seed_draws_other_values() -> None:
    plan = plan_of_data(rulebook_data(BRAKING))
    other = plan.amended(msgspec.structs.replace(plan.campaign, seed=8))
    again = plan_of_data(rulebook_data(BRAKING, seed=8))
    assert other.cases == again.cases
    assert [case.id for case in other.cases] == [case.id for case in plan.cases]
    drawn = [
        [case.variation.scenario.numbers["ego.speed_kmh"] for case in each.cases]
        for each in (plan, other)
    ]
    assert [one == two for one, two in zip(*drawn, strict=True)] == [True, False, False] * 3


def test_an_axis_may_be_varied_too() -> None:
    row = {**CROSSING, "repetitions": 2, "varied": {"scenario.load_kg": [-50, 50]}}
    cases = plan_of_data(rulebook_data(row)).cases
    loads = [case.variation.scenario.load_kg for case in cases]
    assert loads[::2] == [100] * 4
    assert all(50 <= load <= 150 and load != 100 for load in loads[1::2])
    assert trial_of(cases[1].variation.scenario).written == {"scenario.load_kg": 100}


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        (["crossing"], ["crossing"]),
        (["CARS"], ["braking"]),
        (["Crossing cyclist", "braking"], ["braking", "crossing"]),
    ],
)
def test_rows_are_called_by_name_group_or_test(words: list[str], rows: list[str]) -> None:
    plan = plan_of_data(rulebook_data())
    chosen = plan.rows(words)
    assert [*dict.fromkeys(point.row for point in chosen.points)] == rows
    assert chosen.cases == [c for c in plan.cases if trial_of(c.variation.scenario).row in rows]


def test_tags_of_groups_choose_their_rows() -> None:
    data = rulebook_data()
    groups = [data["rulebook"]["groups"][row["group"]] for row in data["rulebook"]["rows"][:1]]
    groups[0]["tags"] = ["standard", "city"]
    plan = plan_of_data(data)
    first = data["rulebook"]["rows"][0]["group"]
    for words in (["standard"], ["City"], ["city", first]):
        assert plan.rows(words).cases == plan.rows([first]).cases
    with pytest.raises(ValueError, match=r"tag 'standart'; did you mean 'standard'"):
        plan.rows(["standart"])


def test_quick_takes_the_first_and_the_last_point_of_each_row_once() -> None:
    plan = plan_of_data(rulebook_data())
    ids = [case.id for case in plan.quick().cases]
    assert ids == [plan.cases[index].id for index in (0, 6, 9, 12)]
    single = {**BRAKING, "values": {"ego.speed_kmh": 30}}
    assert [case.id for case in plan_of_data(rulebook_data(single)).quick().cases] == ["braking-r0"]


def test_quick_takes_them_for_each_value_of_a_matrix() -> None:
    data = rulebook_data(BRAKING, matrix={"weather": ["clear", "heavy_snow"]})
    ids = [
        "braking-clear-ego.speed_kmh_20-r0",
        "braking-heavy_snow-ego.speed_kmh_20-r0",
        "braking-clear-ego.speed_kmh_60-r0",
        "braking-heavy_snow-ego.speed_kmh_60-r0",
    ]
    plan = plan_of_data(data)
    assert [case.id for case in plan.quick().cases] == ids
    assert [case.id for case in plan.rows(["braking"]).quick().cases] == ids


def test_what_was_chosen_is_a_campaign_of_the_same_cases() -> None:
    plan = plan_of_data(rulebook_data())
    for chosen in (plan.quick(), plan.rows(["crossing"]), plan.first(5)):
        again = plan_of_data(msgspec.to_builtins(chosen.campaign))
        assert again.cases == chosen.cases
        assert len(chosen.cases) == count_of(chosen.campaign)
    one = plan.only("braking-ego.speed_kmh_40-r2")
    assert one is not None
    assert one.cases == [case for case in plan.cases if case.id == "braking-ego.speed_kmh_40-r2"]


def test_nobody_is_called_so_in_one_line() -> None:
    plan = plan_of_data(rulebook_data())
    with pytest.raises(
        ValueError, match=r"^no row, group, test or tag 'brakin'; did you mean 'braking'"
    ):
        plan.rows(["crossing", "brakin"])
    plain = {**rulebook_data(), "matrix": {"weather": ["clear"]}}
    del plain["rulebook"]
    for choose in (plan_of_data(plain).quick, lambda: plan_of_data(plain).rows(["braking"])):
        with pytest.raises(ValueError, match="no rulebook"):
            choose()


def test_all_mistakes_are_told_at_once() -> None:
    row = {
        **BRAKING,
        "group": "lorries",
        "conditions": {"wether": "clear", "repeat": 2, "storyboard.end.after_s": 9},
        "varied": {"ego.speed_kmh": [1, -1], "actors.lead.speed_mps": [0, 1]},
    }
    first, *rest = lines(rulebook_data(row, row, matrix={"row": ["braking"]}))
    told = [first, *rest]
    for words in (
        "rulebook.rows[1].row: 'braking' is the name of another row",
        "rulebook.rows[0].group: no group 'lorries'",
        "rulebook.rows[0].conditions.wether: unknown axis; did you mean 'weather'",
        "rulebook.rows[0].conditions.repeat: no condition; give repetitions",
        "rulebook.rows[0].conditions.storyboard.end.after_s: a number of the file",
        "rulebook.rows[0].varied.ego.speed_kmh: given [1, -1]; the lower first",
        "rulebook.rows[0].varied.actors.lead.speed_mps: neither one of `values`",
        "matrix.row: the rows of the rulebook say it",
    ):
        assert any(words in line for line in told), (words, told)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trial": {"rule": "avoid", "speed_number": "ego.v"}}, "trial.speed_kmh: missing"),
        ({"trial": {"rule": "avoid", "impact_kmh_max": 5}}, "belong to rule limit"),
        ({"trial": {"rule": "limit", "impact_kmh": [[20, 0], [40, 10]]}}, "its last speed is 40"),
        ({"trial": {"rule": "limit", "impact_kmh": [[40, 0], [20, 0]]}}, "speeds must rise"),
        ({"trial": {"rule": "avoid", "speed_tolerance_kmh": [1, 2]}}, "with 0 between them"),
        ({"trial": {"rule": "avert"}}, "given 'avert', allowed: avoid"),
        ({"values": {"ego.speed_kmh": []}}, "an empty list"),
        ({"values": {"ego.speed_kmh": [20, 20]}}, "a value appears twice"),
        (
            {"values": {"ego.speed_kmh": [20, 30], "a.b_m": [1, 2, 3]}, "zipped": True},
            "equally long, given ego.speed_kmh 2, a.b_m 3",
        ),
        ({"varied": {"scenario.load_kg": [-1, 1]}}, "scenario.load_kg: neither"),
        ({"conditions": {"scenario.load_kg": 0}, "varied": {"scenario.load_kg": [-1, 1]}}, ">= 0"),
        ({"repetitions": 0}, ">= 1"),
    ],
)
def test_a_mistake_of_a_row_is_told_with_its_place(changes: dict[str, Any], words: str) -> None:
    told = lines(rulebook_data({**BRAKING, **changes}))
    assert any(words in line and "rulebook.rows[0]" in line for line in told), told


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenario": {"type": "jump_scare"}}, "scenario.type: jump_scare has no trials"),
        (
            {
                "scenario": {
                    "type": "storyboard",
                    "storyboard": "braking-lead",
                    "trial": {"rule": "avoid"},
                }
            },
            "scenario.trial: the rows of the rulebook have trials",
        ),
        ({"matrix": {"weather": ["clear"]}}, "matrix.weather: row 'crossing'"),
        ({"cases": [{"row": "crosing"}]}, "did you mean 'crossing'"),
        ({"cases": [{"weather": "clear"}]}, "cases[0].row: missing"),
        ({"cases": [{"row": "braking"}], "matrix": {"weather": ["clear"]}}, "not both"),
    ],
)
def test_a_mistake_beside_the_rows_is_told(changes: dict[str, Any], words: str) -> None:
    told = lines(rulebook_data(**changes))
    assert any(words in line for line in told), told


def test_a_row_is_no_axis_of_a_campaign_without_a_rulebook() -> None:
    data = rulebook_data(matrix={"row": ["braking"]})
    del data["rulebook"]
    assert "file: matrix.row: unknown axis" in lines(data)[0]


def test_a_campaign_without_a_rulebook_is_as_it_was() -> None:
    data = {**rulebook_data(), "matrix": {"weather": ["clear"]}}
    del data["rulebook"]
    plan = plan_of_data(data)
    assert b"rulebook" not in msgspec.json.encode(plan.campaign)
    assert b"trial" not in msgspec.json.encode(plan.cases[0])
    with_it = plan_of_data(rulebook_data())
    assert campaign_digest(plan.campaign, plan.cases) != campaign_digest(
        with_it.campaign, with_it.cases
    )


TABLE = [[10, 0], [40, 0], [42, 10], [45, 15], [60, 35]]


@pytest.mark.parametrize(
    ("speed", "limit"), [(10, 0), (40, 0), (40.1, 10), (42, 10), (44, 15), (46, 35), (60, 35)]
)
def test_the_next_higher_row_of_a_table_holds(speed: float, limit: float) -> None:
    assert Trial(rule="limit", impact_kmh=TABLE, speed_kmh=speed).limit_kmh() == limit


def test_a_table_of_relative_speeds_is_read_at_the_planned_one() -> None:
    trial = Trial(rule="limit", impact_kmh=TABLE, speed_kmh=62.0, target_speed_kmh=20.0)
    assert trial.limit_kmh() == 35
    relative = msgspec.structs.replace(trial, table_speed="relative")
    assert (relative.closing_kmh, relative.limit_kmh()) == (42.0, 10)
