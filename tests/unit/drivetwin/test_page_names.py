"""docs/python.md names what the package has, and all of it."""

from __future__ import annotations

import re
from pathlib import Path

import drivetwin
from drivetwin.arguments import RunArguments

PAGE = (Path(__file__).parents[3] / "docs" / "python.md").read_text()


def test_every_name_of_the_page_is_there():
    named = set(re.findall(r"\bdrivetwin\.(\w+)", PAGE))
    assert len(named) > 8
    assert not [name for name in named if not hasattr(drivetwin, name)]
    members = set(re.findall(r"`(?:run|recorded)\.(\w+)\(?", PAGE))
    assert {"cases", "kpis", "frame", "report", "fingerprint"} <= members
    assert not [name for name in members if not hasattr(drivetwin.Run, name)]
    started = set(re.findall(r"`started\.(\w+)\(", PAGE))
    assert started
    assert not [name for name in started if not hasattr(drivetwin.StartedRun, name)]


def test_every_argument_and_function_stands_on_the_page():
    missing = [name for name in RunArguments.__annotations__ if f"`{name}`" not in PAGE]
    assert missing == []
    functions = [name for name in drivetwin.__all__ if name[0].islower()]
    assert [name for name in functions if f"drivetwin.{name}" not in PAGE] == []
