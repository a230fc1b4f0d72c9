"""Road files, as far as the tables of kernels, the triangles of cameras and what stands beside."""

from __future__ import annotations

from fuzz_target import Target

from twin.road.beside.paint import PAINTED, object_paint
from twin.road.beside.placing import roadside_bodies
from twin.road.opendrive.check_network import network_mistakes
from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.surface import road_surface
from twin.road.tables.road_tables import road_tables

BODIES = 200
"""Most bodies that are looked at."""


def _road(data: bytes) -> object:
    network = read_network(data, "r.xodr")
    assert network_mistakes(network) == [], "a reader apart would be taken for a liar"
    roads = RoadMap(network)
    find_gaps(network, roads.frames)
    for body in roadside_bodies(roads)[:BODIES]:
        if body.thing.type in PAINTED:
            object_paint(roads, body)
    return road_tables(network), road_surface(roads)


TARGETS = {"opendrive": Target(_road, (ValueError,), cost=100)}
