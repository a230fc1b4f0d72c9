"""Everything that the console answers below ``data/``, by address: served now, or written as files.

The same function makes both, so a console that was written out shows what the served one did.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import msgspec

from schemas.files.rulebook_result import FILE_NAME as RULEBOOK_FILE
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from twin.base.errors import EXIT_FAILED, UsageError
from viewer.console.case_page import case_page, film_of
from viewer.console.pictures import (
    FILM_FRAMES,
    MOMENT_SIZE,
    PER_SHEET,
    SIZES,
    PictureCache,
    cache_folder,
    film_size,
    moment_picture,
    picture_from,
    sheet,
    strip,
)
from viewer.console.recorded import RecordedAttempt, has_recording
from viewer.console.run_folder import CaseEnding, RunFolder, plain_axes
from viewer.console.series import case_series
from viewer.console.table import ConsoleTable, case_table, verdict_words
from viewer.playback.frames import read_pictures
from viewer.playback.video import schedule

PACK_LEVEL = 5
"""Of gzip: 6 takes twice as long for two per cent."""
JSON, WEBP = "application/json", "image/webp"
FILE_BYTES_MAX = 256 << 20
"""Largest search or rulebook file that is passed on [bytes]."""
ATTEMPTS_MAX = 8
"""Cases whose recording stays in memory, for the page that looks at them."""
COMPARE_S = 600.0
"""Longest time a comparison may take [s]."""


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


@dataclass
class ShownRun:
    """A campaign with what was made of it."""

    run: RunFolder
    cache: PictureCache
    running: frozenset[str] = frozenset()
    """Cases that a worker has now."""
    live_pictures: dict[str, bytes] = field(default_factory=dict)
    """Latest picture of cases that ran while we looked, JPEG."""
    _table: tuple[Any, ConsoleTable] | None = None
    _answers: dict[str, tuple[Any, SiteAnswer]] = field(default_factory=dict)
    _recorded: tuple[Any, list[bool]] | None = None
    _attempts: OrderedDict[tuple[str, str], RecordedAttempt] = field(default_factory=OrderedDict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def table(self) -> ConsoleTable:
        """The table as it stands; raises TwinError as :meth:`RunFolder.ending`."""
        with self._lock:
            version = (self.run.version, self.running)
            if self._table is None or self._table[0] != version:
                points = self.run.points()
                axes = {name: plain_axes(point) for name, point in points.items()}
                endings = self.run.ending().cases
                if not endings:
                    endings = {name: CaseEnding() for name in points}
                self._table = version, case_table(endings, axes, self.running)
            return self._table[1]

    def kept(self, name: str, make: Callable[[], Any]) -> SiteAnswer:
        """An answer that stays as long as the table does."""
        with self._lock:
            version = (self.run.version, self.running, self.run.served)
            if name not in self._answers or self._answers[name][0] != version:
                self._answers[name] = version, as_json(make())
            return self._answers[name][1]

    def index(self, case: str) -> int:
        """Place of a case in the table; raises UsageError: there is none."""
        try:
            return self.table().cases.index(case)
        except ValueError:
            raise UsageError(f"{self.run.id}: no case '{case}'") from None

    def ending(self, case: str) -> CaseEnding:
        """How a case ended."""
        return self.run.ending().cases.get(case, CaseEnding())

    def attempt(self, case: str) -> RecordedAttempt:
        """What a case left, kept for as long as it is looked at; raises UsageError: no such
        case."""
        self.index(case)
        committed = Path(self.ending(case).attempt_dir).name
        with self._lock:
            key = (case, committed)
            # Of one that runs the files grow, so nothing is kept.
            if key not in self._attempts or not committed:
                self._attempts[key] = RecordedAttempt(self.run, case, committed)
            self._attempts.move_to_end(key)
            while len(self._attempts) > ATTEMPTS_MAX:
                self._attempts.popitem(last=False)
            return self._attempts[key]

    def recorded(self) -> list[bool]:
        """Whether there is a picture of each case."""
        with self._lock:
            version = (self.run.version, len(self.live_pictures))
            if self._recorded is None or self._recorded[0] != version:
                endings = self.run.ending().cases
                self._recorded = (
                    version,
                    [
                        case in self.live_pictures
                        or has_recording(
                            self.run, case, Path(endings.get(case, CaseEnding()).attempt_dir).name
                        )
                        for case in self.table().cases
                    ],
                )
            return self._recorded[1]

    def moment_picture(self, case: str) -> bytes:
        """A WebP of the decisive moment, or the latest JPEG of one that runs.

        Raises:
            UsageError: there is no picture.
        """
        ending = self.ending(case)
        if not ending.outcome and case in self.live_pictures:
            return self.live_pictures[case]
        committed = Path(ending.attempt_dir).name
        attempt = RecordedAttempt(self.run, case, committed)
        if attempt.found is None:
            if case in self.live_pictures:
                return self.live_pictures[case]
            raise UsageError(f"{case}: not recorded; run the campaign with --view record")
        path = attempt.found.path
        status = path.stat()
        key = (
            f"moment {MOMENT_SIZE} {case} {path.parent.name} {status.st_mtime_ns} {status.st_size}"
        )

        def make() -> bytes:
            moment = attempt.moment
            return moment_picture(read_pictures(path), moment.sim_time_ns if moment else 0)

        return self.cache.get(key, make)


class ConsoleSite:
    """What is shown, and the answers to addresses below ``data/``."""

    def __init__(self, runs: list[RunFolder], *, keep: bool = True) -> None:
        """
        Args:
            runs: campaigns, in the order of the list.
            keep: pictures are kept beside the runs, else in memory.
        """
        self.runs: dict[str, ShownRun] = {}
        for run in runs:
            self.add(run, keep=keep)

    def add(self, run: RunFolder, *, keep: bool = True) -> ShownRun:
        """Show one more campaign; one that is shown already stays."""
        if run.id not in self.runs:
            folder = cache_folder(run.folder) if keep else None
            self.runs[run.id] = ShownRun(run, PictureCache(folder))
        return self.runs[run.id]

    def run(self, name: str) -> RunFolder:
        """A campaign; an empty name means the only one. Raises UsageError: there is none."""
        if not name and len(self.runs) == 1:
            return next(iter(self.runs.values())).run
        return self._run(name).run

    def answer(self, path: str) -> SiteAnswer:
        """The content of ``data/PATH``.

        Args:
            path: address, still quoted: names of cases may hold any character.

        Raises:
            TwinError: there is nothing; one line.
            OSError: the disk lets us down.
        """
        parts = [unquote(part) for part in path.split("/")]
        match parts:
            case ["runs.json"]:
                return as_json(self.runs_json())
            case ["runs", run, *rest]:
                return self._of_run(self._run(run), rest)
            case ["compare", before, after] if after.endswith(".json"):
                return self._compare(self._run(before), self._run(after.removesuffix(".json")))
        raise UsageError("nothing has this address")

    def runs_json(self) -> dict[str, Any]:
        """The list of campaigns."""
        rows = [run_row(shown) for shown in self.runs.values()]
        return {"live": False, "roles": "look", "runs": rows}

    def addresses(self) -> Iterator[str]:
        """Every address with a content, of what has ended; those of one case stand together."""
        yield "runs.json"
        for run in self.runs.values():
            base = f"runs/{quote(run.run.id, safe='')}"
            yield from (f"{base}/run.json", f"{base}/table.json", f"{base}/pictures/atlas.json")
            for name in (SEARCH_FILE, RULEBOOK_FILE):
                if (run.run.folder / name).is_file():
                    yield f"{base}/{name}"
            recorded = run.recorded()
            for width, height in SIZES:
                for number in range(-(-len(recorded) // PER_SHEET)):
                    if any(recorded[number * PER_SHEET : (number + 1) * PER_SHEET]):
                        yield f"{base}/pictures/{width}x{height}/{number}.webp"
            for case, has in zip(run.table().cases, recorded, strict=True):
                at = f"{base}/cases/{quote(case, safe='')}"
                yield from (f"{at}/case.json", f"{at}/series.json")
                if not has:
                    continue
                yield f"{at}/moment.webp"
                film = film_of(run.attempt(case))
                yield from (f"{at}/film/{k}.webp" for k in range(film["strips"] if film else 0))

    def _run(self, name: str) -> ShownRun:
        if name not in self.runs:
            raise UsageError(
                f"no campaign '{name}' here; {', '.join(self.runs) or 'there is none'}"
            )
        return self.runs[name]

    def _of_run(self, shown: ShownRun, rest: list[str]) -> SiteAnswer:
        match rest:
            case ["run.json"]:
                return as_json(run_json(shown))
            case ["table.json"]:
                return shown.kept("table", lambda: table_json(shown))
            case ["search.json"]:
                return _passed_on(shown, SEARCH_FILE)
            case ["rulebook.json"]:
                return _passed_on(shown, RULEBOOK_FILE)
            case ["pictures", "atlas.json"]:
                return as_json(atlas_json(shown))
            case ["pictures", size, name]:
                return _sheet(shown, size, _number(name))
            case ["cases", case, name]:
                return _of_case(shown, case, name)
            case ["cases", case, "film", name]:
                return _film_strip(shown, case, _number(name))
        raise UsageError("nothing has this address")

    def _compare(self, before: ShownRun, after: ShownRun) -> SiteAnswer:
        """As `conductor compare` has it, asked once per version of the two."""
        folders = [str(shown.run.folder) for shown in (before, after)]
        key = f"compare {folders} {before.run.version} {after.run.version}"
        return SiteAnswer(before.cache.get(key, lambda: _compared(folders)), JSON)


def run_row(shown: ShownRun) -> dict[str, Any]:
    """A campaign in the list."""
    ending, times = shown.run.ending(), shown.run.times()
    table = shown.table()
    verdicts: dict[str, int] = {}
    for row in ending.cases.values():
        if row.status:
            verdicts[row.status] = verdicts.get(row.status, 0) + 1
    done = sum(verdicts.values())
    state = "finished" if ending.complete else "running" if shown.run.served else "waiting"
    elapsed_s = None
    if times.first_s is not None and times.last_s is not None:
        elapsed_s = times.last_s - times.first_s
    rig_s = sum(row.rig_wall_s for row in ending.cases.values())
    return {
        "id": shown.run.id,
        "name": ending.campaign,
        "state": state,
        "cases": len(table.cases),
        "done": done,
        "verdicts": verdicts,
        "started_s": times.first_s,
        "elapsed_s": elapsed_s,
        "eta_s": None,
        "per_minute": 60 * done / elapsed_s if elapsed_s and done else None,
        "workers": times.workers,
        "gpus": None,
        "device_hours": rig_s / 3600 if rig_s else None,
    }


def run_json(shown: ShownRun) -> dict[str, Any]:
    """A campaign with what its table holds."""
    table, ending, folder = shown.table(), shown.run.ending(), shown.run.folder
    name = quote(shown.run.id, safe="")
    return {
        **run_row(shown),
        "version": table_version(shown),
        "axes": table.axes,
        "columns": table.heads,
        "verdict_words": verdict_words(),
        "links": {
            "report": f"report/{name}/report.html" if (folder / "report.html").is_file() else None,
            "search": f"data/runs/{name}/search.json" if (folder / SEARCH_FILE).is_file() else None,
            "rulebook": f"data/runs/{name}/rulebook.json"
            if (folder / RULEBOOK_FILE).is_file()
            else None,
        },
        "digest": ending.digest or None,
        "software": ending.software or None,
        "device_classes": ending.device_classes,
        "fingerprint": fingerprint_of(shown.run),
    }


def table_json(shown: ShownRun) -> dict[str, Any]:
    """The table of all cases, in columns."""
    table = shown.table()
    return {"version": table_version(shown), "cases": table.cases, "columns": table.columns}


def fingerprint_of(run: RunFolder) -> str | None:
    """The fingerprint that the signed manifest names; None: nobody has signed it."""
    try:
        manifest = json.loads(run.read("manifest.json", FILE_BYTES_MAX))
        return str(manifest["fingerprint"]) or None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def table_version(shown: ShownRun) -> str:
    """Changes when the table does."""
    text = f"{shown.run.version} {sorted(shown.running)}"
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def atlas_json(shown: ShownRun) -> dict[str, Any]:
    """Which cases have a picture. Moments are in ``case.json``: here they would take reading the
    rows of all cases."""
    recorded = shown.recorded()
    return {
        "sizes": [list(size) for size in SIZES],
        "per_atlas": PER_SHEET,
        "has": recorded,
        "moment": [None] * len(recorded),
    }


def _sheet(shown: ShownRun, size: str, number: int) -> SiteAnswer:
    for width, height in SIZES:
        if size == f"{width}x{height}":
            break
    else:
        raise UsageError(f"pictures of {size}: there are {', '.join(f'{w}x{h}' for w, h in SIZES)}")
    cases = shown.table().cases[number * PER_SHEET : (number + 1) * PER_SHEET]
    if not cases:
        raise UsageError(f"there is no sheet {number}")
    has = shown.recorded()[number * PER_SHEET :]

    def tile(case: str) -> Any:
        try:
            return picture_from(shown.moment_picture(case))
        except (UsageError, OSError):
            return None

    def make() -> bytes:
        tiles = [tile(case) if there else None for case, there in zip(cases, has, strict=False)]
        return sheet(tiles, width, height)

    ended = all(shown.ending(case).outcome for case in cases)
    if not ended:
        return SiteAnswer(make(), WEBP)
    return SiteAnswer(shown.cache.get(f"sheet {size} {number} {shown.run.version}", make), WEBP)


def _of_case(shown: ShownRun, case: str, name: str) -> SiteAnswer:
    match name:
        case "case.json":
            index = shown.index(case)
            page = case_page(shown.attempt(case), shown.ending(case), shown.table(), index)
            return as_json(_with_links(shown, case, page))
        case "series.json":
            return as_json(case_series(shown.attempt(case)))
        case "moment.webp":
            shown.index(case)
            data = shown.moment_picture(case)
            return SiteAnswer(data, WEBP if data[:4] == b"RIFF" else "image/jpeg")
    raise UsageError("nothing has this address")


def _with_links(shown: ShownRun, case: str, page: dict[str, Any]) -> dict[str, Any]:
    run, name = quote(shown.run.id, safe=""), quote(case, safe="")
    seconds = page["moment"]["t"] if page["moment"] else 0
    there = page["links"]["recording"]
    page["links"] |= {
        "recording": f"recording/{run}/{name}.rrd" if there else None,
        "in_full": f"view?run={run}&case={name}#when=sim_time@+{seconds:g}s" if there else None,
        "video": None,
    }
    return page


def _film_strip(shown: ShownRun, case: str, number: int) -> SiteAnswer:
    attempt = shown.attempt(case)
    if attempt.found is None or attempt.recording is None:
        raise UsageError(f"{case}: not recorded; run the campaign with --view record")
    path, recording = attempt.found.path, attempt.recording
    times_ns, _ = schedule(recording)
    mine = times_ns[number * FILM_FRAMES : (number + 1) * FILM_FRAMES]
    if not mine:
        raise UsageError(f"{case}: there is no strip {number}")
    status = path.stat()
    key = f"film {case} {path.parent.name} {status.st_mtime_ns} {status.st_size} {number}"

    def make() -> bytes:
        width, height = film_size(recording)
        return strip([recording.picture_at(time_ns) for time_ns in mine], width, height)

    return SiteAnswer(shown.cache.get(key, make), WEBP)


def _passed_on(shown: ShownRun, name: str) -> SiteAnswer:
    try:
        data = shown.run.read(name, FILE_BYTES_MAX)
        return as_json(json.loads(data, parse_constant=lambda _: None))
    except FileNotFoundError:
        raise UsageError(f"{shown.run.id}: there is no {name}") from None
    except ValueError as error:
        raise UsageError(f"{shown.run.id}: {name} is damaged: {error}") from None


def _compared(folders: list[str]) -> bytes:
    command = [sys.executable, "-m", "conductor", "compare", *folders, "--output", "json"]
    done = subprocess.run(command, capture_output=True, timeout=COMPARE_S, check=False)
    if done.returncode not in (0, EXIT_FAILED):
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise UsageError(lines[-1] if lines else f"conductor compare: exit code {done.returncode}")
    return as_json(json.loads(done.stdout)).data


def _number(name: str) -> int:
    text = name.removesuffix(".webp")
    if not name.endswith(".webp") or not (text.isascii() and text.isdecimal()) or len(text) > 6:
        raise UsageError("nothing has this address")
    return int(text)
