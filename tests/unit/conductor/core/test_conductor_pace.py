"""Throughput, remaining time, and how long cases take."""

from __future__ import annotations

import pytest

from conductor.commands.pace import WINDOW_S, Pace, shown_time
from conductor.core.durations import Durations


def test_the_pace_is_that_of_the_last_minute() -> None:
    pace = Pace()
    assert (pace.per_s, pace.eta_s(5), pace.eta_s(0)) == (None, None, 0.0)
    pace.saw(0, 100.0)
    assert pace.per_s is None
    pace.saw(30, 110.0)
    assert pace.per_s == 3.0
    assert pace.eta_s(12) == 4.0
    # The point that is older than the window stays as its left edge until the next one is, too.
    pace.saw(40, 100.0 + WINDOW_S)
    assert pace.per_s == pytest.approx(40 / WINDOW_S)
    pace.saw(60, 110.0 + WINDOW_S)
    assert pace.per_s == pytest.approx(30 / WINDOW_S)
    pace.saw(60, 105.0 + 2 * WINDOW_S)
    assert pace.per_s == pytest.approx(20 / (WINDOW_S + 5.0))


def test_another_folder_begins_anew() -> None:
    pace = Pace()
    pace.saw(50, 1.0)
    pace.saw(60, 2.0)
    pace.saw(3, 3.0)
    assert pace.per_s is None
    pace.saw(4, 4.0)
    assert pace.per_s == 1.0


def test_nothing_ends_and_no_time_passes() -> None:
    pace = Pace()
    pace.saw(7, 1.0)
    pace.saw(8, 1.0)
    assert pace.per_s is None
    pace = Pace()
    pace.saw(7, 1.0)
    pace.saw(7, 2.0)
    assert (pace.per_s, pace.eta_s(3)) == (0.0, None)


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (None, "-"),
        (0.4, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (185.0, "3 min 05 s"),
        (3599.4, "59 min 59 s"),
        (3600.0, "1 h 00 min"),
        (7865.0, "2 h 11 min"),
        (90_061.0, "25 h 01 min"),
    ],
)
def test_times_are_shown_as_people_say_them(seconds: float | None, shown: str) -> None:
    assert shown_time(seconds) == shown


@pytest.mark.parametrize(
    ("long", "total", "p95_s"), [(1, 20, 0.001), (2, 20, 8.192), (1, 10, 8.192)]
)
def test_95_of_100_stay_within_the_estimate(long: int, total: int, p95_s: float) -> None:
    """One of ten is more than five of a hundred."""
    durations = Durations()
    for number in range(total):
        durations.add(8.192 if number < long else 0.001)
    assert durations.p95_s() == pytest.approx(p95_s)
