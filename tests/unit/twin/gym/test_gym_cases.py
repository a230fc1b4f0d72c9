"""Which case an environment runs when, and which campaigns it takes."""

import pytest

from schemas.files.yaml_file import dump_yaml
from twin.base.errors import UsageError
from twin.gym.episode_cases import read_cases

SMALL = {
    "scenario": {"type": "lane_keeping", "scene": "downtown-loop", "distance_m": 20},
    "matrix": {"weather": ["clear", "light_rain", "light_snow"]},
    "seed": 5,
}


def written(folder, **changes):
    path = folder / "small.yaml"
    path.write_text(dump_yaml({"campaign": "small", **SMALL, **changes}))
    return path


def names(cases, seed, episodes):
    return [cases.of(seed, episode).variation.weather for episode in range(episodes)]


def test_the_first_pass_is_the_campaign_with_that_seed(tmp_path):
    cases = read_cases(written(tmp_path))
    assert cases.seed == 5
    assert names(cases, 5, 3) == ["clear", "light_rain", "light_snow"]
    assert [cases.of(5, k) for k in range(3)] == cases.cases
    assert {cases.of(9, k).variation.seed for k in range(3)} == {9}


def test_neighbouring_seeds_begin_with_neighbouring_cases(tmp_path):
    cases = read_cases(written(tmp_path))
    assert names(cases, 6, 3) == ["light_rain", "light_snow", "clear"]
    assert names(cases, 4, 3) == ["light_snow", "clear", "light_rain"]


def test_every_pass_has_a_seed_of_its_own(tmp_path):
    cases = read_cases(written(tmp_path))
    seeds = {(seed, cases.of(seed, k).variation.seed) for seed in (5, 6) for k in range(9)}
    drawn = [seed for _, seed in seeds]
    assert len(drawn) == len(set(drawn)) == 6
    assert all(0 <= seed < 2**63 for seed in drawn)
    assert cases.of(5, 3) == cases.of(5, 3)


def test_a_first_case_that_was_asked_for(tmp_path):
    cases = read_cases(written(tmp_path))
    name = cases.cases[2].id
    assert cases.of(6, 0, cases.number(name)).id == name
    assert cases.of(6, 1, cases.number(name)).id == cases.cases[0].id
    with pytest.raises(UsageError, match="case 'nowhere': the environment has none of that name"):
        cases.number("nowhere")


def test_rows_of_a_rulebook_are_drawn_by_the_seed_of_the_environment():
    cases = read_cases("fmvss-127")
    same, other = cases.of(cases.seed, 3), cases.of(cases.seed + 1, 0, 3)
    assert same == cases.cases[3]
    assert other.id == same.id
    assert other.variation.seed == cases.seed + 1


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"simulator": "noop"}, "simulator 'noop' given, allowed: warp"),
        ({"clock": "realtime"}, "clock 'realtime' given, allowed: lockstep"),
        ({"matrix": {"weather": ["hail"]}}, "matrix.weather"),
        (
            {"matrix": {"scenario.scene": ["downtown", "downtown-loop"]}},
            "need several worlds, vehicles or sets of sensors",
        ),
    ],
)
def test_campaigns_that_no_environment_can_run(tmp_path, changes, problem):
    with pytest.raises(UsageError, match=problem) as told:
        read_cases(written(tmp_path, **changes))
    assert "\n" not in str(told.value)


def test_searches_and_names_that_are_not_there(tmp_path):
    with pytest.raises(UsageError, match="a search proposes its cases from results"):
        read_cases("aeb-search")
    with pytest.raises(UsageError, match="lane-lop: neither a shipped campaign nor a file; did"):
        read_cases("lane-lop")
    with pytest.raises(UsageError, match="no case 'nowhere'"):
        read_cases(written(tmp_path), cases=["nowhere"])


def test_settings_and_chosen_cases(tmp_path):
    path = written(tmp_path)
    chosen = read_cases(path).cases[1].id
    cases = read_cases(path, {"control_hz": 100}, [chosen])
    assert [case.id for case in cases.cases] == [chosen]
    assert cases.cases[0].rig.control_hz == 100
    assert names(cases, 7, 2) == ["light_rain", "light_rain"]
    with pytest.raises(UsageError, match="control_hz"):
        read_cases(path, {"control_hz": "often"})


def test_a_campaign_that_extends_another(tmp_path):
    written(tmp_path)
    path = tmp_path / "more.yaml"
    path.write_text(dump_yaml({"extends": "small.yaml", "campaign": "more", "seed": 8}))
    assert read_cases(path).seed == 8
