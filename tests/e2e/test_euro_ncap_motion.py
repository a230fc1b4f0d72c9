"""Scenarios of ``euro-ncap-2026`` move as the unchanged files of others do.

Every row is played beside the permutations that it stands for. The car there is a Golf: it is the
ego, and where our numbers are for the shipped car, they are set to what they are for that one.
Compared is how far the target is at each time until both would have met, and where parked cars
stand: of targets that cross seen from the ego's front at the beginning, of those in its lane from
where they start.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from conductor.run.source import load
from schemas.case import Case
from schemas.sections.trial import Trial
from twin.play.playing import PlayedScenario, play_programs
from twin.road.tables.road_tables import RoadTables, road_tables
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.compile.compiler import RoadCache, compile_scenario
from twin.scenario.storyboard.native.document import load_native, numbers_of
from twin.scenario.storyboard.openscenario.scenario import expand
from twin.scenario.storyboard.program.actions import NEARLY_STEADY, SynchronizeAction
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.scenario.storyboard.program.program import Program
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.road_scene import road_map

FOLDER = (
    Path(__file__).parents[3]
    / "shared/data/openscenario/ncap/OpenSCENARIO/NCAP/CA-FC_2026/Variations"
)
RANGES = {"standard": ("StandardRange", 428), "extended": ("ExtendedRange", 435)}
"""Tag of groups -> folder of files, and how many cases there are."""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no scenario files at {FOLDER}"),
]
LENGTH_M, WIDTH_M, CENTRE_M = 4.358, 1.815, 1.349
FRONT_M = CENTRE_M + LENGTH_M / 2
"""The Golf: length, width, way from its rear axle to its middle and its front [m]."""


class Ego(NamedTuple):
    """A car: how far its front is before its rear axle, its length and width [m]."""

    front_m: float
    length_m: float
    width_m: float


GOLF, OPENCAV = Ego(FRONT_M, LENGTH_M, WIDTH_M), Ego(4.10, 5.17, 2.02)
BASES = {
    name: name.upper().replace("-", "_")
    for name in (
        *("cpna", "cpfa", "cpla", "cbla", "cpla-fcw", "cbla-fcw"),
        *("cpnco", "cbna", "cbfa", "cbnao"),
    )
} | {
    "ccrs": "CCRs",
    "ccrm": "CCRm",
    "ccrb": "CCRb",
    "cmrs": "CMRs",
    "cmrb": "CMRb",
    "ccfhos": "CCFhos",
    "ccftap": "CCFtap",
    "cmftap": "CMFtap",
    "cccscp": "CCCscp",
    "cmcscp": "CMCscp",
    "ccrs-fcw": "CCRs_FCW",
    "cmrs-fcw": "CMRs_FCW",
}
"""Beginning of a row's name -> file of permutations."""
CROSSING = {"cpna": (0.25, 0.06), "cpfa": (0.25, -0.06), "cpnco": (0.149, 0.0405)}
"""Of those that walk across: half the width, and how far to the left the middle is when met [m]."""
RIDING = {
    "cbna": (11.66, 13.265, 23.38, 17.0, 15.0),
    "cbfa": (9.5, 13.235, 28.38, 22.0, 20.0),
    "cbnao": (13.0, 13.265, 10.88, 4.5, 10.0),
}
"""Of those that ride over the crossroads, met in the middle of the ego's front: where that is then
from the crossroads' beginning on, where the target is, its way there, how long it is steady [m],
and its speed [km/h]."""
BESIDE = {"CBNA": (1.0, 17.0), "CBNAO": (4.8, 3.55)}
"""Where the larger parked car stands as the files' own parameters say: between its side and the
bicycle's, and from the middle of the ego's lane to its rear [m]."""
ACROSS = ("cccscp", "cmcscp")
"""Those that drive straight across the crossroads."""
TURNING = ("ccftap", "cmftap")
"""Those in which the ego turns across the way of an oncoming target."""
EVERY = 5
STEP_S = 0.01


class Track(NamedTuple):
    """Where a target is, seen from the ego's front at the beginning, at every row [rows]."""

    along_m: np.ndarray
    """Of its middle."""
    across_m: np.ndarray
    gap_m: float
    """From bumper to bumper along the lane at the beginning."""
    parked_m: np.ndarray
    """Middles of all others, in their order [cars, along and across]; not of those that vanish."""
    ego_m: np.ndarray
    """How far the rear axle of the ego has come, along and across [rows, 2]."""


def base_of(row: str) -> str:
    return BASES[max((name for name in BASES if row.startswith(name)), key=len)]


def location_of(row: str) -> int:
    """Share of the ego's width at which the middle of the target is hit [%]; below 0 and above 100
    it passes beside the ego."""
    before, _, last = row.removesuffix("-ext").removesuffix("-night").rpartition("-")
    if last.isdigit():
        return -int(last) if before.endswith("-minus") else int(last)
    return 25 if "fcw" in row else 50


def golf_numbers(case: Case, row: str) -> dict[str, float]:
    """Numbers of a case for the Golf."""
    numbers = dict(case.variation.scenario.numbers)
    offset_m = WIDTH_M * (location_of(row) / 100 - 0.5)
    speed_mps = numbers["ego.speed_kmh"] / 3.6
    base, arrive = base_of(row).lower(), "events.cross.do.target.arrive"
    if base in CROSSING:
        # The rear axle starts 6 s before the target's line; the front has to come to its side.
        half_m, left_m = CROSSING[base]
        numbers[f"{arrive}.meet_at.s_m"] = 150 - half_m - LENGTH_M / 2
        way_m = 6 * speed_mps - FRONT_M - half_m
        numbers["ego.s_m"] = numbers[f"{arrive}.meet_at.s_m"] - way_m
        # Of CPFA the share counts from the left, where it comes from.
        aside_m = -offset_m if base == "cpfa" else offset_m
        numbers[f"{arrive}.at.lateral_m"] = -1.75 + aside_m + left_m
        if base == "cpnco":
            lateral_m = -1.75 - 1 - WIDTH_M / 2 - 1.82 / 2
            numbers |= {f"actors.{name}.lateral_m": lateral_m for name in ("large", "small")}
    elif base in RIDING:
        # The rear axle starts 6 s before the crossroads.
        front_m, at_m, way_m, steady_m, target_kmh = RIDING[base]
        numbers["ego.s_m"] = 250 - 6 * speed_mps + FRONT_M - LENGTH_M / 2
        numbers[f"{arrive}.meet_at.s_m"] = front_m - LENGTH_M / 2
        numbers[f"{arrive}.at.s_m"] = at_m - offset_m
        if base != "cbnao":
            unsteady_m = way_m - steady_m + (offset_m if base == "cbna" else -offset_m)
            target_mps = target_kmh / 3.6
            time_s = 6 + (front_m - FRONT_M) / speed_mps - steady_m / target_mps
            begins_mps = max(0.0, 2 * unsteady_m / time_s - target_mps)
            numbers["events.cross.do.target.speed_mps"] = begins_mps
    elif base in ACROSS:
        numbers |= across_numbers(numbers, row, GOLF)
    elif base in TURNING:
        # Rear axles are in one place, 15 s before the crossroads.
        numbers["ego.s_m"] = 250 - 15 * speed_mps + CENTRE_M
        numbers[MEET_AFTER] += OPENCAV.front_m - FRONT_M
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


MEET_AFTER = "events.come.do.target.arrive.meet_after_m"


def across_numbers(numbers: Mapping[str, float], row: str, ego: Ego) -> dict[str, float]:
    """Numbers of a target that drives straight across, as the files' parameters give them: a car's
    front has passed the middle of the ego's by a quarter of the car's length when the ego's front
    comes to its side; a motorcycle's front then comes to the ego's side, a tenth of the ego's
    length behind its front."""
    arrive = "events.cross.do.target.arrive"
    speed_mps = numbers["ego.speed_kmh"] / 3.6
    target_mps = numbers[f"{arrive}.speed_kmh"] / 3.6
    near = "nearside" in row
    # From where the crossroads begin: the middles of both lanes, as ego and target see them.
    ego_m, target_m = (13.25, 9.75) if near else (9.75, 13.25)
    if row.startswith("cmcscp"):
        front_m = ego_m + 0.1 * ego.length_m
        middle_m = target_m - ego.width_m / 2 - 2.08 / 2
    else:
        front_m = ego_m - 1.712 / 2
        middle_m = target_m - 4.023 / 4
    return {
        "ego.s_m": 250 + front_m - ego.length_m / 2 - 8 * speed_mps,
        "actors.target.s_m": 250 + middle_m - 0.8 * 8 * target_mps,
        f"{arrive}.meet_at.s_m": front_m - ego.length_m / 2,
        f"{arrive}.at.s_m": 23 - middle_m if near else middle_m,
        f"{arrive}.steady_m": 3.5 * target_mps,
    }


def key_of(file: str, values: Mapping[str, object]) -> tuple[object, ...]:
    """What tells permutations of a file apart."""
    if file.lower() in ACROSS + TURNING:
        side = int(str(values.get("ImpactSide", 0)))
        speeds = (values["Ego_speed_kph"], values["Target_final_speed_kph"])
        return side, *(round(float(str(speed))) for speed in speeds)
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
    if base_of(row).lower() in ACROSS + TURNING:
        side = -1 if "nearside" in row else 1 if "farside" in row else 0
        event = "cross" if base_of(row).lower() in ACROSS else "come"
        target = numbers[f"events.{event}.do.target.arrive.speed_kmh"]
        return side, round(numbers["ego.speed_kmh"]), round(target)
    moves = row.startswith(("ccrm", "ccfhos"))
    target = numbers["actors.target.speed_kmh"] if moves else 0
    return (
        round(numbers["ego.speed_kmh"]),
        location_of(row),
        round(target),
        case.variation.time_of_day_min > 20 * 60,
    )


def track_of(played: PlayedScenario, *, from_axle: bool = False) -> Track:
    """The track of the target of a program, whose ego drives along x at first; ``from_axle``: seen
    from the ego's rear axle."""
    entities = played.program.entities
    ego = next(e for e in entities if e.ego)
    target = next(e for e in entities if e.name.lower() in ("target", "vru"))
    start = next(r for r in played.rows if r.entity == ego.name)
    front = start.x_m
    if not from_axle:
        front += ego.box.centre_x_m + ego.box.length_m / 2
    along, across = middles(played, target, front, start.y_m)
    heading = next(r.heading_rad for r in played.rows if r.entity == target.name)
    half = abs(math.cos(heading)) * target.box.length_m / 2
    half += abs(math.sin(heading)) * target.box.width_m / 2
    others = sorted((e.name, e) for e in entities if e.name not in (ego.name, target.name))
    parked = [middles(played, other, front, start.y_m) for _, other in others]
    parked = [(x, y) for x, y in parked if len(x) == len(along)]
    way = [(r.x_m - start.x_m, r.y_m - start.y_m) for r in played.rows if r.entity == ego.name]
    gap_m = along[0] - half
    return Track(along, across, gap_m, np.array([[x[0], y[0]] for x, y in parked]), np.array(way))


def middles(
    played: PlayedScenario, entity: StoryboardEntity, front_m: float, lane_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where the middle of an entity is, along and across [rows]."""
    rows = [r for r in played.rows if r.entity == entity.name]
    heading, ahead_m = np.array([r.heading_rad for r in rows]), entity.box.centre_x_m
    x, y = np.array([r.x_m for r in rows]), np.array([r.y_m for r in rows])
    return (
        x + ahead_m * np.cos(heading) - front_m,
        y + ahead_m * np.sin(heading) - lane_m,
    )


def play(programs: list[Program], roads: RoadTables | None) -> list[PlayedScenario]:
    return play_programs(programs, roads, step_s=STEP_S, every=EVERY, until_s=60.0)


@pytest.mark.parametrize("tag", RANGES)
def test_rows_move_as_the_files_of_others(tag: str) -> None:
    plan = load("euro-ncap-2026").rows([tag])
    folder, count = RANGES[tag]
    cases = defaultdict(list)
    for case in plan.cases:
        trial: Trial = case.variation.scenario.trial
        cases[base_of(trial.row)].append((trial.row, case))
    assert sum(map(len, cases.values())) == count
    cache: RoadCache = {}
    for file, members in cases.items():
        variations = FOLDER / folder / f"{file}.xosc"
        base = "CBLA" if file[:4] in ("CPLA", "CBLA") else "CPNA" if file == "CPFA" else file
        base = "CCRs" if file[:3] in ("CCR", "CMR") else base
        base = f"CC{file[2:]}" if file.lower() in ACROSS + TURNING else base
        permutations = expand(FOLDER.parent / f"{base}.xosc", variations)
        by_key = {key_of(file, p.values): p for p in permutations}
        assert len(by_key) == len(permutations) == len(members), file
        theirs = play_all(
            [
                going_on(compile_scenario(by_key[key_of_case(case, row)].scenario(), cache))
                for row, case in members
            ]
        )
        mine = play_ours(members)
        for (row, case), own, other in zip(members, mine, theirs, strict=True):
            compare(row, case, own, other)
        for offset in OFFSETS.get(file, ()):
            offset_is_seen(members[0], theirs[0], offset)


def going_on(program: Program) -> Program:
    """The program without the step for which esmini may let a target stand before it is steady."""
    elements = [
        msgspec.structs.replace(
            element, action=msgspec.structs.replace(element.action, steady_slack=NEARLY_STEADY)
        )
        if isinstance(element.action, SynchronizeAction)
        else element
        for element in program.elements
    ]
    return msgspec.structs.replace(program, elements=tuple(elements))


def play_ours(
    members: Sequence[tuple[str, Case]], more: Mapping[str, float] = MappingProxyType({})
) -> list[PlayedScenario]:
    """Cases with the Golf; ``more`` is added to numbers of them."""
    golf = msgspec.structs.replace(
        load_vehicle("opencav"),
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        rear_overhang_m=LENGTH_M / 2 - CENTRE_M,
    )
    ours = []
    for row, case in members:
        name = case.variation.scenario.storyboard
        numbers = golf_numbers(case, row)
        numbers |= {key: numbers[key] + offset for key, offset in more.items()}
        loaded = load_storyboard(name, numbers, golf)
        ours.append((loaded.program, road_tables_of(loaded.road)))
    return play([program for program, _ in ours], ours[0][1])


OFFSETS: dict[str, tuple[dict[str, float], ...]] = {
    # By 2 cm, or in a radius that is 5 % larger.
    "CCFtap": ({"actors.target.s_m": 0.02}, {MEET_AFTER: 0.02}, {"ego.curve.1.2": -0.005}),
    "CMCscp": (
        {"events.cross.do.target.arrive.at.s_m": 0.02},
        {"events.cross.do.target.arrive.steady_m": 1.0},
    ),
}
"""What the first permutation of a file is changed by to see whether it is caught."""


def offset_is_seen(
    member: tuple[str, Case], other: PlayedScenario, offset: Mapping[str, float]
) -> None:
    """Whoever is elsewhere is caught."""
    row, case = member
    (own,) = play_ours([member], offset)
    with pytest.raises(AssertionError):
        compare(row, case, own, other)


def test_numbers_of_those_that_drive_across_are_for_the_shipped_car() -> None:
    """Within 1 mm; the other test has a Golf."""
    count = 0
    for case in load("euro-ncap-2026").cases:
        trial: Trial = case.variation.scenario.trial
        if trial.row[:6] in ACROSS:
            numbers = case.variation.scenario.numbers
            shipped = numbers_of(load_native(case.variation.scenario.storyboard))
            for key, number in across_numbers(numbers, trial.row, OPENCAV).items():
                assert abs(numbers.get(key, shipped[key]) - number) < 1e-3, (case.id, key)
            count += 1
    assert count == 132


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
    turns = base_of(row).lower() in TURNING
    mine, theirs = (track_of(one, from_axle=turns) for one in (own, other))
    assert mine.parked_m.shape == theirs.parked_m.shape, row
    if base_of(row) in BESIDE:
        # Beyond the junction their lane -1 is the bicycle's own, so there the cars hide nothing.
        clear_m, aside_m = BESIDE[base_of(row)]
        large = mine.parked_m[0]
        assert abs(mine.along_m[0] - 0.25 - (large[0] + 0.91) - clear_m) < 0.01, row
        assert abs(-(large[1] + 4.418 / 2) - aside_m) < 0.01, row
    else:
        assert np.abs(mine.parked_m - theirs.parked_m).max(initial=0.0) < 0.01, row
    rows = min(len(mine.along_m), len(theirs.along_m))
    # Until they meet: after that the files of others go on differently.
    speed_mps = case.variation.scenario.numbers["ego.speed_kmh"] / 3.6
    gap = theirs.gap_m + theirs.along_m - theirs.along_m[0]
    gap -= speed_mps * STEP_S * EVERY * np.arange(len(theirs.along_m))
    near = np.flatnonzero(gap[:rows] < 0.0)
    until = int(near[0]) if len(near) else rows
    if turns:
        meets_s = case.variation.scenario.numbers[MEET_AFTER] / speed_mps
        until = min(rows, math.ceil(meets_s / (STEP_S * EVERY)))
        apart = np.abs(mine.ego_m[:until] - theirs.ego_m[:until])
        assert apart.max() < 0.01, (case.id, "ego", float(apart.max()))
    assert until > 2.0 / (STEP_S * EVERY), row
    if base_of(row).lower() not in {*CROSSING, *RIDING, *ACROSS, *TURNING}:
        # Ours may begin later, at the same closing speed.
        mine.along_m[:] -= mine.along_m[0]
        theirs.along_m[:] -= theirs.along_m[0]
    for name in ("along_m", "across_m"):
        apart = np.abs(getattr(mine, name)[:until] - getattr(theirs, name)[:until])
        assert apart.max() < 0.01, (case.id, name, float(apart.max()), int(apart.argmax()))
