"""Roads in kernels: whatever the place and the way, what belongs together fits."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from hypothesis import given, settings
from hypothesis import strategies as st
from road_networks import composed, junction, shapes, turned
from road_walks import Moved, Walks

from twin.road.tables.road_tables import road_tables

NETWORKS = {"shapes": shapes, "turned": turned, "composed": composed, "junction": junction}
FAST = settings(max_examples=60, deadline=None)
shares = st.floats(0.0, 1.0, allow_nan=False)
names = st.sampled_from(sorted(NETWORKS))


@cache
def walks_of(name: str) -> Walks:
    return Walks(road_tables(NETWORKS[name]()))


def placed(name: str, road: int, share: float) -> tuple[Walks, int, float]:
    walks = walks_of(name)
    road %= len(walks.tables.road_ids)
    return walks, road, share * float(walks.tables.extents[road, 0])


def apart_m(walks: Walks, one: Moved, other: Moved) -> float:
    """Distance in the world between two places, 1 more if they go different ways."""
    a, b = (walks.pose(m.road, m.s, m.t)[0] for m in (one, other))
    way = [math.cos(p[3]) * m.sign[0] for p, m in ((a, one), (b, other))]
    return math.dist(a[:3], b[:3]) + float(abs(way[0] - way[1]) > 1e-6)


@FAST
@given(names, st.integers(0, 6), shares, st.floats(-3.0, 3.0), st.floats(-0.2, 0.2))
def test_a_located_pose_is_its_place(name, road, share, t, h):
    walks, road, s = placed(name, road, share)
    x, y, z = walks.pose(road, s, t)[0, :3]
    for near in (s, s + 5.0, s - 5.0):
        row = walks.locate(x, y, z, road, near)[0]
        back = walks.pose(row[0], row[2], row[3])[0, :3]
        assert math.dist(back, (x, y, z)) < 1e-7 or row[5] > 0.0
        if row[0] == road and t != 0.0:
            assert row[2] == pytest.approx(s, abs=1e-7)
    assert abs(walks.locate(x, y, z + h, road, s)[0, 4]) <= abs(h) + 1e-6


@FAST
@given(
    st.sampled_from(["turned", "junction"]),
    st.integers(0, 2),
    shares,
    st.floats(-1.0, 1.0),
    st.floats(-60.0, 60.0),
    st.floats(-60.0, 60.0),
)
def test_two_moves_are_their_sum_and_undo_each_other(name, road, share, offset, one, two):
    walks, road, s = placed(name, road if name == "turned" else 0, share)
    lane = -1
    first = walks.advance(road, lane, s, offset, 1, one)
    both = walks.advance(road, lane, s, offset, 1, one, two)
    # In bends of the junction a way is as long as the bend at its beginning says.
    bent = walks.lanes([first.road[0], road], [first.s[0], s])[:, 11].any() or name == "junction"
    if first.at_end[0] or both.at_end[0] or (bent and offset != 0.0):
        return
    # An end of a road is also that of the next, so places are compared in the world.
    start = walks.advance(road, lane, s, offset, 1, 0.0)
    assert apart_m(walks, walks.advance(road, lane, s, offset, 1, one, -one), start) < 1e-8
    whole = walks.advance(road, lane, s, offset, 1, one + two)
    if not whole.at_end[0]:
        assert apart_m(walks, whole, both) < 1e-8


@FAST
@given(names, st.integers(0, 6), shares, st.integers(-3, 3), st.integers(-6, 6))
def test_a_lane_beside_is_there_or_0(name, road, share, lane, steps):
    walks, road, s = placed(name, road, share)
    target = walks.lanes(road, s, lane=lane, steps=steps)[0, 7]
    assert target == 0.0 or walks.lanes(road, s, lane=target)[0, 4] == 1.0
    if target != 0.0 and lane != 0:
        assert walks.lanes(road, s, lane=target, steps=-steps)[0, 7] in (lane, 0.0)


@FAST
@given(names, st.lists(st.tuples(st.integers(0, 6), shares, st.floats(-9.0, 9.0)), min_size=2))
def test_distances_there_and_back_are_opposite(name, places):
    walks = walks_of(name)
    for (a, share_a, t_a), (b, share_b, t_b) in itertools.pairwise(places):
        _, a, s_a = placed(name, a, share_a)
        _, b, s_b = placed(name, b, share_b)
        there = walks.apart(a, s_a, t_a, b, s_b, t_b)[0]
        back = walks.apart(b, s_b, t_b, a, s_a, t_a)[0]
        assert there[0] == back[0]
        assert there[3] == back[3]
        assert there[1] == pytest.approx(-there[3] * back[1], abs=1e-9)
        if there[0]:
            assert there[2] == pytest.approx(-there[3] * back[2], abs=1e-9)


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_a_thread_does_not_depend_on_others(name):
    """64 threads, and each alone: the same bytes."""
    walks = walks_of(name)
    rng = np.random.default_rng(4)
    road = rng.integers(0, len(walks.tables.road_ids), 64)
    s = rng.uniform(0.0, 1.0, 64) * walks.tables.extents[road, 0]
    t, way = rng.uniform(-6.0, 6.0, 64), rng.uniform(-90.0, 90.0, 64)
    pose = walks.pose(road, s, t)
    lanes = walks.lanes(road, s, t, -1)
    moved = np.array(walks.advance(road, -99, s, t, 1, way, 0.3 * way)).T
    spots = walks.locate(*pose[:, :3].T)
    for i in range(64):
        assert walks.pose(road[i], s[i], t[i]).tobytes() == pose[i].tobytes()
        assert walks.lanes(road[i], s[i], t[i], -1).tobytes() == lanes[i].tobytes()
        one = walks.advance(road[i], -99, s[i], t[i], 1, way[i], 0.3 * way[i])
        assert np.array(one).T.tobytes() == moved[i].tobytes()
        assert walks.locate(*pose[i, :3]).tobytes() == spots[i].tobytes()
