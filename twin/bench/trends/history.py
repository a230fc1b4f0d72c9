"""The history of benches: a line of JSON per target and run, and whether the last run is worse.

Rows are compared within one class of machines: kind of device, processor, number of cores, GPU.
The median of earlier rows is what a new one is held against, so one lucky or unlucky run moves
nothing.
"""

from __future__ import annotations

import os
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from twin.base.errors import UsageError, storage_error
from twin.base.software import device_class

HISTORY_BYTES_MAX = 64 << 20
"""Largest history that is read [bytes]."""
FALL_MIN = 0.10
"""A target that is worse than the median of earlier rows by this share or more has fallen."""
EARLIER_MAX = 20
"""Most earlier rows that the median is taken of, the latest."""

_Text = Annotated[str, Meta(min_length=1, max_length=200)]


class HistoryRow(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One target in one run of all benches."""

    at: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ\Z")]
    """When the run began, UTC."""
    machine: _Text
    """Class of the machine; only rows of one class are compared."""
    software: _Text
    """Software digest, its beginning."""
    label: Annotated[str, Meta(max_length=200)] = ""
    """What the user calls this run, such as a commit."""
    target: _Text
    value: Annotated[float, Meta(gt=0)]
    unit: _Text
    better: Literal["more", "less"]


@dataclass(frozen=True, slots=True)
class Trend:
    """A target's last row beside earlier ones of its class of machines."""

    row: HistoryRow
    earlier: list[HistoryRow]
    """The earlier ones, in order, at most :data:`EARLIER_MAX`."""

    @property
    def median(self) -> float | None:
        """Median of the earlier values; None: there are none."""
        return statistics.median(row.value for row in self.earlier) if self.earlier else None

    @property
    def change(self) -> float | None:
        """How much better the last row is than the median, as a share; negative: worse."""
        if self.median is None:
            return None
        now = self.row.value
        return (now / self.median if self.row.better == "more" else self.median / now) - 1.0

    @property
    def fell(self) -> bool:
        """Whether it is worse by :data:`FALL_MIN` or more."""
        return self.change is not None and round(self.change, 9) <= -FALL_MIN


def trends(rows: Sequence[HistoryRow], machine: str) -> list[Trend]:
    """The last row of every target on a class of machines, in order of their first appearance.

    Args:
        rows: in the order in which they were written.
        machine: the class.
    """
    by_target: dict[str, list[HistoryRow]] = {}
    for row in rows:
        if row.machine == machine:
            by_target.setdefault(row.target, []).append(row)
    return [Trend(last, before[-EARLIER_MAX:]) for *before, last in by_target.values()]


def machine_of(device: str) -> str:
    """The class of this machine: device class, processor, and how many of its cores we may use.

    Raises:
        UsageError: no such device here.
    """
    return f"{device_class(device)}, {_processor()}, {len(os.sched_getaffinity(0))} cores"


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return escape(" ".join(found[1].split()), 80) if found else "unknown processor"


def read_history(path: Path) -> list[HistoryRow]:
    """The rows of a history; none where there is no file yet.

    Raises:
        UsageError: a line is no row, or the file is no regular one or too large; one line.
    """
    try:
        lines = read_regular(path, HISTORY_BYTES_MAX).split(b"\n")
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UsageError(f"--history {path}: {error.strerror or error}; give a file") from None
    rows = []
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            rows.append(decode_json(line, HistoryRow))
        except JsonError as error:
            raise UsageError(
                f"--history {path}: line {number} is no row of a history: "
                f"{escape(str(error), 200)}; remove it, or give another file"
            ) from None
    return rows


def append_history(path: Path, rows: Iterable[HistoryRow]) -> None:
    """Add rows at the end of a history, which is made if it is not there.

    Raises:
        UsageError: it cannot be written; one line.
    """
    data = b"".join(msgspec.json.encode(row) + b"\n" for row in rows)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as file:
            file.write(data)
    except OSError as error:
        raise storage_error(error, str(path)) from None
