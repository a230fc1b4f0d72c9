"""Finds recordings in a campaign folder, and the moments that matter in them."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, open_below, read_regular
from schemas.validation import did_you_mean
from twin.base.errors import InfrastructureError, UsageError
from twin.records.kpi_file import read_kpi_columns
from viewer.playback.frames import read_case
from viewer.recording import naming


@dataclass(frozen=True, slots=True)
class FoundRecording:
    """The recording of a case."""

    case: str
    path: Path
    kpi: Path
    """Need not exist: the attempt may still run."""
    complete: bool
    committed: str = ""
    """Name of the committed attempt's folder; empty: none yet."""

    @property
    def other(self) -> bool:
        """Whether the recording is of another attempt than the one that was committed."""
        return bool(self.committed) and self.path.parent.name != self.committed

    def remarks(self) -> list[str]:
        """One line for each thing that is not as one would wish."""
        lines = []
        if not self.complete:
            lines.append(f"{self.path}: the recording is incomplete")
        if self.other:
            lines.append(
                f"{self.case}: the committed {self.committed} was not recorded; "
                f"{self.path.parent.name} is shown"
            )
        return lines


@dataclass(frozen=True, slots=True)
class RecordedMoment:
    """A time of a case, and what is there to be seen."""

    sim_time_ns: int
    label: str
    tick: int | None = None
    """Control tick of the case; None: seconds were given, or only the recording says the time."""


class NotKeptError(UsageError):
    """The recording was not kept, as the campaign asked."""


def find_recording(folder: Path, case: str) -> FoundRecording:
    """The recording of the committed attempt, or of the latest one.

    Raises:
        UsageError: no such folder or case, or it was not recorded.
    """
    names = case_names(folder)
    return recording_of(folder, case, names, committed_attempts(folder).get(case, ""))


def recording_of(folder: Path, case: str, names: list[str], committed: str) -> FoundRecording:
    """Recording as :func:`find_recording` finds it, of a folder that was looked at already.

    Args:
        folder: the campaign's.
        case: which one.
        names: of all its cases.
        committed: the case's of :func:`committed_attempts`.

    Raises:
        UsageError: no such case, or it was not recorded.
    """
    attempts = _attempts_there(folder, case, names, committed)
    for attempt in attempts:
        path = attempt / naming.RECORDING_FILE
        if _is_recorded(folder, path):
            complete = _note(attempt).get("complete") is True
            return FoundRecording(case, path, attempt / naming.KPI_FILE, complete, committed)
    if any(_note(attempt).get("kept") is False for attempt in attempts):
        raise NotKeptError(
            f"{folder}: case '{case}' passed, and its recording was not kept; the campaign says "
            "recording.keep: failed"
        )
    raise UsageError(
        f"{folder}: case '{case}' was not recorded; run the campaign with --view record"
    )


def _is_recorded(folder: Path, path: Path) -> bool:
    """A link is no recording: it may lead to any file that we may read."""
    try:
        with open_below(folder, str(path.relative_to(folder))) as file:
            return os.fstat(file.fileno()).st_size > 0
    except OSError:
        return False


def case_names(folder: Path) -> list[str]:
    """Cases of a campaign folder that have begun, sorted.

    Raises:
        UsageError: it is not one.
    """
    cases = folder / "cases"
    if not cases.is_dir():
        raise UsageError(f"{folder}: not a campaign folder; give one that `conductor run` has made")
    return sorted(path.name for path in cases.iterdir() if path.is_dir())


class PastEndError(UsageError):
    """A moment after the end of a case, at ``end_ns`` of sim time [ns]."""

    def __init__(self, words: str, end_ns: int) -> None:
        super().__init__(words)
        self.end_ns = end_ns


def find_moment(found: FoundRecording, at: str) -> RecordedMoment:
    """The moment ``at``: ``aeb`` (without a trigger: closest approach), ``closest`` or seconds.

    Where the attempt's KPI rows are missing (it was killed) or cannot be read, the recording says
    it.

    Raises:
        UsageError: none of these, or the case has no rows yet.
        PastEndError: the case had ended by then.
    """
    if at not in ("aeb", "closest"):
        try:
            seconds = float(at)
        except ValueError:
            seconds = -1.0
        if not 0 <= seconds <= 1e6:
            raise UsageError(
                f"--at {at}: expected aeb, closest, or seconds of sim time such as 2.5"
            )
        time_ns = round(seconds * 1e9)
        end_ns = max((row.sim_time_ns for row in _rows(found)), default=0)
        if time_ns > end_ns:
            raise PastEndError(
                f"--at {at}: case '{found.case}' ends at {end_ns / 1e9:g} s of sim time; give "
                f"0 to {end_ns / 1e9:g}, aeb or closest",
                end_ns,
            )
        return RecordedMoment(time_ns, f"{seconds:g} s")
    rows = _rows(found)
    if at == "aeb":
        for row in rows:
            if row.aeb:
                return row.moment("AEB trigger")
    near = [(row.dtc_m, row.sim_time_ns, row) for row in rows if row.dtc_m is not None]
    if not near:
        raise UsageError(f"{found.path}: nothing says how close it came; give --at SECONDS")
    prefix = "no AEB trigger; " if at == "aeb" else ""
    return min(near, key=lambda pair: pair[:2])[-1].moment(f"{prefix}closest approach")


class _Row(NamedTuple):
    sim_time_ns: int
    aeb: bool | None
    dtc_m: float | None
    tick: int | None = None
    """None: only the recording says the rest."""

    def moment(self, what: str) -> RecordedMoment:
        tick = "" if self.tick is None else f" (tick {self.tick})"
        label = f"{what} at {self.sim_time_ns / 1e9:.2f} s{tick}"
        return RecordedMoment(self.sim_time_ns, label, self.tick)


def _rows(recording: FoundRecording) -> list[_Row]:
    names = ("sim_time_ns", "aeb", "dtc_m", "tick")
    try:
        columns: dict[str, list[Any]] = read_kpi_columns(recording.kpi, names).to_pydict()
    except InfrastructureError:
        frames = read_case(recording.path).frames
        return [_Row(frame.sim_time_ns, frame.aeb, frame.dtc_m) for frame in frames]
    return [_Row(*row) for row in zip(*(columns[name] for name in names), strict=True)]


def attempts_of(folder: Path, case: str) -> list[Path]:
    """Attempt folders of a case: the committed one first, then the latest.

    Raises:
        UsageError: no such folder or case.
    """
    names = case_names(folder)
    return _attempts_there(folder, case, names, committed_attempts(folder).get(case, ""))


def _attempts_there(folder: Path, case: str, names: list[str], committed: str) -> list[Path]:
    attempts = _attempts(folder, case, committed)
    if not attempts:
        hint = did_you_mean(case, names).rstrip() or f"it has e.g. {', '.join(names[:3])}"
        raise UsageError(f"{folder}: no case '{case}'; {hint}")
    return attempts


def _attempts(folder: Path, case: str, committed: str) -> list[Path]:
    """Attempt folders of a case: the committed one first, then the latest."""
    if not case or "/" in case or case.startswith("."):
        return []
    attempts = [path for path in (folder / "cases" / case).glob("attempt-*") if path.is_dir()]
    attempts.sort(key=_number, reverse=True)
    attempts.sort(key=lambda path: path.name != committed)
    return attempts


def _number(path: Path) -> int:
    text = path.name.removeprefix("attempt-")
    return int(text) if text.isdigit() else -1


def committed_attempts(folder: Path) -> dict[str, str]:
    """Case -> name of its committed attempt's folder; cases that have none are left out."""
    try:
        outcomes: Any = decode_json(read_regular(folder / "outcomes.json", RUN_FILE_BYTES_MAX))
        items = list(outcomes["cases"].items())
    except (OSError, JsonError, KeyError, TypeError, AttributeError):
        return {}
    attempt_of = {}
    for case, end in items:
        with contextlib.suppress(KeyError, TypeError):
            attempt_of[case] = Path(end["attempt_dir"]).name
    return attempt_of


def _note(attempt: Path) -> dict[str, Any]:
    """What the recorder has left to say; empty: nothing that could be read."""
    try:
        note: Any = decode_json(read_regular(attempt / naming.RECORDING_NOTE, RUN_FILE_BYTES_MAX))
    except (OSError, ValueError):
        return {}
    return note if isinstance(note, dict) else {}
