"""esmini, a player of OpenSCENARIO that nobody here wrote, and comparisons with it."""

from __future__ import annotations

import csv
import gzip
import math
import re
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from twin.play.playing import PlayedScenario
from twin.scenario.storyboard.program.conditions import ElementState
from twin.scenario.storyboard.program.program import ElementKind, Program

SHARED = Path(__file__).parents[2].parent / "shared"
FILES = SHARED / "data" / "openscenario"
ESMINI = SHARED / "oracle" / "esmini"
STEP_S = 0.01
_CHANGE = re.compile(r"\[(\d+\.\d+)\] \[\w+\] (.+) (\w+) -> (\w+)Transition -> (\w+)State$")
_COLUMNS = {
    "World_Position_X [m]": "x",
    "World_Position_Y [m]": "y",
    "World_Heading_Angle [rad]": "heading",
    "Current_Speed [m/s]": "speed",
}

Pose = tuple[float, float, float, float]
"""x, y [m], heading [rad], speed [m/s]."""
Trace = dict[str, dict[int, Pose]]
"""Poses by entity and step."""
Changes = dict[str, list[tuple[str, int]]]
"""Starts and ends of storyboard elements by name: ``start`` or ``end``, and the step."""


@dataclass(frozen=True)
class EsminiRun:
    """What esmini did with a file."""

    trace: Trace
    changes: Changes
    last_step: int


def run_esmini(file: Path, folder: Path, extra: Sequence[str] = ()) -> EsminiRun:
    """Play a file with esmini, with its log and its table of poses switched on."""
    log, table = folder / "log.txt", folder / "poses.csv"
    command = [ESMINI, "--osc", file, "--headless", "--fixed_timestep", STEP_S, "--disable_stdout"]
    outputs = ["--logfile_path", log, "--csv_logger", table]
    subprocess.run(
        [str(word) for word in (*command, *outputs, *extra)],
        cwd=folder,
        capture_output=True,
        timeout=120,
        check=True,
    )
    log = log if log.exists() else next(folder.glob("log*.txt"))
    table = table if table.exists() else next(folder.glob("poses*.csv"))
    trace = _trace(table.read_text(errors="replace").splitlines())
    lines = log.read_text(errors="replace").splitlines()
    log.unlink()
    table.unlink()
    return EsminiRun(trace, _changes(lines), max(max(rows) for rows in trace.values()))


def _trace(lines: Sequence[str]) -> Trace:
    head = next(i for i, line in enumerate(lines) if line.startswith("Index"))
    columns: dict[int, dict[str, int]] = defaultdict(dict)
    for index, name in enumerate(lines[head].split(",")):
        match = re.match(r"#(\d+) (.*)", name.strip())
        if match:
            columns[int(match[1])][match[2].strip()] = index
    trace: Trace = defaultdict(dict)
    for line in lines[head + 1 :]:
        values = [value.strip() for value in line.split(",")]
        step = round(float(values[1]) / STEP_S)
        for column in columns.values():
            # Entities that were deleted leave their columns.
            if column["World_Heading_Angle [rad]"] >= len(values):
                continue
            pose = tuple(float(values[column[name]]) for name in _COLUMNS)
            trace[values[column["Entity_Name [-]"]]][step] = pose  # type: ignore[assignment]
    return trace


def _changes(lines: Iterable[str]) -> Changes:
    changes: Changes = defaultdict(list)
    for line in lines:
        match = _CHANGE.match(line)
        if match is None or match[2].startswith("Init "):
            continue
        if match[4] in ("start", "end", "stop") and (match[3], match[4]) != (
            "standbyState",
            "stop",
        ):
            kind = "start" if match[4] == "start" else "end"
            changes[match[2]].append((kind, round(float(match[1]) / STEP_S)))
    return changes


def given_trace(name: str) -> Trace:
    """A trace that was given, ``ncap/CBFA``; its rows may be every fifth or tenth step."""
    trace: Trace = defaultdict(dict)
    with gzip.open(FILES / "reference" / f"{name}.csv.gz", "rt") as file:
        for row in csv.DictReader(file):
            step = round(float(row["time_s"]) / STEP_S)
            pose = (row["x_m"], row["y_m"], row["heading_rad"], row["speed_mps"])
            trace[row["entity"]][step] = tuple(map(float, pose))  # type: ignore[assignment]
    return trace


def changes_of(played: PlayedScenario) -> Changes:
    """Starts and ends of our elements; what runs when the storyboard stops ends then."""
    changes: Changes = defaultdict(list)
    program: Program = played.program
    running: dict[int, None] = {}
    last = 0
    for transition in played.transitions:
        element = program.elements[transition.element]
        name = element.name if element.kind is not ElementKind.STORYBOARD else "storyBoard"
        last = transition.step
        if transition.state is ElementState.START_TRANSITION:
            changes[name].append(("start", transition.step))
            running[transition.element] = None
        elif transition.element in running:
            changes[name].append(("end", transition.step))
            del running[transition.element]
    for number in running if played.finished else ():
        changes[program.elements[number].name].append(("end", last))
    return changes


@dataclass(frozen=True)
class EsminiOwn:
    """What of a file esmini does in a way of its own; docs/openscenario.md says why."""

    without: tuple[str, ...] = ()
    """Entities that are not compared."""
    chords: tuple[str, ...] = ()
    """Entities on clothoids, which esmini follows along chords of 1 m."""
    elements: tuple[str, ...] = ()
    """Beginnings of names of storyboard elements whose times are not compared."""


CHORD_M, CHORD_DEG = 0.0142, 0.13
"""How far chords of 1 m lie from a circle of 9 m radius, 1 m^2 / (8 * 9 m), and how far their ends
turn from a spiral, beside the four decimals of a trace."""

NOTHING = EsminiOwn()
_TURNING = EsminiOwn(chords=("Ego",), elements=("TurnSignal", "NCAP_CA-FC_CCFtap"))
_OWN = {
    "alks_": EsminiOwn(without=("Ego",)),
    "NCAP_AEB_VRU_CBFA": EsminiOwn(without=("ObstructionLarge", "ObstructionSmall")),
    "CBFA": EsminiOwn(without=("ObstructionLarge", "ObstructionSmall")),
    "NCAP_AEB_C2C_CCFtap": _TURNING,
    "NCAP_AEB_VRU_CPTA": _TURNING,
    "CCFtap": _TURNING,
    "CMFtap": _TURNING,
}


def own_of(name: str) -> EsminiOwn:
    """What esmini does in its own way in a file, by the beginning of its name."""
    return next((own for start, own in _OWN.items() if name.startswith(start)), NOTHING)


@dataclass(frozen=True)
class Difference:
    """How far two players are apart."""

    name: str
    entities: int
    distance_m: float
    """Largest of all entities and rows, without those on chords."""
    heading_deg: float
    chord_m: float
    chord_deg: float
    """Largest of entities on chords."""
    where: str
    """Entity and time of the largest distance."""
    event_steps: int
    """Largest difference of event times."""
    event: str
    """The element that has it, or one that only one of the players knows."""
    end_steps: int
    """Difference of the last steps."""

    @property
    def agrees(self) -> bool:
        """Within 1 cm, 0.1 degree and one step, and no further from esmini's chords than they
        lie from the curve."""
        return (
            self.distance_m <= 0.01
            and self.heading_deg <= 0.1
            and self.chord_m <= CHORD_M
            and self.chord_deg <= CHORD_DEG
            and self.event_steps <= 1
            and self.end_steps <= 1
        )


def difference(
    name: str,
    played: PlayedScenario,
    trace: Trace,
    changes: Changes,
    own: EsminiOwn = NOTHING,
) -> Difference:
    """Compare what was played with a trace, at the rows that both have."""
    ours: Trace = defaultdict(dict)
    for row in played.rows:
        pose = (row.x_m, row.y_m, row.heading_rad, row.speed_mps)
        ours[row.entity][round(row.time_s / STEP_S)] = pose
    worst = {True: [0.0, 0.0], False: [0.0, 0.0]}
    where, compared, last = "", set(), max(max(rows) for rows in trace.values())
    for entity, rows in trace.items():
        limits = worst[entity in own.chords]
        for step, (x, y, heading, _) in rows.items() if entity not in own.without else ():
            mine = ours[entity].get(step)
            if mine is None:
                if step < min(played.steps, last):
                    worst[False], where = [math.inf, 0.0], f"{entity} misses {step * STEP_S:.2f} s"
                continue
            compared.add(entity)
            distance = math.hypot(mine[0] - x, mine[1] - y)
            if distance > max(worst[True][0], worst[False][0]):
                where = f"{entity} {step * STEP_S:.2f} s"
            apart = math.degrees(abs(math.remainder(mine[2] - heading, 2.0 * math.pi)))
            limits[:] = max(limits[0], distance), max(limits[1], apart)
    steps, event = _apart(changes_of(played), changes, own.elements)
    # The last row of a trace may be some steps before the end.
    late = max(abs(played.steps - last) - (_stride(trace) - 1), 0) if played.finished else 0
    return Difference(name, len(compared), *worst[False], *worst[True], where, steps, event, late)


def _stride(trace: Trace) -> int:
    steps = sorted(next(iter(trace.values())))
    return steps[1] - steps[0]


def _apart(ours: Changes, theirs: Changes, without: tuple[str, ...]) -> tuple[int, str]:
    worst, event = 0, ""
    for name in sorted({*ours, *theirs}):
        if without and name.startswith(without):
            continue
        mine, other = sorted(ours.get(name, [])), sorted(theirs.get(name, []))
        if [kind for kind, _ in mine] != [kind for kind, _ in other]:
            return 10**6, f"{name}: {mine[:4]} here, {other[:4]} there"
        for (_, step), (_, their_step) in zip(mine, other, strict=True):
            if abs(step - their_step) > worst:
                worst, event = abs(step - their_step), f"{name} {step}, there {their_step}"
    return worst, event
