"""A search whose process is killed again and again goes on as if it had not been."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from search_bench import searched, trace
from search_victim import SEARCH

KILLS = 50
ENVIRONMENT = {"PYTHONPATH": os.pathsep.join(str(Path(__file__).parents[i]) for i in (0, 1, 2))}


def test_fifty_kills_leave_the_same_trace(tmp_path: Path) -> None:
    victim = str(Path(__file__).with_name("search_victim.py"))
    done = subprocess.run(
        [sys.executable, victim, str(tmp_path), str(KILLS)],
        env={**os.environ, **ENVIRONMENT},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{KILLS} killed, unfinished True\n"
    found = (tmp_path / "trace.json").read_bytes()
    assert found == trace(searched(SEARCH, workers=2, slots=3).state)
