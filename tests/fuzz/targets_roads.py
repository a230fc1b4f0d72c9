"""Road files, as far as the tables of kernels."""

from __future__ import annotations

from fuzz_target import Target

from twin.road.opendrive.check_network import network_mistakes
from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import road_tables


def _road(data: bytes) -> object:
    network = read_network(data, "r.xodr")
    assert network_mistakes(network) == [], "a reader apart would be taken for a liar"
    find_gaps(network, RoadMap(network).frames)
    return road_tables(network)


TARGETS = {"opendrive": Target(_road, (ValueError,), cost=20)}
