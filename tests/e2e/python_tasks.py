"""Programs that use `import drivetwin`, each in a process of its own, and campaigns for them."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

SMALL = {"campaign": "small", "simulator": "noop", "matrix": {"repeat": [0, 1, 2]}}
LONG_CASES = 6000
LONG = {**SMALL, "campaign": "long", "matrix": {"repeat": list(range(LONG_CASES))}}
"""Enough cases that a stop comes before the last of them: they simulate nothing, and more and more
of them are leased at once."""


def task(folder: Path, code: str) -> str:
    """A module that runs ``code``; a process of its own, because a run changes what its process
    may open."""
    (folder / "task.py").write_text(textwrap.dedent(code))
    return "task"


def written(folder: Path, content: dict) -> Path:
    """A campaign file."""
    path = folder / f"{content['campaign']}.yaml"
    path.write_text(json.dumps(content))
    return path
