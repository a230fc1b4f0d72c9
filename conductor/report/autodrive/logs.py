"""Reading the AutoDRIVE study's logs: every row that says what happened when, by column name.

What cannot be read is noted with file, line and reason; nothing is filled in.
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from conductor.report.autodrive.layout import Instance
from schemas.escape import escape
from schemas.files.autodrive_log import (
    AEB,
    BRAKE,
    COLLISIONS,
    COLUMNS,
    CONFIDENCE,
    DTC,
    LABEL,
    MODEL,
    POS_X,
    POS_Y,
    ROT_Z,
    SIZE,
    STEERING,
    THROTTLE,
    TIME_OF_DAY,
    TIMESTAMP,
    WEATHER,
)
from schemas.words import agree

REQUIRED = (TIMESTAMP, DTC, COLLISIONS)
"""A log without one of these columns says nothing about a case."""
SPAN_MAX_US = 24 * 3600 * 10**6
"""No log lasts longer; a row further than this from the first has a damaged time [us]."""
NUMBER_MAX = 1e9
"""A larger number is damaged: nothing in a log comes near it."""
SHOWN_CHARS_MAX = 60
"""Longest text of a log in a note [characters]."""
NAMED_MAX = 8
"""Most lines that a note names; then it counts."""

_NUMBERS = (CONFIDENCE, SIZE, DTC, THROTTLE, STEERING, BRAKE, POS_X, POS_Y, ROT_Z)
_COMMANDS = frozenset((AEB, THROTTLE, STEERING, BRAKE))
_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_IDENTITY = (MODEL, TIME_OF_DAY, WEATHER)


@dataclass(frozen=True, slots=True)
class LogRow:
    """One row; NaN and None are missing."""

    time_us: int
    """Wall time since the log's first row [us]."""
    label: str
    numbers: dict[str, float]
    """Numbers by column; NaN where missing."""
    aeb: bool | None
    collisions: int
    """Number of collisions so far."""


@dataclass(slots=True)
class Log:
    """One file."""

    name: str
    sha256: str = ""
    """SHA-256 of its bytes; empty: it was not read."""
    rows: list[LogRow] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What was left out, a line each."""
    foreign: str = ""
    """Why it is not the log of its case; empty: it is."""


class _UnreadableError(Exception):
    """A row that is left out, with the reason."""


def read_log(name: str, data: bytes, instance: Instance) -> Log:
    """Rows of a log that should be that of ``instance``.

    Left out, and noted, are rows that are torn or cut off, and rows without a time after the one
    before, a number of collisions, or numbers where numbers belong. Cells that are empty in other
    columns are missing in their row alone.
    """
    log = Log(name, hashlib.sha256(data).hexdigest())
    text = data.decode("utf-8-sig", errors="replace")
    lines = text.split("\n")
    header = [cell.strip() for cell in _cells(lines[0])] if text.strip() else []
    missing = [column for column in REQUIRED if column not in header]
    if missing or len(set(header)) < len(header):
        log.foreign = f"no column {', '.join(missing)}" if missing else "a column appears twice"
        return log
    absent = [c for c in COLUMNS if c not in header and (c in _NUMBERS or c in (AEB, LABEL))]
    if absent:
        log.notes.append(f"{name}: no column {', '.join(absent)}; missing in every row")
    first: datetime.datetime | None = None
    gaps: dict[str, list[int]] = {}
    torn: dict[str, list[int]] = {}
    ended = len(text.rstrip().split("\n"))
    for line, content in enumerate(lines[1:], 2):
        if not content.strip():
            continue
        try:
            cells = _cells(content)
            # A last line without its end may lack digits of its last value. A number of collisions
            # says that there was one also without them.
            if line == len(lines) and (len(cells) != len(header) or header[-1] != COLLISIONS):
                raise _UnreadableError("cut off")
            if len(cells) != len(header):
                raise _UnreadableError(f"torn ({len(cells)} of {len(header)} values)")
            row = dict(zip(header, cells, strict=True))
            moment = _moment(row[TIMESTAMP])
            parsed = _row(row, moment, first or moment, log.rows[-1] if log.rows else None)
            first = first or moment  # a row that is left out is not the first one
        except _UnreadableError as error:
            torn.setdefault(str(error), []).append(line)
            continue
        log.foreign = log.foreign or _foreign(row, instance, line)
        empty = list(_gaps(row, parsed))
        if line == ended and not _COMMANDS.difference(empty):
            # So our own logs end: the case was over before the stack was asked again.
            empty = [column for column in empty if column not in _COMMANDS]
        for column in empty:
            gaps.setdefault(column, []).append(line)
        log.rows.append(parsed)
    log.notes += [f"{name}: {_lines(at)} left out: {why}" for why, at in torn.items()]
    together: dict[tuple[int, ...], list[str]] = {}
    for column, at in gaps.items():
        together.setdefault(tuple(at), []).append(column)
    log.notes += [f"{name}: {_lines(at)} without {', '.join(c)}" for at, c in together.items()]
    lost = sum(map(len, torn.values()))
    # What the rows say that are left is not what happened, and may look like a pass.
    if not log.foreign and lost >= len(log.rows):
        log.foreign = f"{lost} of {lost + len(log.rows)} rows cannot be read"
    # Nothing but a collision can be told without distances.
    known = sum(not math.isnan(row.numbers[DTC]) for row in log.rows)
    if not log.foreign and known < min(2, len(log.rows)) and not log.rows[-1].collisions:
        log.foreign = f"{DTC} in {known} of {len(log.rows)} rows"
    return log


def _cells(line: str) -> list[str]:
    """A row; one that is no CSV has no cells. Lines are read one by one, so that a stray quote
    costs its line alone."""
    try:
        return [cell.strip() for cell in next(csv.reader([line.rstrip("\r")], strict=True), [])]
    except csv.Error:
        return []


def _moment(text: str) -> datetime.datetime:
    try:
        return datetime.datetime.fromisoformat(text).replace(tzinfo=None)
    except ValueError:
        raise _UnreadableError(f"no {TIMESTAMP}") from None


def _row(
    row: dict[str, str],
    moment: datetime.datetime,
    first: datetime.datetime,
    before: LogRow | None,
) -> LogRow:
    time_us = (moment - first) // datetime.timedelta(microseconds=1)
    if before is not None and time_us <= before.time_us:
        raise _UnreadableError(f"{TIMESTAMP} not after the row before")
    if time_us > SPAN_MAX_US:
        raise _UnreadableError(f"{TIMESTAMP} more than a day after the first row")
    collisions = row[COLLISIONS]
    if not (collisions.isascii() and collisions.isdigit() and len(collisions) < 10):
        raise _UnreadableError(f"no number of {COLLISIONS}")
    aeb = row.get(AEB, "")
    if aeb not in ("", "0", "1"):
        raise _UnreadableError(f"{AEB} neither 0 nor 1")
    numbers = {column: _number(column, row.get(column, "")) for column in _NUMBERS}
    label = row.get(LABEL, "")
    # An export puts an apostrophe before what a spreadsheet would take for a formula.
    if label[:1] == "'" and label[1:2] in ("=", "+", "-", "@"):
        label = label[1:]
    return LogRow(time_us, label, numbers, aeb == "1" if aeb else None, int(collisions))


def _number(column: str, text: str) -> float:
    if not text:
        return math.nan
    value = float(text) if len(text) < 64 and _DECIMAL.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise _UnreadableError(f"{column} is no number")
    if abs(value) > NUMBER_MAX:
        raise _UnreadableError(f"{column} is beyond {NUMBER_MAX:g}")
    return value


def _gaps(row: dict[str, str], parsed: LogRow) -> Iterator[str]:
    """Columns that are there and empty; those of the box are empty where nothing was found."""
    for column, value in parsed.numbers.items():
        if column in row and math.isnan(value) and (column not in (CONFIDENCE, SIZE)):
            yield column
    if AEB in row and parsed.aeb is None:
        yield AEB


def _foreign(row: dict[str, str], instance: Instance, line: int) -> str:
    """Why a row belongs to another case; empty: it does not."""
    expected = (instance.model, str(instance.time_of_day), str(instance.weather_id))
    for column, value in zip(_IDENTITY, expected, strict=True):
        logged = row.get(column, "")
        if logged and logged != value:
            named = [escape(text, SHOWN_CHARS_MAX) for text in (logged, value)]
            return f"line {line} is of another case: {column} '{named[0]}', not '{named[1]}'"
    return ""


def _lines(numbers: Sequence[int]) -> str:
    if len(numbers) > NAMED_MAX:
        return f"{len(numbers)} lines from line {numbers[0]} on"
    return f"{agree(len(numbers), 'line', 'lines')} {', '.join(map(str, numbers))}"
