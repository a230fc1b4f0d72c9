"""devkit.fusion.seen_ends: who walks takes both of his ends along."""

from __future__ import annotations

import numpy as np
import pytest

from devkit.fusion.seen_ends import SeenEnds

SHAPE = (1, 2)


def seen(ends_of, sweeps=12, turn_rad=0.0, x_m=20.0):
    """Speed of both ends, after sweeps at 10 Hz from a car that turns so far between two."""
    ends = SeenEnds(SHAPE)
    sine, cosine = np.sin(turn_rad), np.cos(turn_rad)
    for sweep in range(sweeps):
        right, left = ends_of(sweep)
        which = np.array([[True, False]])
        ends.see(which, which & (sweep == 0), np.full(SHAPE, right), np.full(SHAPE, left))
        ends.move(np.full((1, 1), 0.1), sine, cosine, np.full(SHAPE, x_m))
    assert ends.both_mps[0, 1] == 0.0, "another track"
    return ends.both_mps[0, 0]


def test_who_walks_is_as_fast_as_both_of_his_ends():
    assert seen(lambda n: (-3.0 + 0.14 * n, -2.5 + 0.14 * n)) == pytest.approx(1.4)
    assert seen(lambda n: (3.0 - 0.14 * n, 3.5 - 0.14 * n)) == pytest.approx(-1.4)
    stride = [0.0, 0.1, 0.2, 0.1]
    walks = seen(lambda n: (-3.0 + 0.14 * n - stride[n % 4], -2.5 + 0.14 * n + stride[n % 4]))
    assert 1.0 < walks < 1.8, "his legs open and close"


def test_one_end_that_stays_is_no_walk():
    assert seen(lambda n: (-4.0 + 0.14 * n, -1.8)) == 0.0
    assert abs(seen(lambda n: (-4.0 + 0.14 * n, -1.8 + 0.02 * n))) == pytest.approx(0.2)
    assert seen(lambda n: (-3.0 - 0.1 * n, -2.5 + 0.1 * n)) == 0.0, "it widens"


def test_what_stands_beside_a_car_that_turns_stands():
    """Its place aside changes by a metre in half a second."""
    turn, x_m = -0.0033, 27.0
    ends = seen(lambda n: (-4.0 - turn * x_m * n, -3.4 - turn * x_m * n), turn_rad=turn, x_m=x_m)
    assert abs(ends) < 0.05


def test_another_thing_begins_anew():
    ends = SeenEnds((1, 1))
    yes, no = np.ones((1, 1), bool), np.zeros((1, 1), bool)
    ends.see(yes, yes, np.full((1, 1), -4.0), np.full((1, 1), -3.5))
    ends.move(np.full((1, 1), 0.1), 0.0, 1.0, np.full((1, 1), 20.0))
    ends.see(yes, yes, np.full((1, 1), -2.0), np.full((1, 1), -1.5))
    assert ends.both_mps[0, 0] == 0.0
    ends.move(np.full((1, 1), 0.1), 0.0, 1.0, np.full((1, 1), 20.0))
    ends.see(yes, no, np.full((1, 1), -1.9), np.full((1, 1), -1.4))
    assert ends.both_mps[0, 0] == pytest.approx(1.0)
