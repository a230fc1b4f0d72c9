"""twin bench campaign: which numbers of slots it measures, and what it says meanwhile."""

from __future__ import annotations

import sys

import pytest

from twin.bench.campaign import _run
from twin.bench.campaign_command import USUAL_SLOTS, filled


@pytest.mark.parametrize(
    ("cases", "workers", "expected"),
    [
        (8, "1", [8]),
        (1, "1", []),
        (10, "1", [8, 10]),
        (200, "1", [8, 64, 200]),
        (256, "1", [8, 64, 256]),
        (1024, "1", [8, 64, 256]),
        (256, "4", [8, 64]),
        (20, "2", [8, 10]),
        (1024, "4xcuda", [8, 64, 256]),
    ],
)
def test_it_stops_at_the_slots_that_the_cases_fill(cases, workers, expected):
    assert filled(USUAL_SLOTS[1:], cases, workers) == expected


def test_it_says_how_far_a_run_is():
    told = []
    script = """
import sys
for done in range(3):
    print(f"aeb-demo: {done} of 2 cases done", file=sys.stderr)
print("{}")
sys.exit(1)
"""
    command = [sys.executable, "-c", script]
    code, printed, said = _run(command, {}, lambda *done: told.append(done))
    assert (code, printed) == (1, "{}\n")
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert said.count("done") == 3
