"""Campaigns in the list, and what the page must know of one before it shows its cases."""

from __future__ import annotations

import hashlib
import time
from typing import Any

from msgspec import Struct

from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.rulebook_result import FILE_NAME as RULEBOOK_FILE
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from twin.base.errors import TwinError
from viewer.console.pictures import PER_SHEET, SIZES
from viewer.console.resources import gpus_of
from viewer.console.run_folder import CaseEnding, RunFolder
from viewer.console.shown_run import ShownRun, component
from viewer.console.table import verdict_words

MANIFEST_BYTES_MAX = 256 << 20
"""Largest manifest that is read [bytes]."""


class _Manifest(Struct, frozen=True):
    """What the console tells of a manifest."""

    fingerprint: str


def run_row(shown: ShownRun) -> dict[str, Any]:
    """A campaign in the list; one that cannot be read says why, and is no other's mistake."""
    try:
        return _row(shown)
    except (TwinError, OSError) as error:
        return _damaged_row(shown, error)


def _damaged_row(shown: ShownRun, error: Exception) -> dict[str, Any]:
    return {
        "id": shown.run.id,
        "name": shown.campaign or shown.run.id,
        "state": "damaged",
        "error": escape(str(error)),
        "paused": False,
        "cases": 0,
        "done": 0,
        "verdicts": {},
        "running": None,
        **dict.fromkeys(("started_s", "elapsed_s", "eta_s", "per_minute")),
        **dict.fromkeys(("workers", "gpus", "device_hours")),
    }


def _row(shown: ShownRun) -> dict[str, Any]:
    ending, times = shown.run.ending(), shown.run.times()
    live = None if ending.complete else shown.live
    endings = shown.endings()
    verdicts: dict[str, int] = {}
    for row in endings.values():
        if row.status:
            verdicts[row.status] = verdicts.get(row.status, 0) + 1
    done = sum(verdicts.values())
    elapsed_s = None
    if times.first_s is not None and times.last_s is not None:
        # The log of leases says nothing while a long case runs.
        last_s = times.last_s if live is None else max(times.last_s, time.time())
        elapsed_s = last_s - times.first_s
    rig_s = sum(row.rig_wall_s for row in endings.values())
    cases = max(len(endings), live.cases if live else 0)
    done = max(done, live.cases - live.left if live else 0)
    per_minute = 60 * done / elapsed_s if elapsed_s and done else None
    eta_s = None
    if live is not None:
        per_minute = live.per_minute
        eta_s = 60 * live.left / per_minute if per_minute else None
    return {
        "id": shown.run.id,
        "name": shown.campaign or ending.campaign,
        "state": _state(shown),
        "error": None,
        "paused": live is not None and live.paused,
        "cases": cases,
        "done": done,
        "verdicts": verdicts,
        "running": None if live is None else _running(shown, endings),
        "started_s": times.first_s,
        "elapsed_s": elapsed_s,
        "eta_s": eta_s,
        "per_minute": per_minute,
        "workers": live.workers if live is not None else times.workers,
        "gpus": gpus_of(shown.run),
        "device_hours": rig_s / 3600 if rig_s else None,
    }


def _running(shown: ShownRun, endings: dict[str, CaseEnding]) -> int:
    """Cases that a worker has now; one that has just ended may still be among the leases."""
    return sum(not endings[case].outcome for case in shown.running if case in endings)


def _state(shown: ShownRun) -> str:
    if shown.run.ending().complete:
        return "finished"
    if shown.live is not None:
        done = shown.live.leased or shown.live.left < shown.live.cases
        return "running" if done else "waiting"
    began = any(row.outcome for row in shown.endings().values())
    return "running" if shown.run.served and began else "waiting"


def run_json(shown: ShownRun) -> dict[str, Any]:
    """A campaign with what its table holds; raises TwinError, OSError: it cannot be read."""
    table, ending, folder = shown.table(), shown.run.ending(), shown.run.folder
    name = component(shown.run.id)
    return {
        **_row(shown),
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
        "away": shown.away_json(),
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
        manifest = decode_json(run.read("manifest.json", MANIFEST_BYTES_MAX), _Manifest)
    except (OSError, JsonError):
        return None
    return manifest.fingerprint or None


def table_version(shown: ShownRun) -> str:
    """Changes when the table does."""
    run, heard, running = shown.version
    text = f"{run} {heard} {sorted(running)}"
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
