"""Every planted bug still fits the code; `make planted` says whether the tests notice them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from copies import ROOT
from planting import (
    Planted,
    PlantingError,
    load_catalogue,
    named_test_exists,
    planted_source,
)

BUGS = load_catalogue()
PACKAGES = {"schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin"}
LEAST = 120
"""Fewest entries."""


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_the_entry_applies_and_names_a_test(bug: Planted) -> None:
    path, text = planted_source(ROOT, bug)
    assert text != path.read_text(encoding="utf-8")
    assert named_test_exists(ROOT, bug.test), f"{bug.test}: no such test; name the one of today"


def test_all_packages_have_planted_bugs() -> None:
    assert {bug.package for bug in BUGS} == PACKAGES
    assert len(BUGS) >= LEAST
    assert len({(bug.symbol, bug.old, bug.new) for bug in BUGS}) == len(BUGS), "one of them twice"


def test_the_whole_run_stays_below_an_hour() -> None:
    """Two at a time; a test's file takes longer than the test, so half an hour of tests is all."""
    assert sum(bug.seconds for bug in BUGS) / 2 < 1800


@pytest.mark.parametrize(
    ("symbol", "old", "new", "said"),
    [
        ("conductor.nowhere:x", "a", "b", "no such file"),
        ("conductor.core.lease:nothing", "a", "b", "no symbol"),
        ("conductor.core.lease:expired", "lease", "leases", "occurs 6 times"),
        ("conductor.core.lease:expired", "no such text", "b", "occurs 0 times"),
        ("conductor.core.lease:expired", "return []", "return [", "does not compile"),
        ("conductor.core.lease:expired", "return []", "return [ ]", "changes no code"),
    ],
)
def test_an_entry_that_does_not_fit_says_why(symbol: str, old: str, new: str, said: str) -> None:
    bug = Planted("mistake", "wrong", symbol, old, new, "tests/x.py::test_x", 1.0)
    with pytest.raises(PlantingError, match=said) as caught:
        planted_source(ROOT, bug)
    assert len(str(caught.value).splitlines()) == 1


def test_an_edit_stays_inside_its_symbol(tmp_path: Path) -> None:
    """Methods of the same name, decorators, and definitions behind a condition."""
    (tmp_path / "made.py").write_text(
        "A = 1\n\n\nclass One:\n    def f(self):\n        return 1\n\n\n"
        "class Two:\n    @property\n    def f(self):\n        return 1\n\n\n"
        "if A:\n    def g():\n        return 1\n"
    )
    for symbol, line in (("One.f", 6), ("Two.f", 12), ("g", 17), ("A", 1)):
        bug = Planted("x", "x", f"made:{symbol}", "1", "2", "tests/x.py::test_x", 1.0)
        _, text = planted_source(tmp_path, bug)
        lines = zip((tmp_path / "made.py").read_text().splitlines(), text.splitlines(), strict=True)
        changed = [number for number, (old, new) in enumerate(lines, 1) if old != new]
        assert changed == [line], symbol
