"""twin.road.tables: what the tables of a network hold, and when there are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, WIDTH, end, geometry, lane, link, road, section, xodr
from road_networks import TURN_M, junction, shapes, turned

from twin.road.opendrive.lane_graph import LanePosition, lane_graph
from twin.road.opendrive.reading.reader import read_network
from twin.road.tables.road_tables import LANE_COLUMNS, RoadTables, flat_tables, road_tables
from twin.road.tables.way_lengths import ROADS_MAX


def ways_from(tables: RoadTables, road_id: str, at_end: bool) -> list[tuple[str, int, int]]:
    """Road, contact, told of the ways on from an end."""
    number = 2 * tables.road_ids.index(road_id) + at_end
    first = tables.ways.first
    rows = tables.ways.ways[first[number] : first[number + 1]].tolist()
    return [(tables.road_ids[row[0]], row[1], row[2]) for row in rows]


def test_ways_through_a_junction_and_back():
    tables = road_tables(junction())
    assert ways_from(tables, "0", True) == [("4", 0, 1), ("5", 0, 1), ("6", 0, 1)]
    assert ways_from(tables, "0", False) == []
    assert ways_from(tables, "4", True) == [("1", 0, 1)]
    # No connection tells the way from a leg back; the connecting road does.
    assert ways_from(tables, "1", False) == [("4", 1, 0)]
    assert tables.ways.junctions.tolist() == [-1, 0, 0, -1, 0, -1, 0, -1, *[-1] * 6]
    np.testing.assert_allclose(tables.ways.turns_rad[:3], [math.pi / 2, 0.0, math.pi / 2])


def test_ways_between_roads_that_meet_head_on():
    tables = road_tables(turned())
    assert ways_from(tables, "0", True) == [("1", 1, 1)]
    assert ways_from(tables, "1", False) == [("2", 0, 1)]
    assert ways_from(tables, "1", True) == [("0", 1, 1)]


def test_a_direct_junction_leads_on_without_a_connecting_road():
    """Of the roads that leave it the one ahead is straight 20 m into it, whatever follows."""
    bend = geometry(LINE, 25.0, 0.0, (50.0, 0.0, 0.0))
    bend += geometry('<arc curvature="0.05"/>', 60.0, 25.0, (75.0, 0.0, 0.0))
    away = geometry('<arc curvature="0.01"/>', 85.0, at=(50.0, 0.0, 0.0))
    connections = "".join(
        f'<connection id="{k}" incomingRoad="0" linkedRoad="{name}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for k, name in enumerate(("1", "2"))
    )
    file = xodr(
        road(50.0, link=end("successor", "junction", "9")),
        road(85.0, away, road_id="1", link=end("predecessor", "junction", "9")),
        road(85.0, bend, road_id="2", link=end("predecessor", "junction", "9")),
        f'<junction id="9" name="j" type="direct">{connections}</junction>\n',
    )
    tables = road_tables(read_network(file, "t"))
    assert ways_from(tables, "0", True) == [("1", 0, 1), ("2", 0, 1)]
    np.testing.assert_allclose(tables.ways.turns_rad[:2], [0.2, 0.0], atol=1e-8)


def test_lengths_between_ends():
    tables = road_tables(junction())
    roads = {road_id: number for number, road_id in enumerate(tables.road_ids)}
    leave, enter = 2 * roads["0"] + 1, 2 * roads["1"]
    assert tables.lengths_m[leave, enter] == TURN_M
    assert tables.lengths_m[enter, leave] == TURN_M
    assert tables.lengths_m[leave, 2 * roads["2"]] == 40.0
    assert tables.lengths_m[leave, 2 * roads["5"]] == 0.0
    assert tables.lengths_m[2 * roads["0"], enter] == math.inf


def test_a_ring_comes_round():
    lanes = section(left="", right=lane(-1, link((-1,), (-1,)) + WIDTH))
    ends = end("predecessor", "road", "0", "end") + end("successor", "road", "0", "start")
    length = 2.0 * math.pi * 50.0
    ring = road(length, geometry('<arc curvature="0.02"/>', length), lanes, link=ends)
    tables = road_tables(read_network(xodr(ring), "t"))
    assert tables.lengths_m.tolist() == [[math.inf, 0.0], [0.0, math.inf]]


def test_lanes_follow_those_that_the_file_names():
    tables = road_tables(shapes())
    columns = {name: index for index, name in enumerate(LANE_COLUMNS)}
    ids = [2, 1, -1, -2, -3]
    first = dict(zip(ids, tables.lanes[:5].tolist(), strict=True))
    # Both lanes of the left lead to lane 1; the sidewalk ends.
    assert {i: first[i][columns["after"]] for i in ids} == {2: 1, 1: 1, -1: -1, -2: -2, -3: 0}
    assert {i: first[i][columns["before"]] for i in ids} == dict.fromkeys(ids, 0)
    second = tables.lanes[5:8].tolist()
    assert [row[columns["before"]] for row in second] == [1, -1, -2]
    assert [row[columns["bordered"]] for row in second] == [1, 1, 1]


def test_roads_lie_in_their_boxes():
    tables = road_tables(shapes())
    for number in range(len(tables.road_ids)):
        rows = tables.lines[tables.roads[number, 0] : tables.roads[number + 1, 0]]
        _, x_low, y_low, x_high, y_high, reach = tables.extents[number]
        assert ((rows[:, 1] >= x_low) & (rows[:, 1] <= x_high)).all()
        assert ((rows[:, 5] >= y_low) & (rows[:, 5] <= y_high)).all()
        assert reach > 9.0


def test_a_road_that_bends_too_much_is_refused():
    """Forty roads of 150 turns each, of which every turn takes 128 parts."""
    arc = geometry('<arc curvature="10"/>', 94.0)
    roads = [road(94.0, arc, road_id=f"r{number}") for number in range(40)]
    network = read_network(xodr(*roads), "bent.xodr")
    with pytest.raises(ValueError, match=r"^bent\.xodr: road r\d+: it bends so much") as error:
        road_tables(network)
    assert "\n" not in str(error.value)


def test_a_large_network_has_no_table_of_lengths():
    roads = [road(10.0, road_id=str(number)) for number in range(ROADS_MAX + 1)]
    assert road_tables(read_network(xodr(*roads), "t")).lengths_m.shape == (0, 0)
    assert road_tables(read_network(xodr(*roads[:3]), "t")).lengths_m.shape == (6, 6)


def test_roads_of_a_route_by_number():
    network = junction()
    route = lane_graph(network).route(LanePosition("0", -1, 5.0), LanePosition("3", -1, 30.0))
    assert route is not None
    tables = road_tables(network)
    numbers = tables.route_numbers(route)
    assert numbers.dtype == np.int32
    assert [tables.road_ids[number] for number in numbers.tolist()] == ["0", "6", "3"]
    with pytest.raises(ValueError, match=r"^road nowhere does not exist$"):
        tables.road_number("nowhere")


def test_flat_ground_has_no_rows():
    tables = flat_tables()
    assert tables.road_ids == ()
    assert len(tables.extents) == len(tables.lines) == len(tables.widths) == 0
    assert tables.roads.shape[0] == tables.sections.shape[0] == tables.lanes.shape[0] == 1
