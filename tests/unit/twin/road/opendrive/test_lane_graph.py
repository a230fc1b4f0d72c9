"""twin.road.opendrive.lane_graph: what leads where, and shortest ways."""

from __future__ import annotations

import heapq
import random

import pytest
from road_files import LINE, WIDTH, crossing, end, geometry, lane, link, road, section, xodr

from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.lane_graph import (
    DrivenLane,
    LaneGraph,
    LaneKey,
    LanePosition,
    lane_graph,
)
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


def _forwards(graph: LaneGraph, start: LanePosition, goal: LanePosition, types: frozenset[str]):
    """A search of its own, from the start on: length and lanes of the way, None: there is none."""
    first, last = graph.key(start), graph.key(goal)
    heap = []
    for sign in graph.signs(first):
        driven = DrivenLane(first, sign)
        if first == last and sign * (goal.s_m - start.s_m) >= 0.0:
            return abs(goal.s_m - start.s_m), (driven,)
        heap.append((abs(graph.end(driven) - start.s_m), 1, (driven,), False))
    heapq.heapify(heap)
    done = set()
    while heap:
        length, count, way, arrived = heapq.heappop(heap)
        if arrived:
            return length, way
        if count > 1 and way[-1] in done:
            continue
        if count > 1:
            done.add(way[-1])
        for after in graph.successors(way[-1]):
            key = after.key
            if graph.network.roads[key.road].sections[0].lane(key.lane).type not in types:
                continue
            begin, end = graph.begin(after), graph.end(after)
            if key == last:
                to_goal = length + abs(goal.s_m - begin)
                heapq.heappush(heap, (to_goal, count + 1, (*way, after), True))
            heapq.heappush(heap, (length + abs(end - begin), count + 1, (*way, after), False))
    return None


def _tangle(seed: int) -> LaneGraph:
    """Forty roads of a few lengths whose lanes touch at random, some driven both ways."""
    draw = random.Random(seed)
    both = 'direction="both"'
    lanes = section(
        left=lane(1, link() + WIDTH) + lane(2, link() + WIDTH, "sidewalk"),
        right=lane(-1, link() + WIDTH, more=both) + lane(-2, link() + WIDTH),
    )
    roads = []
    for number in range(40):
        length = draw.choice((10.0, 20.0, 30.0))
        roads.append(road(length, geometry(LINE, length), lanes, road_id=str(number)))
    network = read_network(xodr(*roads, version=(1, 8)), "t")
    ends = [
        (LaneKey(str(number), 0, lane_id), contact)
        for number in range(40)
        for lane_id in (-2, -1, 1, 2)
        for contact in ("start", "end")
    ]
    joints: dict = {}
    for _ in range(700):
        one, other = draw.sample(ends, 2)
        joints.setdefault(one, set()).add(other)
        joints.setdefault(other, set()).add(one)
    return LaneGraph(network, {end: tuple(sorted(others)) for end, others in joints.items()})


@pytest.mark.parametrize("seed", range(3))
def test_one_search_from_the_goal_finds_what_a_search_from_each_start_does(seed):
    graph = _tangle(seed)
    types = frozenset({"driving"})
    found = missing = 0
    for goal in (
        LanePosition("0", -1, 5.0),
        LanePosition("7", 1, 0.0),
        LanePosition("9", -2, 10.0),
    ):
        ways = graph.ways_to(goal, types)
        for number in range(40):
            for lane_id in (-2, -1, 1, 2):
                for s_m in (0.0, 5.0):
                    start = LanePosition(str(number), lane_id, s_m)
                    route = ways.route_from(start)
                    expected = _forwards(graph, start, goal, types)
                    if expected is None:
                        assert route is None
                        missing += 1
                        continue
                    found += 1
                    assert route is not None
                    lanes = tuple(step.lane for step in route.steps)
                    assert (route.length_m, lanes) == expected
                    assert sum(abs(s.to_s_m - s.from_s_m) for s in route.steps) == route.length_m
    assert found > 300
    assert missing > 0


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
