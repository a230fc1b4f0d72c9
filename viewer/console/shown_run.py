"""A campaign that the console shows, with what was made of it and what is heard of it."""

from __future__ import annotations

import gzip
import hashlib
import json
import shlex
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote

import msgspec

from twin.base.errors import UsageError
from viewer.console.pictures import MOMENT_SIZE, PictureCache, moment_picture
from viewer.console.recorded import RecordedAttempt, has_recording
from viewer.console.remote_files import RemoteAttempt, RemoteFiles
from viewer.console.remote_run import HeardCases
from viewer.console.run_folder import CAMPAIGN_FILE, CaseEnding, RunFolder, plain_axes
from viewer.console.table import ConsoleTable, console_table
from viewer.playback.frames import read_pictures

PACK_LEVEL = 5
"""Of gzip: 6 takes twice as long for two per cent."""
JSON, WEBP, JPEG = "application/json", "image/webp", "image/jpeg"
ATTEMPTS_MAX = 8
"""Cases whose recording stays in memory, for the page that looks at them."""


def component(name: str) -> str:
    """A name as a part of an address, as ``encodeURIComponent`` of browsers writes it."""
    return quote(name, safe="!~*'()")


@dataclass(frozen=True)
class SiteAnswer:
    """Content of an address."""

    data: bytes
    media_type: str

    @cached_property
    def tag(self) -> str:
        """Changes when the content does."""
        return hashlib.sha256(self.data).hexdigest()[:20]

    @cached_property
    def packed(self) -> bytes:
        """The data compressed with gzip; a table of ten thousand cases shrinks to a tenth."""
        return gzip.compress(self.data, compresslevel=PACK_LEVEL, mtime=0)


def as_json(value: Any) -> SiteAnswer:
    """A value as JSON; a number that is none becomes null."""
    try:
        return SiteAnswer(msgspec.json.encode(value), JSON)
    except UnicodeEncodeError:  # a name of a file that is no text
        return SiteAnswer(json.dumps(value).encode(), JSON)


@dataclass(frozen=True, slots=True)
class LivePicture:
    """The latest small picture of a case."""

    jpeg: bytes
    sim_time_ns: int
    number: int
    """Grows with every picture of the run."""
    came_s: float
    """When it came, by the monotonic clock [s]."""
    rig: str = ""
    """Rig that it comes from; empty: of an earlier release."""
    at_s: float | None = None
    """When it was made, by the clock of its rig [s]."""


@dataclass(frozen=True, slots=True)
class LiveFigures:
    """Progress of a campaign, as its conductor says."""

    cases: int
    left: int
    leased: int
    paused: bool
    per_minute: float | None
    workers: int


@dataclass
class ShownRun:
    """A campaign with what was made of it."""

    run: RunFolder
    cache: PictureCache
    heard: HeardCases = field(default_factory=HeardCases)
    """What a conductor and simulators have said of its cases."""
    campaign: str = ""
    """Its name for the conductor; empty: none serves it."""
    live: LiveFigures | None = None
    """How it goes; None: no conductor says it."""
    running: frozenset[str] = frozenset()
    """Cases that a worker has now."""
    away: str | None = None
    """Its folder as its conductor sees it, where no file of it is at hand; empty: nobody says where
    that is. None: its files are at hand."""
    files: RemoteFiles | None = None
    """Gives logs and KPI rows of its cases, where no file of it is at hand."""
    portable: bool = False
    """Its pages are read elsewhere: commands in them name no path of this machine."""
    live_pictures: dict[str, LivePicture] = field(default_factory=dict)
    """Latest picture of cases that ran while we looked."""
    _table: tuple[Any, ConsoleTable] | None = None
    _answers: dict[str, tuple[Any, SiteAnswer]] = field(default_factory=dict)
    _endings: tuple[Any, dict[str, CaseEnding]] | None = None
    _places: tuple[dict[str, CaseEnding], dict[str, int]] | None = None
    _recorded: tuple[Any, list[bool]] | None = None
    _attempts: OrderedDict[tuple[str, str], RecordedAttempt] = field(default_factory=OrderedDict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    @property
    def version(self) -> tuple[Any, ...]:
        """Changes when the table does."""
        return (self.run.version, self.heard.version, self.running)

    @property
    def campaign_file(self) -> str:
        """Path of the campaign file for a command: absolute where it is at hand, else from the
        folder that holds the campaign's; or as the conductor sees it."""
        if self.away:
            return f"{self.away}/{CAMPAIGN_FILE}"
        path = self.run.folder / CAMPAIGN_FILE
        if not self.portable and path.is_file():
            return str(path.absolute())
        return f"{self.run.folder.name}/{CAMPAIGN_FILE}"

    def away_json(self) -> dict[str, Any] | None:
        """Where its files are, and the command that shows them there; None: they are at hand."""
        if self.away is None:
            return None
        command = f"viewer web --run {shlex.quote(self.away)}" if self.away else None
        return {"folder": self.away or None, "command": command}

    def endings(self) -> dict[str, CaseEnding]:
        """Endings of all cases, in the order of the table: as the outcomes have it, which are
        written every few seconds, and as was heard since.

        Raises:
            TwinError: as :meth:`RunFolder.ending`.
        """
        with self._lock:
            version = (self.run.version, self.heard.version)
            if self._endings is None or self._endings[0] != version:
                endings = dict(self.run.ending().cases)
                if not endings:
                    endings = {name: CaseEnding() for name in self.run.points()}
                for case, ending in self.heard.endings().items():
                    # What was heard of a lease alone knows no attempts and no charges.
                    if case not in endings or (ending.outcome and not endings[case].outcome):
                        endings[case] = ending
                self._endings = version, endings
            return self._endings[1]

    def table(self) -> ConsoleTable:
        """The table as it stands; raises TwinError as :meth:`RunFolder.ending`."""
        with self._lock:
            version = self.version
            if self._table is None or self._table[0] != version:
                axes: dict[str, Any] = self.heard.axes()
                axes |= {name: plain_axes(point) for name, point in self.run.points().items()}
                self._table = version, console_table(self.endings(), axes, self.running)
            return self._table[1]

    def kept(self, name: str, make: Callable[[], Any]) -> SiteAnswer:
        """An answer that stays as long as the table does."""
        with self._lock:
            version = self.version
            if name not in self._answers or self._answers[name][0] != version:
                self._answers[name] = version, as_json(make())
            return self._answers[name][1]

    def index(self, case: str) -> int:
        """Place of a case in the table; raises UsageError: there is none."""
        place = self.places().get(case)
        if place is None:
            raise UsageError(f"{self.run.id}: no case '{case}'")
        return place

    def places(self) -> dict[str, int]:
        """Place of each case in the table."""
        with self._lock:
            endings = self.endings()
            if self._places is None or self._places[0] is not endings:
                self._places = endings, {case: place for place, case in enumerate(endings)}
            return self._places[1]

    def ending(self, case: str) -> CaseEnding:
        """Ending of a case."""
        return self.endings().get(case, CaseEnding())

    def attempt(self, case: str) -> RecordedAttempt:
        """What a case left, kept for as long as it is looked at; raises UsageError: no such
        case."""
        self.index(case)
        ending = self.ending(case)
        committed = Path(ending.attempt_dir).name
        with self._lock:
            key = (case, committed)
            # Of one that runs the files grow, so nothing is kept.
            if key not in self._attempts or not committed:
                self._attempts[key] = self._left_by(case, committed, ending.status)
            self._attempts.move_to_end(key)
            while len(self._attempts) > ATTEMPTS_MAX:
                self._attempts.popitem(last=False)
            return self._attempts[key]

    def forget_attempts(self) -> None:
        """What cases left is of another campaign of the same name."""
        with self._lock:
            self._attempts.clear()

    def _left_by(self, case: str, committed: str, status: str) -> RecordedAttempt:
        if self.files is None:
            return RecordedAttempt(self.run, case, committed, status)
        return RemoteAttempt(self.run, case, committed, status, self.files, self.campaign)

    def recorded(self) -> list[bool]:
        """Whether there is a picture of each case."""
        with self._lock:
            version = (self.run.version, self.heard.version, len(self.live_pictures))
            if self._recorded is None or self._recorded[0] != version:
                self._recorded = version, [self.has_picture(case) for case in self.table().cases]
            return self._recorded[1]

    def has_picture(self, case: str) -> bool:
        """Whether there is a picture of a case; it may be a question to the disk."""
        if case in self.live_pictures:
            return True
        ending = self.run.ending().cases.get(case, CaseEnding())
        return has_recording(self.run, case, Path(ending.attempt_dir).name)

    def moment_picture(self, case: str) -> bytes:
        """A WebP of the decisive moment, or the latest JPEG of one that runs.

        Raises:
            UsageError: there is no picture.
        """
        ending = self.ending(case)
        latest = self.live_pictures.get(case)
        if not ending.outcome and latest is not None:
            return latest.jpeg
        committed = Path(ending.attempt_dir).name
        attempt = RecordedAttempt(self.run, case, committed, ending.status)
        if attempt.found is None:
            if latest is not None:
                return latest.jpeg
            raise UsageError(f"{case}: not recorded; run the campaign with --view record")
        path = attempt.found.path
        status = path.stat()
        written = f"{status.st_mtime_ns} {status.st_size} {ending.status}"
        key = f"moment {MOMENT_SIZE} {case} {path.parent.name} {written}"

        def make() -> bytes:
            moment = attempt.moment
            return moment_picture(read_pictures(path), moment.sim_time_ns if moment else 0)

        return self.cache.get(key, make)
