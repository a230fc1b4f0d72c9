"""``conductor validate`` of files that were made to hurt: one line, exit code 2, nothing is run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

GOOD = "campaign: c\nautonomy: {stack: 'devkit.aeb:AebStack'}\nmatrix: {weather: [clear]}\n"
STACK = "campaign: c\nautonomy: {{stack: '{0}'}}\nmatrix: {{weather: [clear]}}\n"

LIDAR = """\
campaign: c
scenario: {vehicle: ./car.yaml}
autonomy: {stack: 'devkit.aeb:AebStack'}
lidars: [{name: top}]
matrix: {weather: [clear]}
"""


def validate(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "conductor", "validate", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


def test_files_that_are_none_and_tags_that_misfit(tmp_path: Path) -> None:
    """One process for all: the command line itself is not what is tested here."""
    os.mkfifo(tmp_path / "pipe.yaml")
    with (tmp_path / "giant.yaml").open("wb") as file:
        file.truncate(1 << 40)
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    expected = {
        "zero.yaml": "a device",
        "pipe.yaml": "a named pipe",
        "giant.yaml": "bytes, at most",
    }
    for index, value in enumerate(('!!int ""', '!!float ""', "!!bool maybe", "!!timestamp zzz")):
        (tmp_path / f"{index}.yaml").write_text(f"campaign: c\nseed: {value}\n")
        expected[f"{index}.yaml"] = "leave"
    for name, words in expected.items():
        done = validate(tmp_path, name)
        assert done.returncode == 2, done.stderr
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert words in done.stderr
        assert name in done.stderr


@pytest.mark.parametrize("make", ["device", "pipe"])
def test_a_lidar_profile_that_is_no_file(tmp_path: Path, make: str) -> None:
    profile = tmp_path / "profile.yaml"
    if make == "device":
        profile.symlink_to("/dev/zero")
    else:
        os.mkfifo(profile)
    (tmp_path / "car.yaml").write_text("lidars:\n  top: {profile: ./profile.yaml}\n")
    (tmp_path / "c.yaml").write_text(LIDAR)
    done = validate(tmp_path, "c.yaml")
    assert done.returncode == 2, done.stderr
    assert f"profile.yaml: a {'device' if make == 'device' else 'named pipe'}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "stack", ["pkg.sub:X", "pkg:X", "pkg.sub.more:X", "pkg.none:X", "pkg.sub:None", "pkg.again:X"]
)
def test_nothing_of_the_stack_is_imported(tmp_path: Path, stack: str) -> None:
    """Neither its package nor a module on the way, whether they leave by exit code 0 or not."""
    ran = "import pathlib, sys\npathlib.Path('RAN').touch()\nsys.exit(0)\n"
    for folder in ("pkg", "pkg/sub", "pkg/again"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text(ran)
    (tmp_path / "pkg/sub/__init__.py").write_text(
        ran + "class X:\n    def __init__(self, slots): ...\n"
    )
    (tmp_path / "pkg/sub/more.py").write_text(ran + "from pkg.sub import X\n")
    (tmp_path / "pkg/again/__init__.py").write_text(ran + "from ..sub.more import X\n")
    (tmp_path / "c.yaml").write_text(STACK.format(stack))
    done = validate(tmp_path, "c.yaml")
    assert not (tmp_path / "RAN").exists()
    is_there = stack not in ("pkg:X", "pkg.none:X", "pkg.sub:None")
    assert done.returncode == (0 if is_there else 2), done.stderr
    assert "c.yaml: " in done.stdout + done.stderr
