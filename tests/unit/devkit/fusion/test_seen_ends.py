"""devkit.fusion.seen_ends: who walks takes both of his ends along."""

from __future__ import annotations

import numpy as np
import pytest

from devkit.fusion.seen_ends import SeenEnds

SHAPE = (1, 2)
YES = np.array([[True, False]])
NO = np.zeros(SHAPE, bool)


def sweeps_of(ends_of, vy_mps, sweeps=12, turn_rad=0.0, x_m=20.0):
    """How much sweeps at 10 Hz say that both ends go along, after each, from a car that turns so
    far between two."""
    ends, says = SeenEnds(SHAPE), []
    for sweep in range(sweeps):
        right, left = (np.full(SHAPE, y_m) for y_m in ends_of(sweep))
        ends.see(YES, YES if sweep == 0 else NO, right, left, np.full(SHAPE, vy_mps))
        says.append(ends.along[0, 0])
        assert ends.go_along().tolist() == [[says[-1] > 0.6, False]], "the other track is not seen"
        ends.move(np.full((1, 1), 0.1), np.sin(turn_rad), np.cos(turn_rad), np.full(SHAPE, x_m))
    return says


@pytest.mark.parametrize("vy_mps", [1.4, -1.4, 0.9, 5.0])
def test_who_walks_takes_both_ends_along(vy_mps):
    says = sweeps_of(lambda n: (-3.0 + 0.1 * vy_mps * n, -2.5 + 0.1 * vy_mps * n), vy_mps)
    assert says[:3] == pytest.approx([0.35, 0.61, 0.766])
    assert says[-1] > 0.99
    assert max(sweeps_of(lambda n: (-3.0, -2.5), vy_mps)[1:]) < 0.3, "who stands"
    back = sweeps_of(lambda n: (-3.0 - 0.1 * vy_mps * n, -2.5 - 0.1 * vy_mps * n), vy_mps)
    assert max(back[1:]) < 0.3


def test_legs_open_and_close():
    stride = [0.0, 0.06, 0.12, 0.06]

    def walks(sweep):
        return (-3.0 + 0.14 * sweep - stride[sweep % 4], -2.5 + 0.14 * sweep + stride[sweep % 4])

    assert min(sweeps_of(walks, 1.4, 24)[8:]) > 0.6


def test_one_end_that_stays_is_no_walk():
    assert max(sweeps_of(lambda n: (-4.0 + 0.14 * n, -1.8), 0.7)[1:]) < 0.3
    assert max(sweeps_of(lambda n: (-3.0 - 0.1 * n, -2.5 + 0.1 * n), 0.5)[1:]) < 0.3, "it widens"


def test_a_jump_that_is_over_is_no_walk():
    """More of a car came into view in three sweeps, and nothing since."""
    left = [-2.63, -2.12, -1.77, -1.71, -1.82, -1.93, -1.85, -1.77]
    right = [-3.29, -2.97, -2.96, -2.47, -2.38, -2.64, -2.87, -2.1]
    says = sweeps_of(lambda n: (right[n], left[n]), 1.2, len(left))
    assert max(says[5:]) < 0.6


def test_what_stands_beside_a_car_that_turns_stands():
    """Its place aside changes by a metre in half a second."""
    turn, x_m = -0.0033, 27.0
    seen = sweeps_of(
        lambda n: (-4.0 - turn * x_m * n, -3.4 - turn * x_m * n), 0.9, turn_rad=turn, x_m=x_m
    )
    assert max(seen[1:]) < 0.3


def test_another_thing_begins_anew():
    ends = SeenEnds((1, 1))
    yes, no, vy = np.ones((1, 1), bool), np.zeros((1, 1), bool), np.full((1, 1), 1.0)
    for y_m, anew in ((-4.0, yes), (-3.9, no), (-2.0, yes)):
        ends.see(yes, anew, np.full((1, 1), y_m), np.full((1, 1), y_m + 0.5), vy)
        ends.move(np.full((1, 1), 0.1), np.zeros((1, 1)), np.ones((1, 1)), np.full((1, 1), 20.0))
    assert ends.along[0, 0] == pytest.approx(0.35)
    ends.see(yes, no, np.full((1, 1), -1.9), np.full((1, 1), -1.4), vy)
    assert ends.along[0, 0] == pytest.approx(0.61)
