"""Scenarios of ``euro-ncap-2026`` move as the unchanged files of others do.

Every row is played beside the permutations that it stands for. The car there is a Golf: where our
numbers are for the shipped car, they are set to what they are for that one. Compared is how far the
target has moved from its start, along and across the road, at each time until both would have met,
and the gap and the offset at the beginning.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from conductor.run.source import load
from schemas.case import Case
from schemas.sections.trial import Trial
from twin.play.playing import PlayedScenario, play_programs
from twin.road.tables.road_tables import RoadTables, road_tables
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.compile.compiler import RoadCache, compile_scenario
from twin.scenario.storyboard.openscenario.scenario import expand
from twin.scenario.storyboard.program.program import Program
from twin.world.road_scene import road_map

FOLDER = (
    Path(__file__).parents[3]
    / "shared/data/openscenario/ncap/OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no scenario files at {FOLDER}"),
]
WIDTH_M, FRONT_M = 1.815, 1.349 + 4.358 / 2
"""The Golf: width, and way from its rear axle to its front [m]."""
BASES = {
    name: name.upper().replace("-", "_")
    for name in ("cpna", "cpfa", "cpla", "cbla", "cpla-fcw", "cbla-fcw")
} | {
    "ccrs": "CCRs",
    "ccrm": "CCRm",
    "ccrb": "CCRb",
    "cmrs": "CMRs",
    "cmrb": "CMRb",
    "ccfhos": "CCFhos",
    "ccrs-fcw": "CCRs_FCW",
    "cmrs-fcw": "CMRs_FCW",
}
"""Beginning of a row's name -> file of permutations."""
EVERY = 5
STEP_S = 0.01


class Track(NamedTuple):
    """Where a target is, beside the lane of the ego, at every row [rows]."""

    along_m: np.ndarray
    across_m: np.ndarray
    gap_m: float
    """From bumper to bumper along the lane at the beginning."""


def base_of(row: str) -> str:
    return BASES[max((name for name in BASES if row.startswith(name)), key=len)]


def location_of(row: str) -> int:
    """Share of the ego's width at which the target is hit [%]."""
    last = row.removesuffix("-night").rpartition("-")[2]
    if last.isdigit():
        return int(last)
    return 25 if "fcw" in row else 50


def golf_numbers(case: Case, row: str, ego_length_m: float) -> dict[str, float]:
    """Numbers of a case for the Golf."""
    numbers = dict(case.variation.scenario.numbers)
    offset_m = WIDTH_M * (location_of(row) / 100 - 0.5)
    speed_mps = numbers["ego.speed_kmh"] / 3.6
    if row.startswith(("cpna", "cpfa")):
        near = row.startswith("cpna")
        # The rear axle starts 6 s before the target's line; the front has to come to its side.
        way_m = 6 * speed_mps - FRONT_M - 0.25
        arrive = "events.cross.do.target.arrive"
        numbers[f"{arrive}.meet_at.s_m"] = 150 - 0.25 - ego_length_m / 2
        numbers["ego.s_m"] = numbers[f"{arrive}.meet_at.s_m"] - way_m
        numbers[f"{arrive}.at.lateral_m"] = -1.75 + (offset_m + 0.06) * (1 if near else -1)
    elif row.startswith(("cpla", "cbla")):
        # There from the rear axle to the target's origin, 0.3 m or 0.34 m before its rear.
        back_m = 0.3 if row.startswith("cpla") else 1.89 / 2 - 0.605
        numbers["actors.target.ahead_m"] -= FRONT_M + back_m
        numbers["actors.target.offset_m"] = offset_m
    elif row.startswith("ccfhos"):
        numbers["actors.target.lateral_m"] = -1.75 + offset_m
    else:
        numbers["actors.target.offset_m"] = offset_m
    return numbers


def key_of(file: str, values: Mapping[str, object]) -> tuple[object, ...]:
    """What tells permutations of a file apart."""
    target = values.get("Target_init_speed_kph", 0) if file in ("CCRm", "CCFhos") else 0
    night = values.get("LightingConditions") == "Night"
    return (
        round(float(str(values["Ego_speed_kph"]))),
        round(float(str(values["ImpactLocation"]))),
        round(float(str(target))),
        night,
    )


def key_of_case(case: Case, row: str) -> tuple[object, ...]:
    numbers = case.variation.scenario.numbers
    moves = row.startswith(("ccrm", "ccfhos"))
    target = numbers["actors.target.speed_kmh"] if moves else 0
    return (
        round(numbers["ego.speed_kmh"]),
        location_of(row),
        round(target),
        case.variation.time_of_day_min > 20 * 60,
    )


def track_of(played: PlayedScenario, lane_y_m: float) -> Track:
    """The track of the target of a program, whose ego drives along x."""
    entities = played.program.entities
    ego = next(e for e in entities if e.ego)
    target = next(e for e in entities if e.name.lower() in ("target", "vru"))
    rows = {entity.name: [r for r in played.rows if r.entity == entity.name] for entity in entities}
    x = np.array([r.x_m for r in rows[target.name]])
    y = np.array([r.y_m for r in rows[target.name]])
    first, start = rows[target.name][0], rows[ego.name][0]
    along = math.cos(first.heading_rad)
    middle = first.x_m + target.box.centre_x_m * along
    half = abs(along) * target.box.length_m / 2 + abs(math.sin(first.heading_rad)) * (
        target.box.width_m / 2
    )
    front = start.x_m + ego.box.centre_x_m + ego.box.length_m / 2
    return Track(x - x[0], y - lane_y_m, middle - half - front)


def lane_of(played: PlayedScenario) -> float:
    ego = next(e for e in played.program.entities if e.ego)
    return next(r.y_m for r in played.rows if r.entity == ego.name)


def play(programs: list[Program], roads: RoadTables | None) -> list[PlayedScenario]:
    return play_programs(programs, roads, step_s=STEP_S, every=EVERY, until_s=60.0)


def test_rows_move_as_the_files_of_others() -> None:
    plan = load("euro-ncap-2026")
    cases = defaultdict(list)
    for case in plan.cases:
        trial: Trial = case.variation.scenario.trial
        cases[base_of(trial.row)].append((trial.row, case))
    assert sum(map(len, cases.values())) == 262
    cache: RoadCache = {}
    for file, members in cases.items():
        variations = FOLDER / f"{file}.xosc"
        base = "CBLA" if file[:4] in ("CPLA", "CBLA") else "CPNA" if file == "CPFA" else file
        base = "CCRs" if file[:3] in ("CCR", "CMR") else base
        permutations = expand(FOLDER.parents[1] / f"{base}.xosc", variations)
        by_key = {key_of(file, p.values): p for p in permutations}
        assert len(by_key) == len(permutations) == len(members), file
        theirs = play_all(
            [
                compile_scenario(by_key[key_of_case(case, row)].scenario(), cache)
                for row, case in members
            ]
        )
        ours = []
        for row, case in members:
            name = case.variation.scenario.storyboard
            length_m = load_storyboard(name, {}).program.entities[0].box.length_m
            loaded = load_storyboard(name, golf_numbers(case, row, length_m))
            ours.append((loaded.program, road_tables_of(loaded.road)))
        mine = play([program for program, _ in ours], ours[0][1])
        for (row, case), own, other in zip(members, mine, theirs, strict=True):
            compare(row, case, own, other)


def play_all(programs: list[Program]) -> list[PlayedScenario]:
    """Programs on several roads."""
    results: dict[int, PlayedScenario] = {}
    roads: dict[str, list[int]] = defaultdict(list)
    for number, program in enumerate(programs):
        assert program.network is not None
        roads[program.network.file].append(number)
    for numbers in roads.values():
        network = programs[numbers[0]].network
        assert network is not None
        played = play([programs[n] for n in numbers], road_tables(network))
        results |= dict(zip(numbers, played, strict=True))
    return [results[number] for number in range(len(programs))]


_TABLES: dict[str, RoadTables] = {}


def road_tables_of(road: str) -> RoadTables:
    if road not in _TABLES:
        _TABLES[road] = road_tables(road_map(road).network)
    return _TABLES[road]


def compare(row: str, case: Case, own: PlayedScenario, other: PlayedScenario) -> None:
    mine, theirs = track_of(own, lane_of(own)), track_of(other, lane_of(other))
    rows = min(len(mine.along_m), len(theirs.along_m))
    # Until they meet: after that the files of others go on differently.
    speed_mps = case.variation.scenario.numbers["ego.speed_kmh"] / 3.6
    gap = (
        theirs.gap_m + theirs.along_m - speed_mps * STEP_S * EVERY * np.arange(len(theirs.along_m))
    )
    near = np.flatnonzero(gap[:rows] < 0.0)
    until = int(near[0]) if len(near) else rows
    assert until > 2.0 / (STEP_S * EVERY), row
    for name in ("along_m", "across_m"):
        apart = np.abs(getattr(mine, name)[:until] - getattr(theirs, name)[:until])
        assert apart.max() < 0.01, (case.id, name, float(apart.max()), int(apart.argmax()))
