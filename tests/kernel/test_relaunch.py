"""Launches that are made again: the same results, and arguments that are packed once."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from twin.world import relaunch
from twin.world.relaunch import COMMANDS_MAX, Relaunch


@wp.struct
class Slope:
    """A straight line."""

    offset: wp.float32
    steps: wp.array(dtype=wp.float32)


@wp.kernel(module="unique", enable_backward=False)
def line_kernel(
    # model
    slope: Slope,
    # args
    first: wp.int32,
    # out
    out: wp.array(dtype=wp.float32),
):
    """Points of the line from ``first`` on."""
    i = wp.tid()
    out[i] = slope.offset + slope.steps[0] * wp.float32(first + i)


class Line:
    """A line with its results, and how often its arguments were packed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.slope = Slope()
        self.slope.steps = wp.array([1.0], dtype=wp.float32, device="cpu")
        self.out = wp.zeros(4, dtype=wp.float32, device="cpu")
        self.packed = 0
        self._launch = Relaunch(wp.get_device("cpu"))
        plain = wp.launch

        def counted(*args: object, **kwargs: object) -> object:
            self.packed += 1
            return plain(*args, **kwargs)

        monkeypatch.setattr(relaunch.wp, "launch", counted)

    def at(self, first: int, count: int = 4) -> list[float]:
        self.out.zero_()
        self._launch(line_kernel, count, [self.slope, first], [self.out])
        return self.out.numpy().tolist()


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Line:
    return Line(monkeypatch)


def test_the_same_arguments_are_packed_once(line: Line) -> None:
    assert [line.at(2) for _ in range(3)] == [[2.0, 3.0, 4.0, 5.0]] * 3
    assert line.packed == 1


def test_what_arguments_hold_may_change(line: Line) -> None:
    assert line.at(1) == [1.0, 2.0, 3.0, 4.0]
    line.slope.offset = 10.0
    line.slope.steps.assign(np.array([2.0], np.float32))
    assert line.at(1) == [12.0, 14.0, 16.0, 18.0]
    line.slope.steps = wp.array([0.0], dtype=wp.float32, device="cpu")
    assert line.at(1) == [10.0] * 4
    assert line.packed == 1


@wp.kernel(module="unique", enable_backward=False)
def shifted_kernel(
    # args
    shift: wp.float64,
    # out
    out: wp.array(dtype=wp.float64),
):
    """The same number everywhere."""
    out[wp.tid()] = shift


def test_equal_fractions_are_the_same_argument(line: Line) -> None:
    again = Relaunch(wp.get_device("cpu"))
    out = wp.zeros(2, dtype=wp.float64, device="cpu")
    for shift in (0.5, 0.25, 0.5, 0.75):
        again(shifted_kernel, 2, [shift * line.at(1)[0]], [out])  # another object each time
        assert out.numpy().tolist() == [shift] * 2
    assert line.packed == 1 + 3


def test_zero_and_minus_zero_are_two_arguments() -> None:
    again = Relaunch(wp.get_device("cpu"))
    out = wp.zeros(2, dtype=wp.float64, device="cpu")
    for shift in (0.0, -0.0, 0.0):
        out.fill_(-0.0)
        again(shifted_kernel, 2, [shift], [out])
        assert np.signbit(out.numpy()).tolist() == [math.copysign(1.0, shift) < 0.0] * 2


def test_other_numbers_sizes_and_arrays_are_other_launches(line: Line) -> None:
    assert line.at(1) == [1.0, 2.0, 3.0, 4.0]
    assert line.at(7) == [7.0, 8.0, 9.0, 10.0]
    assert line.at(1, count=2) == [1.0, 2.0, 0.0, 0.0]
    line.out = wp.zeros(4, dtype=wp.float32, device="cpu")
    assert line.at(1) == [1.0, 2.0, 3.0, 4.0]
    assert line.packed == 4


def test_arrays_that_come_and_go_never_pass_for_each_other(line: Line) -> None:
    for first in range(3 * COMMANDS_MAX):
        line.out = wp.zeros(4, dtype=wp.float32, device="cpu")
        assert line.at(5)[0] == 5.0, first
    assert line.packed == 3 * COMMANDS_MAX


def test_a_launch_of_nothing_is_none(line: Line) -> None:
    assert line.at(1, count=0) == [0.0] * 4
    assert line.at(1, count=0) == [0.0] * 4
