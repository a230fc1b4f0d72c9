"""``--axis`` and ``--set``: a campaign with other values than its file says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from conductor.cli import app
from conductor.run.changes import typed_changes
from conductor.run.source import load
from schemas.identity import campaign_digest
from twin.base.errors import UsageError

FILE: dict[str, Any] = {
    "campaign": "mine",
    "camera": {"width": 640, "height": 360},
    "matrix": {"weather": ["clear", "cloudy"], "repeat": [0, 1]},
}


def written(folder: Path, **changes: Any) -> str:
    path = folder / "mine.yaml"
    path.write_text(json.dumps({**FILE, **changes}))
    return str(path)


def said(folder: Path, axes: list[str], settings: list[str], **options: Any) -> str:
    with pytest.raises(UsageError) as refused:
        load(written(folder), changes=typed_changes(axes, settings), **options)
    return str(refused.value)


def test_a_changed_campaign_has_the_digests_of_a_file_that_says_so(tmp_path: Path) -> None:
    typed = load(
        written(tmp_path),
        changes=typed_changes(
            ["weather=heavy_fog", "time_of_day=05:00, 12:00"],
            ["camera.width=320", "deadline_s=90", "autonomy={stack: devkit.idle:IdleStack}"],
        ),
    )
    file = load(
        written(
            tmp_path,
            camera={"width": 320, "height": 360},
            deadline_s=90,
            autonomy={"stack": "devkit.idle:IdleStack"},
            matrix={"weather": ["heavy_fog"], "repeat": [0, 1], "time_of_day": ["05:00", "12:00"]},
        )
    )
    assert typed.campaign == file.campaign
    assert [case.id for case in typed.cases] == [case.id for case in file.cases]
    assert len(typed.cases) == 4
    digests = [campaign_digest(plan.campaign, plan.cases) for plan in (typed, file)]
    assert digests[0] == digests[1]
    plain = load(written(tmp_path))
    assert digests[0] != campaign_digest(plain.campaign, plain.cases)


@pytest.mark.parametrize(
    ("axes", "settings", "words"),
    [
        (["weather"], [], "--axis 'weather': expected NAME=V1,V2, e.g. weather=clear,heavy_fog"),
        (["=clear"], [], "--axis '=clear': expected NAME=V1,V2"),
        (["weather= "], [], "--axis 'weather= ': expected NAME=V1,V2"),
        (["weather=clear", "weather=cloudy"], [], "--axis weather: is given twice; give it once"),
        (["weather=clear]"], [], "--axis weather:1:"),
        (["wether=clear"], [], "--axis wether: unknown axis; did you mean 'weather'?"),
        (["weather=cler"], [], "--axis weather: given 'cler'; did you mean 'clear'?"),
        (["weather=~"], [], "--axis weather: given nothing"),
        ([], ["camera.width"], "--set 'camera.width': expected PATH=VALUE, e.g. camera.width=320"),
        ([], ["camera.width="], "--set 'camera.width=': expected PATH=VALUE"),
        ([], ["seed=1", "seed=2"], "--set seed: is given twice; give it once"),
        ([], ["description={a"], "--set description:1:"),
        ([], ["description=a: b"], "--set description: given {'a': 'b'}, allowed: text"),
        ([], ["camera.widht=3"], "--set camera.widht: unknown key"),
        ([], ["camera.width=wide"], "--set camera.width: given 'wide'"),
        ([], ["camera={width: 0}"], "--set camera.width: given 0"),
        ([], ["campaign.x=3"], "--set: 'campaign.x': 'campaign' is a value and has no keys"),
        (
            [],
            ["camera.width=320", "camera={height: 90}"],
            "--set camera.width: --set camera replaces it; give one of them",
        ),
        (
            ["weather=clear"],
            ["matrix.weather=[cloudy]"],
            "--set matrix.weather: --axis weather replaces it; give one of them",
        ),
        ([], [".x=3"], "--set: '.x': expected the path of a key"),
    ],
)
def test_a_change_that_cannot_be_made_is_one_line(
    tmp_path: Path, axes: list[str], settings: list[str], words: str
) -> None:
    line = said(tmp_path, axes, settings)
    assert line.startswith(words)
    assert len(line.splitlines()) == 1


def test_what_an_option_sets_is_not_changed_too(tmp_path: Path) -> None:
    line = "--weather and --axis weather say the same; give one of them"
    assert said(tmp_path, ["weather=clear"], [], weather="all") == line
    line = "--weather and --set matrix.weather say the same; give one of them"
    assert said(tmp_path, [], ["matrix.weather=[clear]"], weather="all") == line
    line = "--seed and --set seed say the same; give one of them"
    assert said(tmp_path, [], ["seed=3"], seed=4) == line
    line = "--render and --set render say the same; give one of them"
    assert said(tmp_path, [], ["render=false"], render=True) == line


def test_a_campaign_of_listed_cases_has_no_axes(tmp_path: Path) -> None:
    path = tmp_path / "listed.yaml"
    path.write_text(json.dumps({"campaign": "listed", "cases": [{"weather": "clear"}]}))
    with pytest.raises(UsageError, match=r"^--axis: .*listed.yaml lists its cases; [^\n]*$"):
        load(str(path), changes=typed_changes(["weather=clear"], []))


def test_validate_lists_the_changed_cases_and_refuses_with_2(tmp_path: Path) -> None:
    words = ["validate", written(tmp_path), "--output", "json"]
    done = CliRunner().invoke(app, [*words, "--axis", "weather=heavy_fog", "--set", "deadline_s=7"])
    assert done.exit_code == 0
    shown = json.loads(done.stdout)
    assert len(shown["cases"]) == 2
    assert all("heavy_fog" in case for case in shown["cases"])
    assert shown["deadline_s"] == 7
    done = CliRunner().invoke(app, [*words, "--axis", "weather"])
    assert done.exit_code == 2
    assert json.loads(done.stdout)["mistakes"] == [
        "--axis 'weather': expected NAME=V1,V2, e.g. weather=clear,heavy_fog"
    ]
