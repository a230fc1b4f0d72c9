"""Pictures out of the recordings of cases: `viewer` makes them, asked as anyone would."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from conductor.records.attempts import attempt_file
from conductor.report.analysis.losses import examples, moment_of
from conductor.report.reading.axes import axis_values
from conductor.report.reading.cache import FOLDER
from conductor.report.reading.dossier import CaseRow, Dossier
from schemas.files.recording import RECORDING_FILE
from twin.base.errors import InfrastructureError
from twin.base.files import write_atomic

STRIPS_MAX = 24
"""Most cases with a strip of pictures, of all models together."""
TOGETHER = 6
"""Number of strips that are made by one viewer before another is started beside it."""
LOG_LINES = 6
"""Last lines of a log that are shown of a case without a verdict."""
LOG_BYTES = 4000
"""Size of a log's end that is looked at, however long the log is [bytes]."""

VIEWER_MAX_S = 120.0
"""Longest time that a picture, or some strips, may take, on a slow disk and a busy machine [s]."""

_NOT_RECORDED = "the case was not recorded; run it again as below to see it"
_NO_PICTURES = "logs hold none"
_LOG = "log.txt"
_AROUND = ("--around-s", "1.0", "--frames", "5")


@dataclass(frozen=True, slots=True)
class Failure:
    """A case that did not pass, as the page shows it."""

    row: CaseRow
    strip: str
    """Pictures around the moment that matters, as a ``data:`` address; empty: there are none."""
    missing: str
    """Why there are none."""
    recorded: bool
    log: list[str]
    """Last lines of the attempt's log, where there was no verdict."""


def recording_of(dossier: Dossier, row: CaseRow) -> Path | None:
    """The recording of the committed attempt."""
    path = _inside(dossier, row, RECORDING_FILE)
    return path if path and path.is_file() else None


def _inside(dossier: Dossier, row: CaseRow, name: str) -> Path | None:
    """A file of the committed attempt; None: none was committed, or it lies elsewhere."""
    if not row.end.attempt_dir:
        return None
    try:
        return attempt_file(dossier.folder, row.end.attempt_dir, name)
    except InfrastructureError:
        return None  # reading its KPIs says so


def ask_viewer(dossier: Dossier, row: CaseRow, command: str, out: Path, *options: str) -> str:
    """Let ``viewer COMMAND`` write ``out``, of the moment that matters; empty, or why it could
    not."""
    if recording_of(dossier, row) is None:
        return _NO_PICTURES if dossier.imported else "the case was not recorded"
    asked = [command, str(dossier.folder), row.case.id, "--at", moment_of(row), "--out", str(out)]
    return run_viewer([*asked, *options], "")[1]


def run_viewer(arguments: list[str], asked: str, more_s: float = 0.0) -> tuple[list[str], str]:
    """Lines that `viewer` answers to what it is asked; and, if it failed, why.

    ``more_s``: how long it may take beyond :data:`VIEWER_MAX_S` [s].
    """
    name, longest_s = f"viewer {arguments[0]}", VIEWER_MAX_S + more_s
    try:
        done = subprocess.run(
            [sys.executable, "-m", "viewer", *arguments],
            input=asked,
            capture_output=True,
            text=True,
            check=False,
            timeout=longest_s,
        )
    except subprocess.TimeoutExpired:
        return [], f"{name} took longer than {longest_s:g} s"
    why = ""
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        why = lines[-1] if lines else f"{name} ended with exit code {done.returncode}"
    return done.stdout.splitlines(), why


def failures(dossier: Dossier, named: Sequence[str] = ()) -> list[Failure]:
    """Cases with their strips: those that are ``named``, as many as are shown; without a name,
    examples of lost cases of each model, kinds in turn."""
    rows = _named(dossier, named) if named else _examples(dossier)
    strips = _strips(dossier, rows)
    return [_failure(dossier, row, *strips[row.case.id]) for row in rows]


def _named(dossier: Dossier, names: Sequence[str]) -> list[CaseRow]:
    by_name = {row.case.id: row for row in dossier.rows}
    return [by_name[name] for name in names[:STRIPS_MAX] if name in by_name]


def _examples(dossier: Dossier) -> list[CaseRow]:
    by_model = [
        examples(dossier, [row for row in dossier.rows if row.case.variation.model == model])
        for model in axis_values(dossier, "model")
    ]
    # In turn: of many models each has some before one has all.
    turns = [row for turn in itertools.zip_longest(*by_model) for row in turn if row is not None]
    chosen = {row.case.id for row in turns[:STRIPS_MAX]}
    return [row for group in by_model for row in group if row.case.id in chosen]


def _failure(dossier: Dossier, row: CaseRow, data: bytes, missing: str) -> Failure:
    strip = f"data:image/jpeg;base64,{base64.b64encode(data).decode()}" if data else ""
    log = [] if row.end.outcome == "verdict" else _log_end(dossier, row)
    return Failure(row, strip, missing, recording_of(dossier, row) is not None, log)


def _strips(dossier: Dossier, rows: list[CaseRow]) -> dict[str, tuple[bytes, str]]:
    """Strips by case: the JPEG, from an earlier report if the recording is the same; or why there
    is none."""
    strips: dict[str, tuple[bytes, str]] = {}
    asked = []
    for row in rows:
        kept = _kept(dossier, row)
        if kept is None:
            strips[row.case.id] = b"", _NO_PICTURES if dossier.imported else _NOT_RECORDED
            continue
        try:
            strips[row.case.id] = kept.read_bytes(), ""
        except OSError:
            asked.append((row, kept))
    if asked:
        turns = min(len(os.sched_getaffinity(0)), -(-len(asked) // TOGETHER))
        with ThreadPoolExecutor(turns) as pool:
            for made in pool.map(lambda i: make_strips(dossier, asked[i::turns]), range(turns)):
                strips.update(made)
    return strips


def _kept(dossier: Dossier, row: CaseRow) -> Path | None:
    """Where the strip of a case is kept for the next report; None: the case was not recorded."""
    recording = recording_of(dossier, row)
    if recording is None:
        return None
    status = recording.stat()
    parts = (row.case.id, row.end.kpi_sha256, status.st_size, status.st_mtime_ns, _AROUND)
    key = hashlib.sha256(repr(parts).encode()).hexdigest()[:24]
    return dossier.folder / FOLDER / f"strip-{key}.jpg"


def make_strips(
    dossier: Dossier, asked: list[tuple[CaseRow, Path]]
) -> dict[str, tuple[bytes, str]]:
    """Let one `viewer` make the strips of some cases, and keep each at its path."""
    made: dict[str, tuple[bytes, str]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        lines = [
            json.dumps(
                {
                    "case": row.case.id,
                    "at": moment_of(row),
                    "out": str(Path(scratch, f"{number}.jpg")),
                }
            )
            for number, (row, _) in enumerate(asked)
        ]
        answers, why = run_viewer(["strips", str(dossier.folder), *_AROUND], "\n".join(lines))
        errors = {answer["case"]: answer["error"] for answer in map(json.loads, answers)}
        for number, (row, kept) in enumerate(asked):
            if error := errors.get(row.case.id, why or "viewer strips did not say"):
                made[row.case.id] = b"", error
                continue
            data = Path(scratch, f"{number}.jpg").read_bytes()
            made[row.case.id] = data, ""
            try:
                kept.parent.mkdir(exist_ok=True)
                write_atomic(kept, data, sync=False)
            except OSError:
                pass  # the next report asks again
    return made


def _log_end(dossier: Dossier, row: CaseRow) -> list[str]:
    path = _inside(dossier, row, _LOG)
    if path is None:
        return []
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - LOG_BYTES))
            text = file.read(LOG_BYTES).decode(errors="replace")
    except OSError:
        return []
    return [line[:300] for line in text.splitlines()[-LOG_LINES:]]
