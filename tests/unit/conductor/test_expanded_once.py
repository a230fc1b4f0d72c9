"""A campaign is expanded once per command: its cases travel with it as a plan."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner
from unit.conductor.report.autodrive_logs import write_logs
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

import schemas.plan
from schemas import SCHEMA_VERSION
from schemas.files.drive_record import RecordHead, RecordSeen
from schemas.files.yaml_file import dump_yaml
from schemas.plan import parse_plan
from twin.records.drive_record import RecordWriter

MATRIX = {"model": ["truth"], "weather": ["clear", "heavy_fog"], "repeat": [0, 1]}
OWN = {"scenario": {"scene": "own.yaml"}, "objects": {"walker": {"speed_mps": 2.0}}}
SCENE = {
    "schema": 1,
    "scene": "own",
    "objects": [
        {"kind": "pedestrian", "name": "walker", "waypoints": [[9, 9], [9, 0]], "speed_mps": 1}
    ],
}

ONCE = [
    ("conductor", "validate", "c.yaml"),
    ("conductor", "validate", "c.yaml", "--output", "json"),
    ("conductor", "validate", "own-scene.yaml"),
    ("conductor", "report", "run"),
    ("conductor", "report", "run", "--markdown", "page.md"),
    ("conductor", "export", "run", "--format", "csv", "--out", "csv"),
    ("conductor", "export", "run", "--out", "logs"),
    ("twin", "memory", "--campaign", "c.yaml"),
    ("twin", "judge", "run"),
    ("devkit", "check", "c.yaml", "--ticks", "15"),
]

NEVER = [
    ("conductor", "fingerprint", "run"),
    ("twin", "validate", "scene", "own.yaml"),
]
"""They ask nothing that only the cases know."""


@pytest.fixture
def expanded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the campaigns that were expanded, each time one was."""
    names: list[str] = []
    real = schemas.plan.points_of

    def counted(campaign: Any) -> Any:
        names.append(campaign.campaign)
        return real(campaign)

    monkeypatch.setattr(schemas.plan, "points_of", counted)
    return names


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with campaign files, a scene, and what runs have left."""
    variant = {"truth": {"type": "ground_truth"}}
    stack = {"stack": "devkit.idle:IdleStack", "perception": variant}
    data = {"campaign": "c", "autonomy": stack, "matrix": MATRIX}
    files = {
        "c": data,
        "own-scene": {**data, **OWN},
        "own": SCENE,
        "noop": {**data, "campaign": "noop", "simulator": "noop"},
    }
    for name, content in files.items():
        (tmp_path / f"{name}.yaml").write_text(dump_yaml(content))
    few = campaign_data(matrix={"model": ["yolov3"], "weather": ["clear", "heavy_fog"]})
    for name in ("run", "later"):
        # Texts of their own: what was read of equal ones is known.
        make_campaign(tmp_path / name, {**few, "description": f"{tmp_path} {name}"})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def exit_code(*words: str) -> int:
    """Run a command in this process."""
    app = importlib.import_module(f"{words[0]}.cli").app
    done = CliRunner().invoke(app, list(words[1:]))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code


@pytest.mark.parametrize("words", ONCE, ids=" ".join)
def test_once(words: tuple[str, ...], home: Path, expanded: list[str]) -> None:
    assert exit_code(*words) in (0, 1, 3)  # no judge confirms what point masses did
    assert len(expanded) == 1


def test_a_comparison_expands_each_of_its_two_files(home: Path, expanded: list[str]) -> None:
    assert exit_code("conductor", "compare", "run", "later") == 0
    assert len(expanded) == 2


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--seed", "9"),
        ("--case", "truth-clear-repeat_1"),
        ("--cases", "2", "--render", "off", "--record-drive", "--view", "record"),
    ],
    ids=" ".join,
)
def test_a_run_expands_it_and_its_conductor_what_is_submitted(
    options: tuple[str, ...], home: Path, expanded: list[str]
) -> None:
    """A conductor knows of a campaign what the message says, whoever sends it."""
    words = ("conductor", "run", "noop.yaml", "--out", "out", "--workers", "1", *options)
    assert exit_code(*words) == 0
    assert expanded == ["noop", "noop"]


@pytest.mark.slow
def test_logs_of_a_study_are_expanded_when_they_become_a_campaign_and_when_it_is_read(
    home: Path, expanded: list[str]
) -> None:
    write_logs(home / "logs")
    assert exit_code("conductor", "report", "--import-autodrive", "logs", "--out", "own") in (0, 1)
    assert len(expanded) == 2


def test_a_replay_expands_the_campaign_of_its_stack(home: Path, expanded: list[str]) -> None:
    plan, _ = parse_plan({"campaign": "r", "matrix": {"weather": ["clear", "cloudy"]}})
    assert plan is not None
    for case in plan.cases:
        path = home / f"cases/{case.id}/attempt-1/drive.record"
        writer = RecordWriter(path, RecordHead(SCHEMA_VERSION, 1, "", "cpu", 1, case))
        writer.write(RecordSeen(tick=0, sim_time_ns=0, sensors={}))
        writer.close()
    expanded.clear()
    assert exit_code("devkit", "replay", ".", "--stack", "c.yaml") in (0, 1)
    assert expanded == ["c"]


@pytest.mark.parametrize("words", NEVER, ids=" ".join)
def test_never(words: tuple[str, ...], home: Path, expanded: list[str]) -> None:
    assert exit_code(*words) == 0
    assert not expanded
