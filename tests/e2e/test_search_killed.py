"""A search whose process is killed goes on as if it had not been."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from search_bench import searched, trace
from search_victim import SEARCH

KILLS = 12
ENVIRONMENT = {"PYTHONPATH": os.pathsep.join(str(Path(__file__).parents[i]) for i in (0, 1, 2))}


def _victim(folder: Path, seed: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, str(Path(__file__).with_name("search_victim.py")), str(folder)]
    return subprocess.Popen(
        [*command, str(seed)], stdout=subprocess.PIPE, env={**os.environ, **ENVIRONMENT}
    )


@pytest.mark.slow
def test_kills_leave_the_same_trace(tmp_path: Path) -> None:
    numbers = random.Random(7)
    killed = 0
    for seed in range(KILLS):
        victim = _victim(tmp_path, seed)
        assert victim.stdout is not None
        for _ in range(numbers.randint(2, 14)):
            victim.stdout.readline()
        victim.send_signal(signal.SIGKILL)
        victim.stdout.close()
        killed += victim.wait() == -signal.SIGKILL
        if (tmp_path / "trace.json").exists():
            break
    assert killed > 3
    last = _victim(tmp_path, 99)
    _, _ = last.communicate(timeout=600)
    assert last.returncode == 0
    found = (tmp_path / "trace.json").read_bytes()
    assert found == trace(searched(SEARCH, workers=2, slots=3).state)
