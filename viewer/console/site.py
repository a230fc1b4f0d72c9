"""Everything that the console answers below ``data/``, by address: served now, or written as files.

The same function makes both, so a console that was written out shows what the served one did.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any
from urllib.parse import unquote

from schemas.files.rulebook_result import FILE_NAME as RULEBOOK_FILE
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from twin.base.errors import EXIT_FAILED, TwinError, UsageError
from viewer.console.case_page import case_page, film_of
from viewer.console.overview import atlas_json, run_json, run_row, table_json
from viewer.console.pictures import (
    FILM_FRAMES,
    PER_SHEET,
    SIZES,
    PictureCache,
    cache_folder,
    film_size,
    picture_from,
    sheet,
    strip,
)
from viewer.console.resources import resources_of
from viewer.console.run_folder import RunFolder
from viewer.console.series import case_series
from viewer.console.shown_run import JPEG, JSON, WEBP, ShownRun, SiteAnswer, as_json, component
from viewer.console.table import verdict_words
from viewer.playback.video import schedule

FILE_BYTES_MAX = 256 << 20
"""Largest search or rulebook file that is passed on [bytes]."""
COMPARE_S = 600.0
"""Longest time a comparison may take [s]."""


COMPARISONS_MAX = 2
"""Comparisons that are made at the same time; further ones wait."""
_COMPARING = threading.BoundedSemaphore(COMPARISONS_MAX)


class ConsoleSite:
    """What is shown, and the answers to addresses below ``data/``."""

    def __init__(self, runs: list[RunFolder], *, keep: bool = True) -> None:
        """Show some campaigns.

        Args:
            runs: campaigns, in the order of the list.
            keep: pictures are kept beside the runs, else in memory.
        """
        self.runs: dict[str, ShownRun] = {}
        self.live = False
        """Whether a conductor is listened to."""
        for run in runs:
            self.add(run, keep=keep)

    def add(self, run: RunFolder, *, keep: bool = True) -> ShownRun:
        """Show one more campaign; the second of a name gets a number."""
        number, name = 2, run.id
        while run.id in self.runs:
            run.id = f"{name}-{number}"
            number += 1
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
        rows = [run_row(shown) for shown in list(self.runs.values())]
        return {
            "live": self.live,
            "roles": "look",
            "runs": rows,
            "verdict_words": verdict_words(),
        }

    def warm(self) -> None:
        """Read what the first page will ask for; what is wrong is told when it asks."""
        for shown in list(self.runs.values()):
            with contextlib.suppress(TwinError, OSError):
                shown.table()
                shown.recorded()

    def addresses(self) -> Iterator[str]:
        """Every address with a content, of what has ended; those of one case stand together."""
        yield "runs.json"
        for run in self.runs.values():
            yield from self.addresses_of(run)

    def addresses_of(self, run: ShownRun) -> Iterator[str]:
        """Addresses of one campaign; raises TwinError, OSError: its table cannot be read."""
        base = f"runs/{component(run.run.id)}"
        yield from (f"{base}/run.json", f"{base}/table.json", f"{base}/workers.json")
        yield f"{base}/pictures/atlas.json"
        for name in (SEARCH_FILE, RULEBOOK_FILE):
            if (run.run.folder / name).is_file():
                yield f"{base}/{name}"
        recorded = run.recorded()
        for width, height in SIZES:
            for number in range(-(-len(recorded) // PER_SHEET)):
                if any(recorded[number * PER_SHEET : (number + 1) * PER_SHEET]):
                    yield f"{base}/pictures/{width}x{height}/{number}.webp"
        for case, has in zip(run.table().cases, recorded, strict=True):
            at = f"{base}/cases/{component(case)}"
            yield from (f"{at}/case.json", f"{at}/series.json")
            if not has:
                continue
            yield f"{at}/moment.webp"
            try:
                film = film_of(run.attempt(case))
            except (TwinError, OSError):
                continue  # its page says why
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
            case ["workers.json"]:
                return as_json(idle_workers(shown))
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


def _sheet(shown: ShownRun, size: str, number: int) -> SiteAnswer:
    for width, height in SIZES:
        if size == f"{width}x{height}":
            break
    else:
        raise UsageError(f"pictures of {size}: there are {', '.join(f'{w}x{h}' for w, h in SIZES)}")
    cases = shown.table().cases[number * PER_SHEET : (number + 1) * PER_SHEET]
    if not cases:
        raise UsageError(f"there is no sheet {number}")

    def tile(case: str) -> Any:
        try:
            return picture_from(shown.moment_picture(case))
        except (UsageError, OSError):
            return None

    def make() -> bytes:
        tiles = [tile(case) if shown.has_picture(case) else None for case in cases]
        return sheet(tiles, width, height)

    ended = all(shown.ending(case).outcome for case in cases)
    if not ended:
        return SiteAnswer(make(), WEBP)
    return SiteAnswer(shown.cache.get(f"sheet {size} {number} {shown.run.version}", make), WEBP)


def _of_case(shown: ShownRun, case: str, name: str) -> SiteAnswer:
    match name:
        case "case.json":
            index = shown.index(case)
            attempt, ending = shown.attempt(case), shown.ending(case)
            page = case_page(attempt, ending, shown.table(), index, shown.campaign_file)
            return as_json(_with_links(shown, case, page))
        case "series.json":
            return as_json(case_series(shown.attempt(case)))
        case "moment.webp":
            shown.index(case)
            data = shown.moment_picture(case)
            return SiteAnswer(data, WEBP if data[:4] == b"RIFF" else JPEG)
    raise UsageError("nothing has this address")


def _with_links(shown: ShownRun, case: str, page: dict[str, Any]) -> dict[str, Any]:
    run, name = component(shown.run.id), component(case)
    seconds = page["moment"]["t"] if page["moment"] else 0
    there = page["links"]["recording"]
    page["away"] = shown.away_json()
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
    except RecursionError:
        raise UsageError(f"{shown.run.id}: {name} is damaged: nested too deeply") from None
    except ValueError as error:
        raise UsageError(f"{shown.run.id}: {name} is damaged: {error}") from None


def idle_workers(shown: ShownRun) -> dict[str, Any]:
    """``workers.json`` where no conductor is listened to: what its workers used, and no leases."""
    return {
        "age_s": None,
        "draining": False,
        "storage_error": None,
        **{name: [] for name in ("workers", "leases", "notes", "hosts", "quarantine")},
        "resources": resources_of(shown.run),
    }


def _compared(folders: list[str]) -> bytes:
    command = [sys.executable, "-m", "conductor", "compare", *folders, "--output", "json"]
    try:
        with _COMPARING:
            done = subprocess.run(command, capture_output=True, timeout=COMPARE_S, check=False)
    except subprocess.TimeoutExpired:
        raise UsageError(f"conductor compare takes more than {COMPARE_S:g} s; run it") from None
    if done.returncode not in (0, EXIT_FAILED):
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise UsageError(lines[-1] if lines else f"conductor compare: exit code {done.returncode}")
    return as_json(json.loads(done.stdout)).data


def _number(name: str) -> int:
    text = name.removesuffix(".webp")
    if not name.endswith(".webp") or not (text.isascii() and text.isdecimal()) or len(text) > 6:
        raise UsageError("nothing has this address")
    return int(text)
