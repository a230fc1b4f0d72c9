"""What `conductor run` loads before its workers start: they wait for it."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("asyncio", "jinja2", "numpy", "plotly", "pyarrow", "warp")


def test_a_run_begins_without_what_only_its_end_needs() -> None:
    code = (
        "import sys, conductor.run.command; print(*(m for m in sys.argv[1:] if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *HEAVY], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == ""
