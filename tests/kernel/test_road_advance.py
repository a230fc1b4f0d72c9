"""twin.road.walk.moves: along lanes, over ends of roads, through junctions."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_networks import TURN_M, composed, junction, shapes, turned
from road_walks import ANY_LANE, Walks

from twin.road.tables.road_tables import flat_tables, road_tables
from twin.road.walk.moves import CROSSINGS_MAX


@pytest.fixture(scope="module")
def line() -> Walks:
    return Walks(road_tables(turned()))


@pytest.fixture(scope="module")
def crossing() -> Walks:
    return Walks(road_tables(junction()))


def test_over_ends_that_meet_head_on(line):
    """x grows by what is moved, whichever way the roads run."""
    distances = np.array([0.0, 10.0, 40.0, 45.0, 60.0, 70.0, 85.0, 110.0])
    moved = line.advance(0, -2, 5.0, 0.4, 1, distances)
    assert moved.road.tolist() == [0, 0, 1, 1, 1, 2, 2, 2]
    assert moved.lane.tolist() == [-2, -2, 2, 2, 2, -2, -2, -2]
    assert moved.sign.tolist() == [1, 1, -1, -1, -1, 1, 1, 1]
    assert moved.s.tolist() == [5.0, 15.0, 25.0, 20.0, 5.0, 5.0, 20.0, 45.0]
    assert moved.offset.tolist() == [0.4, 0.4, -0.4, -0.4, -0.4, 0.4, 0.4, 0.4]
    place = line.pose(moved.road, moved.s, moved.t)
    np.testing.assert_allclose(place[:, 0], 5.0 + distances, atol=1e-9)
    np.testing.assert_allclose(place[:, 1], -4.85, atol=1e-9)
    assert not moved.at_end.any()
    assert not moved.rest.any()


def test_the_end_of_the_network(line):
    ahead = line.advance(2, -1, 40.0, 0.0, 1, 15.0)
    assert (ahead.at_end, ahead.s, ahead.rest, ahead.road) == (1, 50.0, 5.0, 2)
    back = line.advance(0, 1, 3.0, 0.0, -1, 4.0)
    assert (back.at_end, back.s, back.rest) == (1, 0.0, 1.0)
    exactly = line.advance(2, -1, 40.0, 0.0, 1, 10.0)
    assert (exactly.at_end, exactly.s) == (0, 50.0)
    assert line.advance(2, -1, 40.0, 0.0, 1, 15.0, -5.0).at_end == 0


def test_a_lane_that_ends_inside_of_a_road_keeps_its_t(line):
    """Lane -3 of road 1 ends after 10 m; there is no other lane at its t."""
    moved = line.advance(1, -3, 8.0, 0.25, 1, 5.0)
    assert (moved.lane, moved.s, moved.road) == (0, 13.0, 1)
    assert moved.t == pytest.approx(-8.5)
    moved = line.advance(1, 0, 8.0, -4.0, 1, 5.0)
    assert (moved.lane, moved.t) == (0, -4.0)


def test_a_place_on_no_lane_goes_on_beside_the_road(line):
    moved = line.advance(0, ANY_LANE, 30.0, -9.0, 1, 20.0)
    assert (moved.road, moved.lane, moved.t, moved.sign) == (1, 0, 9.0, -1)


def test_without_a_route_the_straightest_way_counts(crossing):
    moved = crossing.advance(0, -1, 45.0, 0.0, 1, 10.0)
    assert (moved.road, moved.s, moved.lane) == (5, 5.0, -1)
    moved = crossing.advance(0, -1, 45.0, 0.0, 1, 50.0)
    assert (moved.road, moved.s, moved.lane) == (2, 5.0, -1)


@pytest.mark.parametrize(("way", "leg"), [(4, 1), (5, 2), (6, 3)])
def test_a_route_chooses_the_way(crossing, way, leg):
    length = {4: TURN_M, 5: 40.0, 6: TURN_M}[way]
    share = {4: 1.0 + 1.75 / 20.0, 5: 1.0, 6: 1.0 - 1.75 / 20.0}[way]
    steps = [0.5] * 20 + [0.25 * length * share] * 4
    moved = crossing.advance(0, -1, 45.0, 0.0, 1, *steps, route=[0, way, leg])
    assert (moved.road, moved.lane, moved.route_at) == (leg, -1, 2)
    assert moved.s == pytest.approx(5.0 / share if way != 5 else 5.0, rel=0.2)
    back = crossing.advance(
        leg, -1, moved.s, 0.0, 1, -moved.s - 1.0, route=[0, way, leg], route_at=2
    )
    assert (back.road, back.lane, back.route_at) == (way, -1, 1)


def test_left_hand_traffic_through_the_junction():
    walks = Walks(road_tables(junction("LHT")))
    moved = walks.advance(0, 1, 45.0, 0.0, 1, 10.0, route=[0, 6, 3])
    assert (moved.road, moved.lane) == (6, 1)
    assert walks.lanes(0, 45.0, lane=1)[0, 5] == 1.0
    assert walks.lanes(0, 45.0, lane=-1)[0, 5] == -1.0


def test_a_lane_without_a_way_on_ends(crossing):
    """Lane 1 of road 0 has no connection into the junction, and no way has a lane 1."""
    moved = crossing.advance(0, 1, 45.0, 0.0, 1, 10.0)
    assert (moved.road, moved.s, moved.at_end, moved.rest) == (0, 50.0, 1, 5.0)


def test_ways_in_curves_are_as_long_as_they_are():
    """On arcs of 15 and 250 m the way at t is measured by chords of the poses."""
    walks = Walks(road_tables(shapes(profiles=False)))
    for road, offset in ((1, 2.0), (1, -4.0), (2, 3.0), (2, -6.0)):
        ways = np.linspace(0.0, 30.0, 3001)
        moved = walks.advance(road, 0, 12.0, offset, 1, ways)
        place = walks.pose(road, moved.s, moved.t)
        steps = np.hypot(np.diff(place[:, 0]), np.diff(place[:, 1]))
        np.testing.assert_allclose(steps.sum(), 30.0, atol=1e-4)


def test_steps_add_up_where_curvature_is_constant():
    rng = np.random.default_rng(5)
    count = 300
    for network, roads in ((turned(), 3), (junction(), 1)):
        walks = Walks(road_tables(network))
        road = rng.integers(0, roads, count)
        s = rng.uniform(0.0, 30.0, count)
        one, two = rng.uniform(-20.0, 20.0, (2, count))
        sign = rng.choice([-1, 1], count)
        lane = rng.choice([-1, 1], count)
        stepped = walks.advance(road, lane, s, 0.3, sign, one, two)
        clear = stepped.at_end + walks.advance(road, lane, s, 0.3, sign, one).at_end == 0
        whole = walks.advance(road, lane, s, 0.3, sign, one + two)
        assert clear.sum() > 20
        for name in ("road", "lane", "sign"):
            assert np.array_equal(getattr(stepped, name)[clear], getattr(whole, name)[clear])
        np.testing.assert_allclose(stepped.s[clear], whole.s[clear], atol=1e-9)


def test_forward_and_back_is_the_same_place():
    walks = Walks(road_tables(turned()))
    rng = np.random.default_rng(6)
    s, offset = rng.uniform(0.0, 29.0, 500), rng.uniform(-1.5, 1.5, 500)
    way, road = rng.uniform(-60.0, 60.0, 500), rng.integers(0, 3, 500)
    lane = rng.choice([-2, -1, 1, 2], 500)
    there = walks.advance(road, lane, s, offset, 1, way)
    clear = there.at_end == 0
    assert clear.sum() > 100
    back = walks.advance(road, lane, s, offset, 1, way, -way)
    assert np.array_equal(back.road[clear], road[clear])
    assert np.array_equal(back.lane[clear], lane[clear])
    np.testing.assert_allclose(back.s[clear], s[clear], atol=1e-9)
    np.testing.assert_allclose(back.offset[clear], offset[clear], atol=1e-12)


def test_a_move_stops_after_its_bound_of_crossings():
    """A ring of one road of 1 m goes round 64 times, not more."""
    from road_files import LINE, end, geometry, lane, link, road, section, xodr

    from twin.road.opendrive.reading.reader import read_network

    lanes = section(
        left="", right=lane(-1, link((-1,), (-1,)) + '<width sOffset="0" a="3" b="0" c="0" d="0"/>')
    )
    ends = end("predecessor", "road", "0", "end") + end("successor", "road", "0", "start")
    ring = road(1.0, geometry(LINE, 1.0), lanes, link=ends)
    walks = Walks(road_tables(read_network(xodr(ring), "ring")))
    moved = walks.advance(0, -1, 0.5, 0.0, 1, 1000.0)
    assert moved.at_end == 1
    assert moved.rest == pytest.approx(1000.0 - (CROSSINGS_MAX - 0.5))
    assert walks.advance(0, -1, 0.5, 0.0, 1, 20.0).at_end == 0


def test_a_change_of_lanes_step_by_step(line):
    """From the middle of lane -2 to that of lane 1, and off the road."""
    rows = line.across(0, -2, 10.0, -1, np.array([-5.25, -3.6, -3.4, -1.75, 0.1, 1.75, 9.0]))
    assert rows[:, 0].tolist() == [-2, -2, -1, -1, 1, 1, 0]
    np.testing.assert_allclose(rows[:, 1], [0.0, 1.65, -1.65, 0.0, -1.65, 0.0, 9.0], atol=1e-12)
    np.testing.assert_allclose(rows[:, 2], [-5.25, -3.6, -3.4, -1.75, 0.1, 1.75, 9.0], atol=1e-12)
    assert np.all(rows[:, 3:] == [-1.0, 7.0, 10.0])


def test_pieces_in_order():
    walks = Walks(road_tables(composed()))
    moved = walks.advance(0, ANY_LANE, 0.0, 0.0, 1, np.linspace(0.0, 120.0, 7))
    np.testing.assert_allclose(moved.s, np.linspace(0.0, 120.0, 7), atol=1e-12)


def test_flat_ground():
    walks = Walks(flat_tables())
    moved = walks.advance(-1, 0, 3.0, -2.0, -1, 5.0)
    assert (moved.road, moved.s, moved.t, moved.at_end) == (-1, -2.0, -2.0, 0)
    assert math.isclose(float(walks.advance(-1, ANY_LANE, 3.0, -2.0, 1, 5.0).s[0]), 8.0)
