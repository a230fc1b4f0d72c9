"""twin.road.walk: places of points on roads, and how far apart places are."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import geometry, road, xodr
from road_networks import TURN_M, composed, junction, shapes, turned
from road_walks import Walks

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import flat_tables, road_tables


@pytest.mark.parametrize("network", [shapes, turned, composed, junction])
def test_pose_and_locate_are_inverse(network):
    tables = road_tables(network())
    walks = Walks(tables)
    rng = np.random.default_rng(1)
    number = rng.integers(0, len(tables.road_ids), 3000)
    s = rng.uniform(0.0, 1.0, 3000) * tables.extents[number, 0]
    t = rng.uniform(-3.0, 3.0, 3000)
    pose = walks.pose(number, s, t)
    for near in (s, np.clip(s + rng.uniform(-8.0, 8.0, 3000), 0.0, tables.extents[number, 0])):
        rows = walks.locate(*pose[:, :3].T, number, near)
        same = rows[:, 0] == number
        # At an end the next road may have the point too; lanes of a way through a junction are few.
        assert same.mean() > 0.4 if network is junction else same.mean() > 0.99
        np.testing.assert_allclose(rows[same, 2], s[same], atol=1e-8)
        np.testing.assert_allclose(rows[same, 3], t[same], atol=1e-8)
        np.testing.assert_allclose(rows[same, 4], 0.0, atol=1e-8)


def test_without_a_hint_all_roads_count():
    for network in (shapes(), turned()):
        tables = road_tables(network)
        walks, roads = Walks(tables), RoadMap(network)
        rng = np.random.default_rng(2)
        number = rng.integers(0, len(tables.road_ids), 500)
        s = rng.uniform(0.02, 0.98, 500) * tables.extents[number, 0]
        pose = walks.pose(number, s, rng.uniform(-5.0, 5.0, 500))
        exact = roads.lane_under(*pose[:, :3].T)
        rows = walks.locate(*pose[:, :3].T)
        on = exact.road >= 0
        assert on.mean() > 0.8
        assert np.array_equal(rows[on, 0], exact.road[on])
        assert np.array_equal(rows[on, 1], exact.lane[on])
        np.testing.assert_allclose(rows[on, 2], exact.s_m[on], atol=1e-4)
        np.testing.assert_allclose(rows[on, 3], exact.t_m[on], atol=1e-4)
        assert not rows[~on, 1].any()


def test_a_height_tells_the_storey():
    """Two roads cross, the second 6 m above the first."""
    above = '<elevationProfile><elevation s="0" a="6" b="0" c="0" d="0"/></elevationProfile>'
    upper = road(
        100.0,
        geometry("<line/>", 100.0, at=(50.0, -50.0, 0.5 * math.pi)),
        road_id="1",
        more=above,
    )
    walks = Walks(road_tables(read_network(xodr(road(), upper), "t")))
    rows = walks.locate(50.5, -1.0, np.array([0.2, 5.5, 6.4, -1.0]))
    assert rows[:, 0].tolist() == [0, 1, 1, 0]
    np.testing.assert_allclose(rows[:, 4], [0.2, -0.5, 0.4, -1.0], atol=1e-9)
    # Where both are equally near, or no height is known, the nearer reference line counts.
    assert walks.locate(50.5, -1.0, math.nan)[0, [0, 4]].tolist() == [1.0, 0.0]
    # A point stays on its road, whatever crosses it.
    assert walks.locate(50.5, -1.0, 0.0, 0, 45.0)[0, 0] == 0


def test_a_point_goes_on_to_the_linked_road():
    walks = Walks(road_tables(turned()))
    rows = walks.locate(np.array([39.0, 41.0, 69.0, 71.0]), -2.0, 0.0, [0, 0, 1, 1], [39, 39, 2, 2])
    assert rows[:, 0].tolist() == [0, 1, 1, 2]
    assert rows[:, 1].tolist() == [-1, 1, 1, -1]
    np.testing.assert_allclose(rows[:, 2], [39.0, 29.0, 1.0, 1.0], atol=1e-9)


def test_a_point_beside_all_roads_belongs_to_the_nearest():
    walks = Walks(road_tables(turned()))
    rows = walks.locate(np.array([20.0, 300.0, -30.0]), np.array([80.0, 0.0, 40.0]), 0.0)
    assert rows[:, 0].tolist() == [0, 2, 0]
    assert rows[:, 1].tolist() == [0, 0, 0]
    np.testing.assert_allclose(rows[:, 2], [20.0, 50.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(rows[:, 5], [0.0, 180.0, 30.0], atol=1e-9)


def test_a_hint_keeps_a_point_on_its_branch():
    length = 2 * math.pi * 30.0 * 1.5
    plan = geometry(f'<arc curvature="{1 / 30!r}"/>', length)
    walks = Walks(road_tables(read_network(xodr(road(length, plan)), "t")))
    x, y, z = walks.pose(0, 20.0, 1.0)[0, :3]
    rows = walks.locate(x, y, z, 0, np.array([22.0, 2 * math.pi * 30.0 + 22.0]))
    np.testing.assert_allclose(rows[:, 2], [20.0, 2 * math.pi * 30.0 + 20.0], atol=1e-4)


def test_flat_ground():
    rows = Walks(flat_tables()).locate(3.0, -4.0, 0.5)
    assert rows[0, :5].tolist() == [-1.0, 0.0, 3.0, -4.0, 0.5]
    apart = Walks(flat_tables()).apart(-1, 3.0, -4.0, -1, 5.0, 1.0)
    assert apart[0].tolist() == [1.0, 2.0, 5.0, 1.0]


def test_distances_along_turned_roads():
    """Places on a line along x: the difference of x, and of y."""
    walks = Walks(road_tables(turned()))
    places = [(0, 5.0, 1.0), (0, 30.0, -2.0), (1, 25.0, 3.0), (1, 4.0, -1.0), (2, 9.0, 2.0)]
    for a in places:
        for b in places:
            ax, ay = walks.pose(*a)[0, :2]
            bx, by = walks.pose(*b)[0, :2]
            facing = -1.0 if a[0] == 1 else 1.0
            sign = 1.0 if (a[0] == 1) == (b[0] == 1) else -1.0
            expected = [1.0, (bx - ax) * facing, (by - ay) * facing, sign]
            np.testing.assert_allclose(walks.apart(*a, *b)[0], expected, atol=1e-9)


def test_distances_through_a_junction():
    walks = Walks(road_tables(junction()))
    assert walks.apart(0, 40.0, 0.0, 1, 5.0, 1.0)[0].tolist() == [1.0, 15.0 + TURN_M, 1.0, 1.0]
    assert walks.apart(3, 5.0, 1.0, 0, 40.0, 0.0)[0].tolist() == [1.0, -15.0 - TURN_M, -1.0, 1.0]
    # From leg to leg there is no way but back through road 0, where nobody can turn.
    assert walks.apart(1, 5.0, 0.0, 3, 5.0, 0.0)[0, 0] == 0.0
