"""Laps add up to the whole time, whatever another process claims as its share."""

import math
from types import SimpleNamespace

import pytest

from twin.base import stopwatch
from twin.base.stopwatch import Stopwatch


@pytest.fixture
def clock(monkeypatch):
    times = iter(range(100))
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=lambda: float(next(times))))


def test_laps_of_a_name_add_up(clock):
    watch = Stopwatch()
    assert [watch.lap("a"), watch.lap("b"), watch.lap("a")] == [1.0, 1.0, 1.0]
    assert watch.seconds == {"a": 2.0, "b": 1.0}


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ({"x": 0.25, "y": 0.5}, {"x": 0.25, "y": 0.5, "rest": 0.25}),
        ({"x": 0.75, "y": 0.5}, {"x": 0.75, "y": 0.25, "rest": 0.0}),
        ({"x": -3.0, "y": math.nan}, {"x": 0.0, "y": 0.0, "rest": 1.0}),
        ({"x": math.inf}, {"x": 1.0, "rest": 0.0}),
    ],
)
def test_shares_of_a_lap_are_never_more_than_it(clock, shares, expected):
    watch = Stopwatch()
    assert watch.lap_with("rest", shares) == 1.0
    assert watch.seconds == expected
