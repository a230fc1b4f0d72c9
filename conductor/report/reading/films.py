"""Films of cases, in the folder ``films`` of a run: `viewer` makes them, the page leads to them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from urllib.parse import quote

from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.recorded import TOGETHER, recording_of, run_viewer
from schemas.words import counted
from twin.base.progress import counter

FOLDER = "films"
"""Name of their folder; their files are called by their cases."""
SUFFIX = ".mp4"
FILM_MAX_S = 30.0
"""Longest time that a film may take, beside the time that a viewer has for all [s]."""


def film_addresses(dossier: Dossier) -> dict[str, str]:
    """Case -> address of its film, relative to the page; films that are older than the recording
    of their case are left out."""
    folder = dossier.folder / FOLDER
    try:
        names = set(os.listdir(folder))
    except OSError:
        return {}
    return {
        row.case.id: f"{FOLDER}/{quote(row.case.id + SUFFIX)}"
        for row in dossier.rows
        if row.case.id + SUFFIX in names and _is_new(dossier, row)
    }


def make_films(dossier: Dossier, rows: Iterable[CaseRow]) -> tuple[list[Path], list[str]]:
    """Let `viewer` make the films of cases that have none yet.

    Returns:
        The films that are there now, and lines about those that are not.
    """
    cases = {row.case.id: row for row in rows}
    recorded = [row for row in cases.values() if recording_of(dossier, row) is not None]
    asked = [row for row in recorded if not _is_new(dossier, row)]
    folder = dossier.folder / FOLDER
    errors: dict[str, str] = {}
    if asked:
        folder.mkdir(exist_ok=True)
        turns = -(-len(asked) // TOGETHER)
        with ThreadPoolExecutor(min(len(os.sched_getaffinity(0)), turns)) as pool:
            paths = [
                {row.case.id: _path(dossier, row) for row in asked[turn::turns]}
                for turn in range(turns)
            ]
            more = counter("films", len(asked))
            for outs, told in zip(paths, pool.map(partial(_ask, dossier), paths), strict=True):
                errors.update(told)
                more(len(outs))
    made = [path for row in recorded if (path := _path(dossier, row)).is_file()]
    return made, _lines(len(cases) - len(recorded), errors)


def make_clips(dossier: Dossier, rows: Sequence[CaseRow], folder: Path) -> dict[str, str]:
    """Let `viewer` write the ends of films of some cases into ``folder``; case -> file name, of
    those that could be made."""
    names = {row.case.id: f"film-{row.case.id}.webp" for row in rows if recording_of(dossier, row)}
    _ask(dossier, {case: folder / name for case, name in names.items()})
    return {case: name for case, name in names.items() if (folder / name).is_file()}


def _lines(unrecorded: int, errors: dict[str, str]) -> list[str]:
    lines = [f"no film of {case}: {error}" for case, error in errors.items()]
    if unrecorded:
        lines.append(
            f"no film of {counted(unrecorded, 'case')} that did not pass: not recorded; run the "
            "campaign with --view record"
        )
    return lines


def _ask(dossier: Dossier, outs: Mapping[str, Path]) -> dict[str, str]:
    """Let one `viewer` make some films, path by case; case -> why there is none, of those that
    failed."""
    asked = [json.dumps({"case": case, "out": str(out.absolute())}) for case, out in outs.items()]
    answers, why = run_viewer(
        ["films", str(dossier.folder)], "\n".join(asked), FILM_MAX_S * len(asked)
    )
    told = {answer["case"]: answer["error"] for answer in map(json.loads, answers)}
    errors = {case: told.get(case, why or "viewer films did not say") for case in outs}
    return {case: error for case, error in errors.items() if error}


def _is_new(dossier: Dossier, row: CaseRow) -> bool:
    """Whether the film of a case is there, and not older than its recording."""
    recording = recording_of(dossier, row)
    try:
        film = _path(dossier, row).stat()
        return recording is None or film.st_mtime_ns >= recording.stat().st_mtime_ns
    except OSError:
        return False


def _path(dossier: Dossier, row: CaseRow) -> Path:
    return dossier.folder / FOLDER / (row.case.id + SUFFIX)
