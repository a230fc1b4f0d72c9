"""Data that the fusion stack was tuned on are in no shipped campaign."""

from __future__ import annotations

from pathlib import Path

import yaml
from msgspec import UNSET

import devkit.fusion
from conductor.run.source import load, shipped

FOLDER = Path(devkit.fusion.__file__).parent / "tuning"
SPLIT = yaml.safe_load((FOLDER / "split.yaml").read_text())
SCENES = Path(devkit.fusion.__file__).parents[2] / "twin/world/scenes"


def test_the_split_names_all_that_lies_in_its_folder():
    files = {path.name for path in FOLDER.glob("*.yaml")} - {"split.yaml", "draws.yaml"}
    assert files == {*SPLIT["campaigns"], *SPLIT["scenes"]}


def test_seeds_and_streets_of_tuning_are_in_no_shipped_campaign():
    campaigns = {name: load(name) for name in shipped()}
    assert {"aeb-256", "aeb-256-fusion"} <= set(campaigns)
    for name in SPLIT["campaigns"]:
        tuning = yaml.safe_load((FOLDER / name).read_text())
        assert tuning["seed"] in SPLIT["seeds"]
        scene = tuning["scenario"].get("scene")
        assert scene is None or Path(scene).name in SPLIT["scenes"]
    for plan in campaigns.values():
        assert plan.campaign.seed not in SPLIT["seeds"]
        for case in plan.cases:
            assert Path(case.rig.scene).name not in SPLIT["scenes"]


def test_tuning_streets_are_others_than_the_shipped_ones():
    shipped_scenes = [yaml.safe_load(path.read_text()) for path in SCENES.glob("*.yaml")]
    assert len(shipped_scenes) >= 3
    for name in SPLIT["scenes"]:
        street = yaml.safe_load((FOLDER / name).read_text())
        for other in shipped_scenes:
            for key in ("scene", "seed", "objects", "obstacle"):
                assert street[key] != other.get(key)


def test_situations_of_tuning_are_in_no_rulebook():
    tuning = load(str(FOLDER / "situations.yaml")).cases
    files = {Path(case.variation.scenario.storyboard) for case in tuning}
    assert files == {Path("devkit/fusion/tuning", SPLIT["scenarios"], f.name) for f in files}
    assert {f.name for f in (FOLDER / SPLIT["scenarios"]).iterdir()} == {f.name for f in files}
    books = [plan for name in shipped() if (plan := load(name)).campaign.rulebook is not UNSET]
    assert len(books) >= 8
    for plan in books:
        assert plan.campaign.seed not in SPLIT["seeds"]
        assert not {Path(case.variation.scenario.storyboard) for case in plan.cases} & files
