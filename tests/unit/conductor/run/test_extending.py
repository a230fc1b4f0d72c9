"""``extends``: a campaign file that says only what differs from another one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from conductor.run.source import load
from twin.base.errors import UsageError


def written(folder: Path, name: str, data: Any) -> Path:
    path = folder / name
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def test_sections_replace_those_of_the_other_file_whole(tmp_path: Path) -> None:
    base = load("aeb-demo")
    data = {
        "extends": "aeb-demo",
        "campaign": "mine",
        "matrix": {"weather": ["cloudy"], "model": ["ground_truth"]},
    }
    plan = load(str(written(tmp_path, "mine.yaml", data)))
    assert plan.campaign.campaign == "mine"
    assert plan.campaign.autonomy == base.campaign.autonomy
    assert plan.campaign.camera == base.campaign.camera
    assert {case.variation.weather for case in plan.cases} == {"cloudy"}
    assert {case.variation.campaign for case in plan.cases} == {"mine"}


def test_files_may_build_on_each_other_and_on_files_beside_them(tmp_path: Path) -> None:
    written(tmp_path, "one.yaml", {"extends": "aeb-demo", "campaign": "one", "seed": 5})
    two = {"extends": "one.yaml", "campaign": "two", "description": "second"}
    campaign = load(str(written(tmp_path, "two.yaml", two))).campaign
    assert (campaign.campaign, campaign.seed, campaign.description) == ("two", 5, "second")


def test_a_rulebook_is_the_same_for_another_stack() -> None:
    book, fused = load("un-r152"), load("un-r152-fusion")
    assert fused.campaign.rulebook == book.campaign.rulebook
    assert [case.id for case in fused.cases] == [case.id for case in book.cases]
    assert fused.cases[0].rig.stack == "devkit.fusion:FusionStack"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"extends": "aeb-dmeo", "campaign": "a"}, "extends: aeb-dmeo: .*did you mean 'aeb-demo'"),
        ({"extends": "aeb-demo"}, "campaign: a file that extends 'aeb-demo' needs a name of its"),
        ({"extends": ["aeb-demo"], "campaign": "a"}, "extends: give the name of a shipped"),
        ({"extends": "list.yaml", "campaign": "a"}, "extends: .*list.yaml: no campaign, but a"),
        ({"extends": "self.yaml", "campaign": "a"}, "extends: at most 4 files may build on each"),
        ({"extends": "nowhere/b.yaml", "campaign": "a"}, "extends: nowhere/b.yaml: no such file"),
    ],
)
def test_what_cannot_be_extended_is_told_in_one_line(
    tmp_path: Path, data: dict[str, Any], words: str
) -> None:
    written(tmp_path, "list.yaml", [1, 2])
    with pytest.raises(UsageError, match=words) as told:
        load(str(written(tmp_path, "self.yaml", data)))
    assert "\n" not in str(told.value)
