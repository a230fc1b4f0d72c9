"""Clocks of rigs: round trips bound what they are ahead of ours, and so how old a picture is."""

import math

import pytest

from viewer.console.rig_clocks import DRIFT, RIGS_MAX, RigClocks


def test_a_round_trip_says_how_old_a_picture_is_and_how_sure_that_is():
    clocks = RigClocks()
    clocks.read("r", clock_s=1000.0, asked_s=10.0, answered_s=10.4)
    age = clocks.age("r", at_s=1000.0, now_s=12.0)
    assert age.age_s == pytest.approx(1.8)
    assert age.within_s == pytest.approx(0.2 + 1.6 * DRIFT)


def test_later_round_trips_make_it_surer_whatever_their_order():
    clocks = RigClocks()
    for asked_s, answered_s in ((10.0, 10.4), (10.41, 12.0), (12.0, 12.01)):
        # The clock was read at the middle: 990 s ahead of ours.
        clocks.read("r", 990.0 + (asked_s + answered_s) / 2, asked_s, answered_s)
    age = clocks.age("r", at_s=990.0 + 11.0, now_s=12.01)
    assert age.age_s == pytest.approx(1.01, abs=0.006)
    assert age.within_s == pytest.approx(0.005, abs=1e-9)


def test_bounds_grow_apart_while_nobody_asks():
    clocks = RigClocks()
    clocks.read("r", 0.0, 0.0, 0.0)
    assert clocks.age("r", 0.0, 1000.0).within_s == pytest.approx(1000 * DRIFT)
    clocks.read("r", 1000.05, 1000.0, 1000.0)
    assert clocks.age("r", 1000.05, 1000.0).age_s == pytest.approx(0.0, abs=1e-9)


def test_a_clock_that_stood_while_its_host_slept_is_read_anew():
    clocks = RigClocks()
    clocks.read("r", 100.0, 0.0, 0.01)
    clocks.read("r", 101.0, 3600.0, 3600.01)
    assert clocks.age("r", 101.0, 3600.01).age_s == pytest.approx(0.005)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_says_nothing(value):
    clocks = RigClocks()
    clocks.read("r", value, 0.0, 0.01)
    assert not clocks.knows("r")
    clocks.read("r", 5.0, 0.0, 0.01)
    assert clocks.age("r", value, 1.0) is None
    assert clocks.age("other", 5.0, 1.0) is None


def test_nothing_is_younger_than_now():
    clocks = RigClocks()
    clocks.read("r", 5.0, 0.0, 0.0)
    assert clocks.age("r", at_s=6.0, now_s=0.5).age_s == 0.0


def test_rigs_that_come_and_go_fill_no_memory():
    clocks = RigClocks()
    for number in range(RIGS_MAX + 1):
        clocks.read(f"r{number}", 1.0, 0.0, 0.1)
    assert clocks.knows(f"r{RIGS_MAX}")
    assert not clocks.knows("r0")
