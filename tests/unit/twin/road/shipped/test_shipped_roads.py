"""Shipped roads are what their plans write, have no gaps, and lead where they should."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml")

from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.lane_graph import LanePosition, lane_graph
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.shipped.library import (
    FOLDER,
    NETWORKS_MAX,
    road_path,
    roads_of,
    shipped_roads,
    write_roads,
)
from twin.road.shipped.plans import PLANS
from twin.road.shipped.xml_parts import number


@pytest.fixture(scope="module", params=sorted(PLANS))
def roads(request) -> RoadMap:
    return RoadMap(load_network(road_path(request.param, Path())))


def test_files_are_what_the_plans_write(tmp_path):
    write_roads(tmp_path)
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert written == {path.name: path.read_bytes() for path in FOLDER.glob("*.xodr")}
    assert shipped_roads() == tuple(sorted(PLANS))
    assert len(PLANS) >= 7


def test_nothing_is_left_out_and_nothing_gapes(roads):
    assert roads.network.notes == ()
    assert find_gaps(roads.network, roads.frames) == []


def test_lanes_meet_where_a_junction_begins_and_ends():
    """Reference lines that meet say nothing of lanes, which have offsets of their own."""
    roads = RoadMap(load_network(road_path("junction", Path())))
    worst = 0.0
    graph = lane_graph(roads.network)
    count = 0
    for (key, contact), others in graph.joints.items():
        one = _lane_end(roads, key, contact)
        for other_key, other_contact in others:
            other = _lane_end(roads, other_key, other_contact)
            worst = max(worst, math.dist(one[:2], other[:2]))
            assert abs(math.sin(one[2] - other[2])) < 1e-6
            count += 1
    assert count == 2 * (12 * 2 + 4 * 2)  # both ways: 12 lanes, and four footways round corners
    assert worst < 1e-6


def _lane_end(roads, key, contact):
    frame = roads.frame(key.road)
    s = 0.0 if contact == "start" else frame.road.length_m
    pose = frame.lane_pose(key.lane, s)
    return float(pose.x_m), float(pose.y_m), float(pose.heading_rad)


@pytest.mark.parametrize(
    ("start", "goal", "through"),
    [
        (LanePosition("0", -1, 100.0), LanePosition("1", 1, 100.0), "10"),
        (LanePosition("0", -2, 100.0), LanePosition("2", 1, 100.0), "11"),
        (LanePosition("0", -2, 100.0), LanePosition("3", 1, 100.0), "12"),
        (LanePosition("3", -2, 100.0), LanePosition("1", 1, 100.0), "41"),
    ],
)
def test_ways_through_the_junction(start, goal, through):
    route = lane_graph(load_network(road_path("junction", Path()))).route(start, goal)
    assert route is not None
    assert [step.lane.key.road for step in route.steps] == [start.road, through, goal.road]


def test_a_turning_lane_only_turns():
    graph = lane_graph(load_network(road_path("junction", Path())))
    assert graph.route(LanePosition("0", -1, 100.0), LanePosition("2", 1, 100.0)) is None


def test_the_paved_middle_of_the_junction_has_no_holes():
    roads = RoadMap(load_network(road_path("junction", Path())))
    x, y = np.meshgrid(np.linspace(-4.8, 4.8, 49), np.linspace(-15.9, 15.9, 160))
    assert (roads.lane_under(x, y).road >= 0).all()
    assert (roads.lane_under(y, x).road >= 0).all()


def test_curves_of_the_rural_road_lean_inwards():
    frame = RoadMap(load_network(road_path("rural", Path()))).frame("0")
    s = np.linspace(0.0, 1150.0, 2301)
    curvature, roll = frame.curvature(s), frame.pose(s).roll_rad
    # Roll to the right is positive; a curve to the left has a positive curvature.
    assert (curvature * roll <= 1e-12).all()
    assert np.degrees(np.abs(roll)).max() == pytest.approx(3.0, abs=0.01)
    assert np.abs(np.diff(frame.pose(s).z_m)).max() < 0.051 * 0.5


def test_a_road_that_is_not_shipped_is_one_line():
    with pytest.raises(
        ValueError, match=r"^road 'motorwy' is not shipped; did you mean 'motorway'"
    ):
        road_path("motorwy", Path())


def test_paths_are_relative_to_the_folder():
    assert road_path("town.xodr", Path("/data")) == Path("/data/town.xodr")
    assert road_path("/other/town.xodr", Path("/data")) == Path("/other/town.xodr")


@pytest.mark.parametrize(("value", "text"), [(0.0, "0"), (-1e-12, "0"), (1.5, "1.5"), (2.0, "2")])
def test_numbers_are_short(value, text):
    assert number(value) == text


def test_a_file_of_others_is_read_once_per_content(tmp_path):
    path = tmp_path / "mine.xodr"
    content = road_path("track", FOLDER).read_bytes()
    path.write_bytes(content)
    first = roads_of(path)
    assert roads_of(path) is first
    path.write_bytes(content.replace(b'name="track"', b'name="other"'))
    assert roads_of(path) is not first
    with pytest.raises(ValueError, match="No such file"):
        roads_of(tmp_path / "none.xodr")
    for copy in range(NETWORKS_MAX):
        other = tmp_path / f"{copy}.xodr"
        other.write_bytes(content)
        roads_of(other)
    path.write_bytes(content)
    assert roads_of(path) is not first
