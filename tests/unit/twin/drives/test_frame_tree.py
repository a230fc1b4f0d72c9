"""Frames over time."""

from __future__ import annotations

import math

import pytest

from twin.drives.frame_tree import DEPTH_MAX, FramePlace, FrameTree, between, unit
from twin.ros2.frames import of_angles


def placed(x: float, y: float, heading: float = 0.0) -> FramePlace:
    return FramePlace((x, y, 0.0), of_angles(0.0, 0.0, heading))


def test_chain_is_composed_from_the_root_inwards():
    tree = FrameTree()
    tree.add("map", "odom", 0, placed(10.0, 0.0, 0.5 * math.pi))
    tree.add("odom", "base", 0, placed(2.0, 1.0, 0.25))
    inside = tree.in_root("base", 5)
    assert inside.at == pytest.approx((9.0, 2.0, 0.0))
    assert inside.heading_rad == pytest.approx(0.5 * math.pi + 0.25)
    assert tree.root("base") == "map"
    assert tree.in_root("unknown", 0).at == (0.0, 0.0, 0.0)


def test_between_two_times_it_moves_and_turns_evenly():
    tree = FrameTree()
    tree.add("map", "base", 200, placed(4.0, 0.0, -3.0))
    tree.add("map", "base", 100, placed(2.0, 0.0, 3.0))
    middle = tree.in_root("base", 150)
    assert middle.at == pytest.approx((3.0, 0.0, 0.0))
    assert abs(middle.heading_rad) == pytest.approx(math.pi)  # the shorter way
    assert tree.in_root("base", 0).at[0] == 2.0
    assert tree.in_root("base", 900).at[0] == 4.0
    assert tree.times("base") == [100, 200]


def test_later_word_about_the_same_time_counts():
    tree = FrameTree()
    tree.add("map", "base", 100, placed(1.0, 0.0))
    tree.add("map", "base", 100, placed(2.0, 0.0))
    assert tree.in_root("base", 100).at[0] == 2.0


def test_new_parent_starts_anew():
    tree = FrameTree()
    tree.add("map", "base", 100, placed(1.0, 0.0))
    tree.add("odom", "base", 200, placed(7.0, 0.0))
    assert tree.in_root("base", 100).at[0] == 7.0
    assert tree.root("base") == "odom"


def test_circles_and_towers_end():
    tree = FrameTree()
    tree.add("a", "b", 0, placed(1.0, 0.0))
    tree.add("b", "a", 0, placed(1.0, 0.0))
    for asked in (tree.root, lambda frame: tree.in_root(frame, 0)):
        with pytest.raises(ValueError, match="go in a circle"):
            asked("a")
    tower = FrameTree()
    for level in range(DEPTH_MAX - 1):
        tower.add(str(level), str(level + 1), 0, placed(1.0, 0.0))
    assert tower.in_root(str(DEPTH_MAX - 1), 0).at[0] == DEPTH_MAX - 1


def test_turns_have_the_length_one():
    assert unit((0.0, 0.0, 0.0, 0.0)) is None
    assert unit((0.0, 0.0, 0.0, 3.0)) is None
    turn = unit((0.0, 0.0, 0.6, 0.9))
    assert turn is not None
    assert math.hypot(*turn) == pytest.approx(1.0)
    one, other = (FramePlace((0.0,) * 3, (0.0, 0.0, sign, 0.0)) for sign in (1.0, -1.0))
    opposite = between(one, other, 0.5)
    assert opposite.heading_rad == pytest.approx(math.pi)
