"""Start positions on lanes and roads, against the traces of another player (esmini)."""

from __future__ import annotations

import csv
import gzip
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_walks import Walks

from twin.road.opendrive.reading.load import load_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.scenario import EffectiveScenario, expand, read_scenario

FILES = Path(__file__).parents[3] / "shared" / "data" / "openscenario"
pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")

STANDARD = FILES / "ncap/OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange"
KINDS = ("LanePosition", "RoadPosition", "RelativeLanePosition", "RelativeRoadPosition")
TRACE_M = 1e-4
"""Half of the last digit of x, y and z in a trace, and the bound of the tables."""
TRACE_RAD = 6e-5


def scenarios() -> Iterator[tuple[Path, EffectiveScenario]]:
    """Every reference trace with its scenario."""
    for folder in ("ncap", "alks"):
        for trace in sorted((FILES / "reference" / folder).glob("*.csv.gz")):
            name = trace.name.removesuffix(".csv.gz")
            paths = [p for p in FILES.rglob(f"{name}.xosc") if "Variations" not in p.parts]
            assert len(paths) == 1, name
            yield trace, read_scenario(paths[0])
    for distribution in sorted(STANDARD.glob("*.xosc")):
        element = read_scenario(distribution).root.first("ParameterValueDistribution")
        assert element is not None
        named = element.first("ScenarioFile")
        assert named is not None
        path = distribution.parent / str(named.values["filepath"])
        for permutation in expand(path, distribution):
            name = f"{distribution.stem}-{permutation.number:03d}.csv.gz"
            trace = FILES / "reference/ncap-2026-standard" / name
            if trace.exists():
                yield trace, permutation.scenario()


def positions(scenario: EffectiveScenario) -> Iterator[tuple[str, ScenarioElement]]:
    """Entities that Init puts on roads, each position that of its last teleport."""
    for element in scenario.root.walk():
        if element.name != "Private":
            continue
        teleports = [e for e in element.walk() if e.name == "TeleportAction"]
        if teleports and (position := teleports[-1].children[0].children[0]).name in KINDS:
            yield str(element.values["entityRef"]), position


def road_file(scenario: EffectiveScenario) -> Path:
    """Its OpenDRIVE file."""
    logic = next(e for e in scenario.root.walk() if e.name == "LogicFile")
    return (logic.file.parent / str(logic.values["filepath"])).resolve()


class RoadStart(NamedTuple):
    """Where an entity stands; lane 0: at t, not on a lane."""

    road: int
    s_m: float
    lane: int
    t_m: float


def placed(
    walks: Walks, position: ScenarioElement, others: dict[str, RoadStart]
) -> RoadStart | None:
    """The place that a position says; None: it is relative to what stands on no road."""
    values = position.values
    base = others.get(str(values.get("entityRef", "")))
    if position.name.startswith("Relative"):
        if base is None:
            return None
        s = base.s_m + float(values["ds"])
        if position.name == "RelativeRoadPosition":
            return RoadStart(base.road, s, 0, base.t_m + float(values["dt"]))
        row = walks.lanes(base.road, base.s_m, lane=base.lane, steps=int(values["dLane"]))[0]
        road, lane = base.road, int(row[7])
    else:
        road, s = walks.tables.road_number(str(values["roadId"])), float(values["s"])
        if position.name == "RoadPosition":
            return RoadStart(road, s, 0, float(values["t"]))
        lane = int(values["laneId"])
    middle = float(walks.lanes(road, s, lane=lane)[0, 0])
    return RoadStart(road, s, lane, middle + float(values.get("offset", 0.0)))


def start(walks: Walks, position: ScenarioElement, place: RoadStart) -> np.ndarray:
    """x, y, z, heading of a position."""
    row = walks.lanes(place.road, place.s_m, lane=place.lane)[0]
    slope = row[1] if place.lane else 0.0
    pose = walks.pose(place.road, place.s_m, place.t_m, slope)[0]
    turn = position.first("Orientation")
    heading = pose[3] + (math.pi if row[5] < 0.0 else 0.0)
    if turn is not None:
        base = heading if turn.values.get("type", "absolute") == "relative" else 0.0
        heading = base + float(turn.values.get("h", 0.0))
    return np.array([*pose[:3], heading])


@pytest.mark.slow
def test_starts_are_those_of_the_traces():
    walks: dict[Path, Walks] = {}
    off, turned, folders = [], [], []
    for trace, scenario in scenarios():
        path = road_file(scenario)
        if path not in walks:
            walks[path] = Walks(road_tables(load_network(path)))
        with gzip.open(trace, "rt") as file:
            rows = [row for row in csv.DictReader(file) if float(row["time_s"]) == 0.0]
        by_entity = {row["entity"]: row for row in rows}
        # Some scenarios then move who stands relative to others before the first step.
        moved = any(e.name == "LongitudinalDistanceAction" for e in scenario.root.walk())
        places: dict[str, RoadStart] = {}
        for entity, position in positions(scenario):
            place = placed(walks[path], position, places)
            if place is None or (moved and position.name.startswith("Relative")):
                continue
            places[entity] = place
            mine = start(walks[path], position, place)
            row = by_entity[entity]
            theirs = [float(row[k]) for k in ("x_m", "y_m", "z_m")]
            off.append(math.dist(mine[:3], theirs))
            turned.append(abs(math.remainder(mine[3] - float(row["heading_rad"]), 2.0 * math.pi)))
            folders.append(trace.parent.name)
    print(f"{len(off)} starts: at most {max(off):.1e} m and {max(turned):.1e} rad")
    counts = {name: folders.count(name) for name in sorted(set(folders))}
    assert counts == {"alks": 28, "ncap": 23, "ncap-2026-standard": 226}
    assert max(off) < TRACE_M
    assert max(turned) < TRACE_RAD
