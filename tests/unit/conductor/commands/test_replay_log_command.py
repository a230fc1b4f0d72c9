"""``conductor replay-log`` as people type it: what it writes and says, and what it refuses."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from ros2_recordings import circle_rows, write_bag

from schemas.files.yaml_file import load_yaml


def replay_log(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "conductor", "replay-log", *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "bag", circle_rows())


def test_folder_of_a_recording(bag, tmp_path):
    out = tmp_path / "drive"
    done = replay_log(str(bag), "-o", str(out), "--from", "1.5", "--output", "json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["ego"], told["objects"], told["actors"]) == (
        *("/odom", "/tracks"),
        {"car_1": "6c656164000000000000000000000000"},
    )
    assert told["duration_s"] == pytest.approx(2.4)
    assert sorted(path.name for path in out.iterdir()) == [
        *("campaign.yaml", "road.xodr", "scenario.yaml"),
    ]
    assert load_yaml(out / "scenario.yaml")["ego"]["poses"][0][0] == 0
    again = replay_log(str(bag), "-o", str(out))
    assert again.returncode == 2
    assert "it exists; give a folder that does not, with -o" in again.stderr


def test_nothing_stays_of_what_does_not_fit_on_the_disk(bag, tmp_path):
    """A file of the folder cannot be written: the same command may be given again."""
    (tmp_path / "own").mkdir()
    limited = 'ulimit -f 1; exec "$@"'
    words = [sys.executable, "-m", "conductor", "replay-log", str(bag), "-o", "drive"]
    done = subprocess.run(
        ["bash", "-c", limited, "bash", *words],
        cwd=tmp_path / "own",
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert done.stderr.splitlines()[-1].endswith("drive: File too large")
    assert list((tmp_path / "own").iterdir()) == []


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--from", "3.85"), "the ego is recorded from 0 to 3.9 s"),
        (("--from", "3", "--to", "2"), "--to 2: it must be after --from 3"),
        (("--from", "nan"), "--from"),
        (("--ego", "/tracks"), "no topic /tracks of type nav_msgs/msg/Odometry; there: /odom"),
        (("--road", "moon"), "road 'moon' is not shipped"),
    ],
)
def test_mistakes_are_a_line_and_exit_code_2(bag, tmp_path, words, line):
    done = replay_log(str(bag), "-o", str(tmp_path / "drive"), *words)
    assert done.returncode == 2, done.stderr
    assert line in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "drive").exists()
