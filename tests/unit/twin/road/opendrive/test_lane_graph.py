"""twin.road.opendrive.lane_graph: what leads where, and shortest ways."""

from __future__ import annotations

import pytest
from road_files import LINE, WIDTH, crossing, end, geometry, lane, link, road, section, xodr

from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.lane_graph import DrivenLane, LaneKey, LanePosition, lane_graph
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap


def test_a_way_through_a_junction():
    graph = lane_graph(read_network(crossing(), "t"))
    route = graph.route(LanePosition("0", -1, 10.0), LanePosition("1", -1, 30.0))
    assert route is not None
    assert [step.lane.key.road for step in route.steps] == ["0", "2", "1"]
    assert route.length_m == 40.0 + 20.0 + 30.0
    assert graph.route(LanePosition("1", -1, 10.0), LanePosition("0", -1, 30.0)) is None
    back = graph.route(LanePosition("1", 1, 10.0), LanePosition("0", 1, 30.0))
    assert back is not None
    assert back.length_m == 10.0 + 20.0 + 20.0
    assert [(s.from_s_m, s.to_s_m) for s in back.steps] == [(10, 0), (20, 0), (50, 30)]


def test_left_hand_traffic_drives_the_other_way():
    graph = lane_graph(read_network(crossing("LHT"), "t"))
    assert graph.route(LanePosition("0", -1, 10.0), LanePosition("1", -1, 30.0)) is None
    assert graph.route(LanePosition("0", 1, 10.0), LanePosition("1", 1, 30.0)) is not None


def test_sections_and_neighbours():
    lanes = section(right=lane(-1, link(after=(-2,)) + WIDTH)) + section(
        40.0, right=lane(-1) + lane(-2, link(before=(-1,)) + WIDTH)
    )
    graph = lane_graph(read_network(xodr(road(lanes=lanes)), "t"))
    first = DrivenLane(LaneKey("0", 0, -1), 1)
    second = DrivenLane(LaneKey("0", 1, -2), 1)
    assert graph.successors(first) == (second,)
    assert graph.predecessors(second) == (first,)
    assert graph.successors(second) == ()
    assert graph.route(LanePosition("0", -1, 0.0), LanePosition("0", -1, 90.0)) is None
    route = graph.route(LanePosition("0", -1, 0.0), LanePosition("0", -2, 90.0))
    assert route is not None
    assert route.length_m == 90.0


def ring() -> bytes:
    """Two straights that lead to each other: a way round."""
    inside = section(left="", right=lane(-1, link((-1,), (-1,)) + WIDTH))
    roads = [
        road(
            50.0,
            geometry(LINE, 50.0),
            inside,
            road_id=own,
            link=end("predecessor", "road", other, "end")
            + end("successor", "road", other, "start"),
        )
        for own, other in (("a", "b"), ("b", "a"))
    ]
    return xodr(*roads)


def test_behind_the_start_the_way_goes_round():
    graph = lane_graph(read_network(ring(), "t"))
    route = graph.route(LanePosition("a", -1, 30.0), LanePosition("a", -1, 10.0))
    assert route is not None
    assert route.length_m == 20.0 + 50.0 + 10.0
    assert [step.lane.key.road for step in route.steps] == ["a", "b", "a"]


def test_positions_must_exist():
    graph = lane_graph(read_network(ring(), "t"))
    for start, words in (
        (LanePosition("x", -1, 0.0), "road x does not exist"),
        (LanePosition("a", 1, 0.0), "no lane 1 at s=0"),
        (LanePosition("a", -1, 60.0), "50 m long"),
    ):
        with pytest.raises(ValueError, match=words):
            graph.route(start, LanePosition("b", -1, 1.0))


def test_gaps_are_found_where_ends_do_not_meet():
    roads = RoadMap(read_network(ring(), "t"))
    gaps = find_gaps(roads.network, roads.frames)
    assert [(gap.road, gap.at, gap.other, gap.distance_m) for gap in gaps] == [
        ("a", "start", "b", 50.0),
        ("a", "end", "b", 50.0),
    ]
    joined = RoadMap(read_network(crossing(), "t"))
    assert find_gaps(joined.network, joined.frames) == []


def test_kinks_inside_of_a_road_are_found():
    plan = geometry(LINE, 50.0) + geometry(LINE, 50.0, 50.0, (50.0, 0.005, 0.01))
    roads = RoadMap(read_network(xodr(road(100.0, plan)), "t"))
    (gap,) = find_gaps(roads.network, roads.frames)
    assert gap.at == "s=50"
    assert gap.kink_rad == pytest.approx(0.01, abs=1e-8)
    assert gap.distance_m == pytest.approx(0.005, abs=1e-8)


def test_the_lane_under_a_point():
    roads = RoadMap(read_network(crossing(), "t"))
    under = roads.lane_under([10.0, 60.0, 80.0, 80.0, -5.0], [-1.0, 1.0, 2.0, 9.0, 0.0])
    assert under.road.tolist() == [0, 2, 1, -1, -1]
    assert under.lane.tolist() == [-1, 1, 1, 0, 0]
    assert under.s_m[:3].tolist() == [10.0, 10.0, 10.0]
