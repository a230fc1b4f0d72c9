"""What `conductor new` writes runs as it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from processes import outcomes


def said(marked, *words: str, folder: Path, codes: tuple[int, ...] = (0,)) -> str:
    done = marked.run(*words, folder=folder)
    assert done.returncode in codes, (words, done.stdout, done.stderr)
    return done.stdout


def test_a_new_campaign_is_valid_and_runs(marked, tmp_path):
    told = said(marked, "conductor", "new", "campaign", "first", folder=tmp_path)
    steps = [line.split() for line in told.splitlines()[1:]]
    assert [step[:2] for step in steps] == [["conductor", "validate"], ["conductor", "run"]]
    assert "2 cases" in said(marked, *steps[0], folder=tmp_path)
    said(marked, *steps[1], "--workers", "1", folder=tmp_path)
    ended = outcomes(tmp_path / "runs" / "first")
    assert [row["verdict"] for row in ended.values()] == ["pass"]


def test_a_new_stack_conforms_and_drives_a_campaign(marked, tmp_path, monkeypatch):
    said(marked, "conductor", "new", "stack", "near-brake", folder=tmp_path)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    place = "near_brake:NearBrake"
    assert "conforms" in said(marked, "devkit", "check", place, folder=tmp_path)
    new = ("conductor", "new", "campaign", "own", "--stack", place)
    said(marked, *new, folder=tmp_path)
    run = ("conductor", "run", "own.yaml", "--cases", "1", "--workers", "1")
    said(marked, *run, folder=tmp_path, codes=(0, 1))
    row = next(iter(outcomes(tmp_path / "runs" / "own").values()))
    assert row["verdict"] in ("pass", "false_braking"), row


def test_a_new_scenario_is_valid_and_plays(marked, tmp_path):
    said(marked, "conductor", "new", "scenario", "close-cut", folder=tmp_path)
    told = said(marked, "twin", "validate", "scenario", "close-cut.yaml", folder=tmp_path)
    assert "event cut_in" in told
    poses = ("twin", "play", "close-cut.yaml", "--csv", "poses.csv")
    said(marked, *poses, folder=tmp_path)
    assert len((tmp_path / "poses.csv").read_text().splitlines()) > 100


def test_a_new_plugin_is_installed_and_its_test_passes(marked, tmp_path, monkeypatch):
    said(marked, "conductor", "new", "plugin", "tall-boxes", folder=tmp_path)
    site, plugin = tmp_path / "site", tmp_path / "tall-boxes"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    pip += ["--no-deps", "--no-index", "--no-build-isolation", "--target", str(site), str(plugin)]
    done = subprocess.run(pip, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    tests = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]
    done = subprocess.run(tests, capture_output=True, text=True, cwd=plugin)
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
    told = said(marked, "conductor", "validate", "campaign.yaml", folder=plugin)
    assert "2 cases" in told
    run = ("conductor", "run", "campaign.yaml", "--cases", "1", "--workers", "1")
    said(marked, *run, folder=plugin, codes=(0, 1))
    row = next(iter(outcomes(plugin / "runs" / "tall-boxes").values()))
    assert row["outcome"] == "verdict", row


def test_a_second_time_nothing_is_overwritten(marked, tmp_path):
    new = ("conductor", "new", "campaign", "first")
    said(marked, *new, folder=tmp_path)
    (tmp_path / "first.yaml").write_text("mine")
    done = marked.run(*new, folder=tmp_path)
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert (tmp_path / "first.yaml").read_text() == "mine"
