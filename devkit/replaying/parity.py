"""``devkit parity``: the ``autodrive`` rules on the logs that AutoDRIVE published.

Their AEB script logged, per control cycle, the box it looked at and whether it braked. The planner
gets the first (label, confidence, size) and must arrive at the second.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from devkit.reference.planning import Cruise, Planner, plan
from devkit.reference.planning_autodrive import HEIGHT_PX, WIDTH_PX
from devkit.reference.view import CameraView
from schemas.escape import escape
from schemas.files.autodrive_log import AEB, CONFIDENCE, LABEL, MODEL, SIZE
from schemas.messages import Detection
from schemas.sections.lens_curve import Intrinsics
from twin.base.errors import UsageError
from twin.records.autodrive_files import LogFile, read_log_files

COLUMNS = (LABEL, CONFIDENCE, SIZE, AEB)
"""Columns of a log that matter here."""

SHOWN_CHARS_MAX = 60
"""Longest text of a log in a message [characters]."""

PLANNER = Planner(rules="autodrive")
_LENS = Intrinsics(500.0, 500.0, 0.5 * WIDTH_PX, 0.5 * HEIGHT_PX)
VIEW = CameraView(WIDTH_PX, HEIGHT_PX, _LENS, forward_m=0.0, lateral_m=0.0, above_m=1.0)
"""The image of the script; its field of view plays no part in these rules."""


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A row where the rule decides otherwise than the log."""

    file: str
    line: int
    label: str
    confidence_percent: float
    size_px2: float
    logged: bool
    rule: bool


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A row that says too little to be judged, or something else than the columns promise."""

    file: str
    line: int
    reason: str


@dataclass(frozen=True, slots=True)
class RefusedLog:
    """A file that is no log, or could not be read."""

    file: str
    """Path in the folder, escaped."""
    reason: str


@dataclass(slots=True)
class Parity:
    """Result of the comparison. Texts that come from the logs are escaped."""

    files: int = 0
    """Logs whose rows were looked at."""
    rows: int = 0
    """Rows that could be judged."""
    agreeing: int = 0
    by_model: dict[str, list[int]] = field(default_factory=dict)
    """Detector -> [rows agreeing, rows]."""
    disagreements: list[Disagreement] = field(default_factory=list)
    unreadable: list[Unreadable] = field(default_factory=list)
    refused: list[RefusedLog] = field(default_factory=list)


def run_parity(folder: Path) -> Parity:
    """Judge every row of every log in ``folder``: ``batch_N/aeb_metrics_sim_inst_M.csv`` and the
    same in ``batch_N.tar.gz``; ``folder`` may itself be a batch.

    Files that are no logs, are too large or damaged are listed and do not stop the others.

    Raises:
        UsageError: there is no folder, no log in it, or no log that can be judged; one line.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; give the one that holds the logs")
    parity = Parity()
    for file in read_log_files(folder):
        _take(file, parity)
    if not parity.files:
        first = parity.refused[0] if parity.refused else None
        also = f"; {first.file}: {first.reason}" if first else ""
        raise UsageError(
            f"{folder}: no log batch_N/aeb_metrics_sim_inst_M.csv can be read in it or in its "
            f"batch_N.tar.gz{also}"
        )
    if not parity.rows:
        raise UsageError(f"{folder}: {parity.files} logs, but no row with {', '.join(COLUMNS)}")
    return parity


def _take(file: LogFile, parity: Parity) -> None:
    if file.refused:
        parity.refused.append(RefusedLog(file.name, file.refused))
        return
    parity.files += 1
    judge(file.name, file.data.decode("utf-8-sig", errors="replace"), parity)


def judge(name: str, text: str, parity: Parity) -> None:
    """Add the rows of one log to ``parity``; ``name`` is the file in what is listed."""
    rows = _rows(text)
    _, header = next(rows, (1, []))
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        parity.unreadable.append(Unreadable(name, 1, f"no column {', '.join(missing)}"))
        return
    # A last line without its end was cut off: its last value may lack digits.
    cut_line = 0 if text.endswith("\n") else text.count("\n") + 1
    for line, row in rows:
        torn = len(row) != len(header)
        if torn or (line == cut_line and header[-1] in COLUMNS):
            what = "cut off" if line == cut_line else "torn"
            reason = f"{what}: {len(row)} of {len(header)} values"
            parity.unreadable.append(Unreadable(name, line, reason))
        else:
            _judge_row(name, line, dict(zip(header, row, strict=True)), parity)


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and values of every row that is not empty; a row that is no CSV has none."""
    reader = csv.reader(io.StringIO(text, newline=""))
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error:
            yield reader.line_num, []
            continue
        if row:
            yield reader.line_num, row


def _judge_row(name: str, line: int, row: Mapping[str, str], parity: Parity) -> None:
    try:
        detections, logged = read_row(row)
    except ValueError as error:
        parity.unreadable.append(Unreadable(name, line, str(error)))
        return
    rule = plan(Cruise(), detections, 0.0, VIEW, PLANNER)[1].aeb
    counts = parity.by_model.setdefault(_shown(row.get(MODEL, "")), [0, 0])
    parity.rows += 1
    counts[1] += 1
    if rule == logged:
        parity.agreeing += 1
        counts[0] += 1
        return
    box = detections[0] if detections else Detection("", 0.0, 0.0, 0.0, 0.0, 0.0)
    percent = round(100.0 * box.confidence, 6)
    parity.disagreements.append(
        Disagreement(name, line, _shown(box.label), percent, box.width_px, logged=logged, rule=rule)
    )


def read_row(row: Mapping[str, str]) -> tuple[list[Detection], bool]:
    """The box that the script looked at, if any, and whether it braked.

    A row without label and size is a frame in which nothing was found; its confidence is that of
    whatever the network listed last and means nothing.

    Raises:
        ValueError: a value is missing or not what its column promises; one line.
    """
    label, confidence, size, aeb = (row[column].strip() for column in COLUMNS)
    if aeb not in ("0", "1"):
        raise ValueError(f"{AEB}: given '{_shown(aeb)}', expected 0 or 1")
    if not label and not size:
        return [], aeb == "1"
    if not (label and confidence and size):
        empty = [c for c in (LABEL, CONFIDENCE, SIZE) if not row[c].strip()]
        raise ValueError(f"a box without {', '.join(empty)}")
    percent, area_px2 = _number(CONFIDENCE, confidence), _number(SIZE, size)
    # Only the area is logged, so the box is one pixel high.
    return [Detection(label, percent / 100.0, 0.0, 0.0, area_px2, 1.0)], aeb == "1"


def _number(column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise ValueError(f"{column}: given '{_shown(text)}', expected a number of 0 or more")
    return value


def _shown(text: str) -> str:
    return escape(text, SHOWN_CHARS_MAX)
