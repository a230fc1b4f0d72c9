"""The row of one's own in the manual of rulebooks is one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from schemas.files.yaml_file import load_yaml
from schemas.kinds.scenario import trial_of
from schemas.plan import parse_plan
from twin.scenario.storyboard.case.checks import target_row
from twin.scenario.storyboard.case.files import load_storyboard

PAGE = (Path(__file__).parents[4] / "docs" / "rulebooks.md").read_text()
SCENARIO, CAMPAIGN = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_the_child_on_a_scooter_can_be_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scooter.yaml").write_text(SCENARIO)
    Path("my-rules.yaml").write_text(CAMPAIGN)
    plan, mistakes = parse_plan(load_yaml(Path("my-rules.yaml")))
    assert plan is not None, mistakes
    assert len(plan.cases) == 12
    assert f"`{plan.cases[8].id}`" in PAGE
    for case in plan.cases:
        scenario = case.variation.scenario
        loaded = load_storyboard(scenario.storyboard, scenario.numbers)
        row = target_row("scooter.yaml", loaded, trial_of(scenario))
        assert loaded.program.entities[loaded.bodies[row]].name == "scooter"
