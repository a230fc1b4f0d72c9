"""A campaign folder as the console reads it: its plan, how its cases ended, and when."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
from msgspec import Struct

from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, open_below
from schemas.points import Point
from schemas.verdict import Judged
from schemas.wire.view import clock
from twin.base.errors import InfrastructureError, TwinError, UsageError
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.discovery import OUTCOMES_NAME
from twin.records.campaign_file import read_plan

CAMPAIGN_FILE = "campaign.yaml"
TIMELINE_FILE = "timeline.jsonl"

TIMELINE_BYTES_MAX = 64 << 20
"""Longest log of leases that is read; what is longer counts as not there [bytes]."""

Version = tuple[int, ...]
T = TypeVar("T")


class CaseEnding(Judged, Struct, frozen=True, kw_only=True):
    """Ending of a case, as ``outcomes.json`` has it; what the console does not show is left out."""

    outcome: str = ""
    """``verdict``, ``failed``, ``unresolved``, ``cancelled``; empty: not ended yet."""
    verdict: str = ""
    reasons: list[str] = []
    scalars: dict[str, float | int | None] = {}
    names: dict[str, str] = {}
    attempt_dir: str = ""
    attempt: int = 0
    attempts: int = 0
    charges: list[str] = []
    steered: list[str] = []
    device_class: str = ""
    worker: str = ""
    wall_s: float = 0.0
    rig_wall_s: float = 0.0

    @property
    def status(self) -> str:
        """Verdict, or the outcome where there is none; empty: not ended yet."""
        return self.verdict if self.outcome == "verdict" else self.outcome


class CampaignEnding(Struct, frozen=True, kw_only=True):
    """``outcomes.json``; cases in submission order."""

    campaign: str
    digest: str = ""
    software: str = ""
    device_classes: list[str] = []
    complete: bool = False
    cases: dict[str, CaseEnding] = {}


@dataclass(frozen=True, slots=True)
class RunTimes:
    """When a campaign ran, by the wall clock since 1970 [s]; None: nothing says it."""

    first_s: float | None = None
    last_s: float | None = None
    workers: int | None = None
    """Workers that had a case."""


class _Event(Struct):
    at_s: float
    worker: str = ""
    event: str = ""
    case: str = ""
    token: int = 0


class RunFolder:
    """One campaign folder; any thread may ask. A file is read again when it has changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.id = folder.absolute().name or folder.resolve().name
        """Name in addresses."""
        self._lock = threading.Lock()
        self._ending: tuple[Version, CampaignEnding] | None = None
        self._points: tuple[Version, list[Point]] | None = None
        self._times: tuple[Version, RunTimes] | None = None
        self._once: dict[str, tuple[Version, Any]] = {}

    @property
    def version(self) -> Version:
        """Changes when the outcomes do: time of the last change [ns] and size."""
        return self._stamp(OUTCOMES_NAME)

    @property
    def served(self) -> bool:
        """Whether a conductor serves the folder now, or has left its mark."""
        return (self.folder / CONDUCTOR_FILE).exists()

    def ending(self) -> CampaignEnding:
        """Endings of the campaign's cases; of a folder without outcomes the cases that have begun,
        unended.

        Raises:
            UsageError: it is no campaign folder.
            InfrastructureError: the outcomes are damaged, or cannot be read.
        """
        version = self.version
        with self._lock:
            if self._ending is None or self._ending[0] != version:
                self._ending = version, self._read_ending()
            return self._ending[1]

    def points(self) -> dict[str, Point]:
        """The points of its cases by case; empty: the campaign file cannot be read here, as where
        a distribution that it needs is not installed."""
        version = self._stamp(CAMPAIGN_FILE)
        with self._lock:
            if self._points is None or self._points[0] != version:
                try:
                    points = list(read_plan(self.folder / CAMPAIGN_FILE).points)
                except (TwinError, ValueError, OSError):
                    points = []
                self._points = version, points
            return {point.id: point for point in self._points[1]}

    def times(self) -> RunTimes:
        """When it ran, as its log of leases says."""
        version = self._stamp(TIMELINE_FILE)
        with self._lock:
            if self._times is None or self._times[0] != version:
                self._times = version, self._read_times()
            return self._times[1]

    def doubles(self, case: str) -> list[str]:
        """Which workers began a case while another one had it, as the log of leases says."""
        return self.once("doubles", TIMELINE_FILE, self._read_doubles).get(case, [])

    def once(self, name: str, file: str, make: Callable[[], T]) -> T:
        """What is made of a file, kept as ``name`` until the file changes; while there is no such
        file it is made each time."""
        version = self._stamp(file)
        with self._lock:
            kept = self._once.get(name)
        if kept is not None and kept[0] == version:
            return cast(T, kept[1])
        made = make()
        if version:
            with self._lock:
                self._once[name] = version, made
        return made

    def read(self, name: str, most: int) -> bytes:
        """A file below the folder, which no link leads to; see
        :func:`schemas.files.regular_file.open_below`.

        Raises:
            OSError: it is not there, or larger than ``most`` bytes.
        """
        with open_below(self.folder, name) as file:
            # Python sets aside as much as it is asked to read.
            size = os.fstat(file.fileno()).st_size
            if size > most:
                words = f"{size} bytes, at most {most} are read"
                raise OSError(errno.EFBIG, words, str(self.folder / name))
            return file.read(size)

    def _stamp(self, name: str) -> Version:
        try:
            status = (self.folder / name).stat()
        except OSError:
            return ()
        return status.st_mtime_ns, status.st_size

    def _read_ending(self) -> CampaignEnding:
        try:
            return decode_json(self.read(OUTCOMES_NAME, RUN_FILE_BYTES_MAX), CampaignEnding)
        except FileNotFoundError:
            return self._begun()
        except OSError as error:
            words = error.strerror or str(error)
            raise InfrastructureError(f"{self.folder / OUTCOMES_NAME}: {words}") from None
        except JsonError as error:
            raise InfrastructureError(f"{self.folder / OUTCOMES_NAME}: damaged: {error}") from None

    def _begun(self) -> CampaignEnding:
        cases = self.folder / "cases"
        try:
            names = sorted(path.name for path in cases.iterdir() if path.is_dir())
        except (FileNotFoundError, NotADirectoryError):
            if self._stamp(CAMPAIGN_FILE):
                return CampaignEnding(campaign=self.id)
            raise UsageError(
                f"{self.folder}: not a campaign folder; give one that `conductor run` has made"
            ) from None
        except OSError as error:
            raise InfrastructureError(f"{cases}: {error.strerror or error}") from None
        return CampaignEnding(campaign=self.id, cases={name: CaseEnding() for name in names})

    def _read_times(self) -> RunTimes:
        first, last, workers = None, None, set()
        for event in self._timeline():
            first = event.at_s if first is None else first
            last = event.at_s
            if event.worker:
                workers.add(event.worker)
        return RunTimes(first, last, len(workers) or None)

    def _read_doubles(self) -> dict[str, list[str]]:
        held: dict[str, dict[int, str]] = {}
        doubles: dict[str, list[str]] = {}
        for event in self._timeline():
            leases = held.setdefault(event.case, {})
            if event.event == "leased":
                if leases:
                    had = " and ".join(leases.values())
                    words = f"{event.worker} was idle and began it as well, while {had} had it"
                    doubles.setdefault(event.case, []).append(escape(words))
                leases[event.token] = event.worker
            elif event.event in ("committed", "case_ended"):
                leases.clear()
            else:
                leases.pop(event.token, None)
        return doubles

    def _timeline(self) -> Iterator[_Event]:
        """Events of the log of leases; none: it is not there, or too long."""
        try:
            data = self.read(TIMELINE_FILE, TIMELINE_BYTES_MAX)
        except OSError:
            return
        decoder = msgspec.json.Decoder(_Event)
        for line in data.splitlines():
            try:
                yield decoder.decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                continue  # torn by a kill, or damaged


def find_runs(folder: Path) -> list[RunFolder]:
    """The campaign folder itself, or those in a folder of several, by name.

    Raises:
        UsageError: there is none.
    """
    try:
        if _is_run(folder):
            return [RunFolder(folder)]
        below = sorted(path for path in folder.iterdir() if path.is_dir() and _may_be_run(path))
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror or error}; give a campaign folder") from None
    if not below:
        raise UsageError(
            f"{folder}: not a campaign folder; give one that `conductor run` has made, or a folder "
            "of such folders"
        )
    return [RunFolder(path) for path in below]


def _is_run(path: Path) -> bool:
    return (path / OUTCOMES_NAME).is_file() or (path / "cases").is_dir()


def _may_be_run(path: Path) -> bool:
    try:
        return _is_run(path)
    except OSError:
        return True  # it may not be looked at, and says so in the list


def plain_axes(point: Point) -> dict[str, Any]:
    """Axes that every case has, and those that its campaign names: axis -> value."""
    return {
        "model": point.model,
        "time_of_day": clock(point.time_of_day_min),
        "weather": point.weather,
        "repeat": point.repeat,
        **({"row": point.row} if point.row else {}),
        **{name: value for name, value in point.values.items() if name not in _PLAIN},
    }


_PLAIN = frozenset({"model", "time_of_day", "weather", "repeat", "row"})
