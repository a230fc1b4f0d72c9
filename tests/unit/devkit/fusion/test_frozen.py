"""Streets drawn from the commit that froze the stack."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from conductor.run.source import load
from devkit.fusion import frozen
from twin.world.scene import load_scene
from twin.world.sky.environment import CaseEnvironment

COMMIT = "a" * 40
OTHER = "b" * 40


def test_a_commit_gives_the_same_streets_and_another_one_others(tmp_path: Path) -> None:
    one, again, other = (tmp_path / name for name in ("one", "again", "other"))
    for folder, commit in ((one, COMMIT), (again, COMMIT), (other, OTHER)):
        frozen.write(commit, folder, quick=False)
    for n in range(1, 9):
        street = (one / f"frozen-{n}.yaml").read_text()
        assert street == (again / f"frozen-{n}.yaml").read_text()
        assert street != (other / f"frozen-{n}.yaml").read_text()
    assert frozen.seed_of(COMMIT) == 0xE33CDF9C
    assert frozen.seed_of(OTHER) != frozen.seed_of(COMMIT)


def test_the_campaign_has_256_cases_of_the_fusion_stack(tmp_path: Path) -> None:
    plan = load(str(frozen.write(COMMIT, tmp_path, quick=False)))
    assert len(plan.cases) == 256
    assert plan.campaign.seed == frozen.seed_of(COMMIT)
    assert {case.rig.stack for case in plan.cases} == {"devkit.fusion:FusionStack"}
    assert len({case.rig.scene for case in plan.cases}) == frozen.STREETS
    assert {case.variation.scenario.ego_start_m for case in plan.cases} == {148}


def test_no_wind_carries_a_car_that_holds_its_wheel_straight(tmp_path: Path) -> None:
    for case in load(str(frozen.write(COMMIT, tmp_path, quick=True))).cases:
        weather = CaseEnvironment(case, load_scene(case.rig.scene).origin).at(0)[0]
        assert weather.wind_mps == weather.gust_mps == 0.0


def test_a_quick_one_has_every_street_weather_and_model(tmp_path: Path) -> None:
    cases = load(str(frozen.write(COMMIT, tmp_path, quick=True))).cases
    assert len({case.rig.scene for case in cases}) == len(cases) == 8
    assert len({case.variation.weather for case in cases}) == 8
    assert {case.variation.model for case in cases} == set(frozen.MODELS)


def test_a_short_name_of_a_commit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give 40 hexadecimal digits"):
        frozen.write("abc", tmp_path, quick=False)


def test_a_draw_is_listed_once(tmp_path: Path) -> None:
    draws = tmp_path / "draws.yaml"
    draws.write_text("# All.\ndraws: []\n")
    assert frozen.enter(COMMIT, draws)
    assert frozen.enter(OTHER, draws)
    assert not frozen.enter(COMMIT, draws)
    listed = yaml.safe_load(draws.read_text())["draws"]
    assert [entry["commit"] for entry in listed] == [COMMIT, OTHER]


def test_listed_draws_follow_from_their_commits() -> None:
    listed = yaml.safe_load(frozen.DRAWS.read_text())["draws"]
    commits = [entry["commit"] for entry in listed]
    assert len(commits) == len(set(commits))
    for entry in listed:
        assert frozen.COMMIT.fullmatch(entry["commit"])
        assert entry["seed"] == frozen.seed_of(entry["commit"])
        assert entry["result"]


def test_every_street_that_can_be_drawn_is_one(tmp_path: Path) -> None:
    for number in range(40):
        draw = frozen.Draw(f"{number:040x}")
        file = tmp_path / "frozen-1.yaml"
        file.write_text(yaml.safe_dump(frozen.street(draw, 1)), "utf-8")
        scene = load_scene(str(file))
        assert len(scene.objects) == 4, f"commit {number:040x}"
