"""What is said of played scenarios: tables, JSON and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from schemas.escape import escape
from twin.play.playing import PlayedScenario
from twin.scenario.storyboard.program.program import ElementKind, Program

CSV_COLUMNS = ("time_s", "entity", "x_m", "y_m", "z_m", "heading_rad", "speed_mps")
"""Columns of the poses."""
_NAME_CHARS = 400


@dataclass(frozen=True, slots=True)
class NamedPlay:
    """One permutation that was played."""

    name: str
    """Name of its CSV file."""
    permutation: int
    values: Mapping[str, object]
    """Its parameters, as its distribution gives them."""
    notes: tuple[str, ...]
    """What of its file has no effect."""
    played: PlayedScenario


def element_path(program: Program, number: int) -> str:
    """Names from the story down to an element, ``story::act``; of the storyboard ``storyboard``."""
    names: list[str] = []
    while program.elements[number].kind is not ElementKind.STORYBOARD:
        names.append(program.elements[number].name)
        number = program.elements[number].parent
    return "::".join(reversed(names)) or "storyboard"


def event_table(play: NamedPlay, step_s: float, *, by_hand: bool) -> Table:
    """A row per transition of an element; of a file written by hand only of events, because it
    does not say how they are grouped."""
    table = Table("time s", "element", "path", "transition")
    program = play.played.program
    for transition in play.played.transitions:
        element = program.elements[transition.element]
        if by_hand and element.kind not in (ElementKind.EVENT, ElementKind.STORYBOARD):
            continue
        path = element_path(program, transition.element)
        table.add_row(
            f"{transition.step * step_s:.3f}",
            element.kind.name.lower(),
            escape(path, _NAME_CHARS),
            transition.state.name.lower().replace("_transition", ""),
        )
    return table


def end_line(play: NamedPlay, step_s: float) -> str:
    """When playing ended, and why."""
    played = play.played
    end_s = f"{played.steps * step_s:.3f} s"
    if not played.finished:
        return f"still running at {end_s}"
    why = played.ended_by
    if why == f"{played.steps * step_s:g} s":  # a condition on time is named after it
        why = "its time is up"
    return f"ended at {end_s}" + (f": {why}" if why else "")


def summary_table(plays: Sequence[NamedPlay], step_s: float) -> Table:
    """A row per permutation."""
    table = Table("permutation", "parameters", "duration s", "end", "transitions")
    for play in plays:
        values = ", ".join(f"{name}={value}" for name, value in play.values.items())
        table.add_row(
            str(play.permutation),
            escape(values, _NAME_CHARS),
            f"{play.played.steps * step_s:.3f}",
            (play.played.ended_by or "stopped") if play.played.finished else "still running",
            str(len(play.played.transitions)),
        )
    return table


def remarks(plays: Sequence[NamedPlay]) -> list[str]:
    """Notes of all permutations, each once, and limits that were met."""
    notes = dict.fromkeys(note for play in plays for note in play.notes)
    met = [f"{play.name}: {words}" for play in plays for words in play.played.overflows]
    return [*(f"note: {note}" for note in notes), *met]


def to_json(plays: Sequence[NamedPlay], step_s: float) -> list[dict[str, object]]:
    """Everything but the poses, as plain values."""
    return [
        {
            "name": play.name,
            "permutation": play.permutation,
            "values": dict(play.values),
            "notes": list(play.notes),
            "duration_s": round(play.played.steps * step_s, 9),
            "finished": play.played.finished,
            "ended_by": play.played.ended_by,
            "overflows": list(play.played.overflows),
            "transitions": [
                {
                    "time_s": round(transition.step * step_s, 9),
                    "element": element_path(play.played.program, transition.element),
                    "kind": play.played.program.elements[transition.element].kind.name.lower(),
                    "transition": transition.state.name.lower(),
                }
                for transition in play.played.transitions
            ],
        }
        for play in plays
    ]


def csv_text(play: NamedPlay) -> str:
    """The poses of all entities, four decimals."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for row in play.played.rows:
        values = (row.x_m, row.y_m, row.z_m, row.heading_rad, row.speed_mps)
        # -0.0000 is 0.0000.
        writer.writerow(
            [f"{row.time_s:.4f}", row.entity, *(f"{round(value, 4) + 0.0:.4f}" for value in values)]
        )
    return text.getvalue()


def write_csv(out: Path, plays: Sequence[NamedPlay]) -> list[Path]:
    """Write poses: to the file ``out`` of one permutation, into the folder ``out`` of several.

    Raises:
        OSError: it cannot be written.
    """
    if len(plays) == 1:
        out.write_text(csv_text(plays[0]), newline="\n")
        return [out]
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f"{play.name}.csv" for play in plays]
    for path, play in zip(paths, plays, strict=True):
        path.write_text(csv_text(play), newline="\n")
    return paths
