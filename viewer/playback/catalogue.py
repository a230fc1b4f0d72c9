"""The recordings of a campaign as a table: one row per recorded case, sorted by case."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from schemas.verdict import is_pass
from schemas.words import counted
from twin.base.errors import UsageError
from viewer.playback.folder import (
    FoundRecording,
    NotKeptError,
    PastEndError,
    RecordedMoment,
    case_names,
    committed_attempts,
    find_moment,
    find_recording,
    recording_of,
)
from viewer.playback.frames import RecordedCase, read_cover
from viewer.recording.scenery import verdict_color

NAMES_MAX = 3
"""Cases named in a line about many."""


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """A recorded case."""

    found: FoundRecording
    recording_id: str
    moment: RecordedMoment
    """Moment at which it opens."""
    verdict: str
    """Verdict, or the outcome if there is none; empty: the attempt did not end."""
    passed: bool
    model: str
    weather: str
    hour: str
    """Time of day, HH:MM."""

    def as_json(self) -> dict[str, Any]:
        """Row for ``--output json``."""
        return {
            "case": self.found.case,
            "verdict": self.verdict,
            "passed": self.passed,
            "model": self.model,
            "hour": self.hour,
            "weather": self.weather,
            "complete": self.found.complete,
            "moment_s": self.moment.sim_time_ns / 1e9,
            "moment_tick": self.moment.tick,
            "moment": self.moment.label,
            "path": str(self.found.path),
        }


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The recordings of a campaign that can be replayed, and the cases that have none."""

    folder: Path
    rows: list[RecordingRow]
    missing: list[str]
    """Cases without a readable recording."""
    passed: list[str] = field(default_factory=list)
    """Cases that passed, and whose recording was therefore not kept."""

    @property
    def incomplete(self) -> list[str]:
        """Cases whose recording has gaps, or whose recorder was killed."""
        return [row.found.case for row in self.rows if not row.found.complete]

    def as_json(self) -> dict[str, Any]:
        """Catalogue for ``--output json``."""
        return {
            "cases": [row.as_json() for row in self.rows],
            "missing": self.missing,
            "not_kept": self.passed,
        }

    def remarks(self) -> list[str]:
        """One line for each thing that is not as one would wish."""
        lines = []
        if self.missing:
            lines.append(f"{_number(self.missing)} without a recording: {_some(self.missing)}")
        if self.passed:
            lines.append(f"{_number(self.passed)} passed and not kept: {_some(self.passed)}")
        if self.incomplete:
            lines.append(f"{_number(self.incomplete)} recorded with gaps: {_some(self.incomplete)}")
        others = [row.found.case for row in self.rows if row.found.other]
        if others:
            lines.append(f"{_number(others)} shown by an attempt not committed: {_some(others)}")
        return lines


def read_catalogue(folder: Path, at: str) -> Catalogue:
    """Look at every recording of a campaign; each opens at the moment ``at``.

    Raises:
        UsageError: no campaign folder, ``at`` is none of its words, or nothing was recorded.
    """
    rows: list[RecordingRow] = []
    missing: list[str] = []
    passed: list[str] = []
    names, committed = case_names(folder), committed_attempts(folder)
    for case in names:
        try:
            recording = recording_of(folder, case, names, committed.get(case, ""))
            cover = read_cover(recording.path)
        except NotKeptError:
            passed.append(case)
        except UsageError:
            missing.append(case)
        else:
            rows.append(_row(recording, _moment(recording, at), cover))
    if not rows and passed:
        raise NotKeptError(
            f"{folder}: all recorded cases passed, and none was kept; the campaign says "
            "recording.keep: failed"
        )
    if not rows:
        raise UsageError(f"{folder}: no case was recorded; run the campaign with --view record")
    return Catalogue(folder, rows, missing, passed)


def read_row(folder: Path, case: str, at: str) -> RecordingRow:
    """The row of one case.

    Raises:
        UsageError: no such case, or it was not recorded.
    """
    recording = find_recording(folder, case)
    return _row(recording, _moment(recording, at), read_cover(recording.path))


def table(catalogue: Catalogue) -> Table:
    """Table for people."""
    shown = Table(
        *("case", "verdict", "passed", "model", "hour", "weather", "complete", "opens at"),
        box=None,
        padding=(0, 2, 0, 0),
    )
    for row in catalogue.rows:
        red, green, blue = verdict_color(row.verdict)
        name = row.verdict.replace("_", " ") or "-"
        shown.add_row(
            row.found.case,
            f"[rgb({red},{green},{blue})]{name}[/]",
            _yes(row.passed),
            row.model,
            row.hour,
            row.weather,
            _yes(row.found.complete),
            row.moment.label,
        )
    return shown


def _moment(recording: FoundRecording, at: str) -> RecordedMoment:
    """An attempt that was killed before its first row has no moment; it opens at its start. One
    that had ended by then opens at its end."""
    try:
        return find_moment(recording, at)
    except PastEndError as error:
        return RecordedMoment(error.end_ns, f"end at {error.end_ns / 1e9:.2f} s")
    except UsageError:
        if at not in ("aeb", "closest"):
            raise
        return RecordedMoment(0, "0 s")


def _row(recording: FoundRecording, moment: RecordedMoment, cover: RecordedCase) -> RecordingRow:
    case, end = cover.properties.get("case", {}), cover.properties.get("verdict", {})
    return RecordingRow(
        found=recording,
        recording_id=cover.recording_id,
        moment=moment,
        verdict=end.get("verdict") or end.get("outcome") or "",
        passed=is_pass(end.get("outcome") or "", end.get("verdict") or ""),
        model=case.get("model") or "",
        weather=case.get("weather") or "",
        hour=case.get("time_of_day") or "",
    )


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _number(names: list[str]) -> str:
    return counted(len(names), "case")


def _some(names: list[str]) -> str:
    more = ", ..." if len(names) > NAMES_MAX else ""
    return ", ".join(names[:NAMES_MAX]) + more
