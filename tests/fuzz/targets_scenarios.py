"""Scenario files as far as the tables of the player, and what parsers' processes answer of them."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
from fuzz_target import SEEDS, Target, in_file

from twin.base.errors import UsageError
from twin.road.opendrive.apart import decode_network
from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.lane_graph import lane_graph
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.surface import road_surface
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.apart import answered_program
from twin.scenario.storyboard.check_program import program_mistakes
from twin.scenario.storyboard.compile.compiler import compile_with_notes
from twin.scenario.storyboard.openscenario.element import MISTAKES_MAX
from twin.scenario.storyboard.openscenario.outline import outline
from twin.scenario.storyboard.openscenario.scenario import expand, read_scenario
from twin.scenario.storyboard.player.tables import pack_programs
from twin.scenario.storyboard.program.program import Program

ROADS = SEEDS / "opendrive" / "two-roads"
"""Roads of the seeds: a of 200 m, then b."""


def _scenario(data: bytes) -> object:
    with in_file("s.xosc", data) as path:
        (path.parent / "roads.xodr").write_bytes(ROADS.read_bytes())
        effective = read_scenario(path)
        outline(effective, [])
        program = compile_with_notes(effective).program
    assert program_mistakes(program) == []
    sent = msgspec.msgpack.encode(program)
    assert msgspec.msgpack.encode(msgspec.msgpack.decode(sent, type=Program)) == sent
    return pack_programs([program])


def _distribution(data: bytes) -> object:
    with in_file("d.xosc", data) as path:
        return expand(path.parent / "s.xosc", path)


def _program_answer(data: bytes) -> object:
    """What a process answers of a scenario; whatever is taken can be packed."""
    network = read_network(ROADS.read_bytes(), "r.xodr")
    answer = np.frombuffer(data, np.uint8)
    return pack_programs([answered_program(answer, [network], Path("s.xosc")).program])


def _road_answer(data: bytes) -> object:
    """What a process answers of a road file; whatever is taken can be built."""
    network = decode_network(np.frombuffer(data, np.uint8), Path("r.xodr"))
    roads = RoadMap(network)
    find_gaps(network, roads.frames)
    lane_graph(network)
    return road_tables(network), road_surface(roads)


MISTAKES = MISTAKES_MAX + 1
TARGETS = {
    "openscenario": Target(_scenario, (ValueError, UsageError), lines_max=MISTAKES, cost=20),
    "openscenario-distribution": Target(_distribution, (ValueError,), lines_max=MISTAKES, cost=3),
    "program-answer": Target(_program_answer, (ValueError, UsageError), lines_max=MISTAKES, cost=5),
    "opendrive-answer": Target(_road_answer, (ValueError, UsageError), cost=20),
}
