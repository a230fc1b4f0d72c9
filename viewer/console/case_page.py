"""One case as the page shows it: what came of it, what happened when, and who stands beside it."""

from __future__ import annotations

import math
from typing import Any

from schemas.escape import escape
from twin.base.errors import UsageError
from twin.base.process import last_frames
from twin.records.repeating import repeat_command
from viewer.console.pictures import FILM_FRAMES, film_size, pixels_of
from viewer.console.recorded import RecordedAttempt
from viewer.console.run_folder import CaseEnding
from viewer.console.table import ConsoleTable, kpis_of, title_of
from viewer.playback.video import schedule

EVENTS_MAX = 1000
"""Most events of a case."""
LINE_CHARS_MAX = 2000
"""Longest line of a log that is shown [characters]."""


def case_page(
    attempt: RecordedAttempt, ending: CaseEnding, table: ConsoleTable, index: int, campaign: str
) -> dict[str, Any]:
    """``case.json``; what was not recorded is None.

    Args:
        attempt: what the case left.
        ending: how it ended.
        table: of all cases.
        index: place of the case in it.
        campaign: path of the campaign file, for the command that repeats the case.
    """
    moment, found = attempt.moment, attempt.found
    return {
        "case": attempt.case,
        "index": index,
        "state": table.columns["state"][index],
        "outcome": ending.outcome or None,
        "verdict": ending.status or None,
        "passed": ending.passed if ending.outcome == "verdict" else None,
        "reasons": [escape(reason) for reason in ending.reasons],
        "axes": {axis["name"]: table.columns[axis["name"]][index] for axis in table.axes},
        "kpis": _kpis(ending),
        "names": ending.names,
        "moment": moment.as_json() if moment else None,
        "events": _events(attempt),
        "neighbours": neighbours(table, index),
        "repeat": repeat_command(campaign, attempt.case, case=attempt.case, record=True),
        "log": _log(attempt),
        "attempts": _attempts(attempt, ending),
        "film": film_of(attempt),
        "links": {
            "recording": found is not None,
            "incomplete": None if found is None else not found.complete,
        },
    }


def neighbours(table: ConsoleTable, index: int) -> dict[str, dict[str, Any]]:
    """Cases that differ on one axis alone: the one before and the one after, in the order of its
    values, each with its place in the table, state and verdict; None: there is none."""
    names = [axis["name"] for axis in table.axes]
    mine = {name: table.columns[name][index] for name in names}
    beside: dict[str, dict[str, Any]] = {}
    for axis in table.axes:
        name = axis["name"]
        others = [other for other in names if other != name]
        line = {
            table.columns[name][row]: row
            for row in reversed(range(len(table.cases)))
            if all(table.columns[other][row] == mine[other] for other in others)
        }
        values = [value for value in axis["values"] if value in line]
        if mine[name] not in values or len(values) < 2:
            continue
        place = values.index(mine[name])
        before = values[place - 1] if place else None
        after = values[place + 1] if place + 1 < len(values) else None
        beside[name] = {
            "before": None if before is None else _neighbour(table, line[before], before),
            "after": None if after is None else _neighbour(table, line[after], after),
        }
    return beside


def _neighbour(table: ConsoleTable, row: int, value: Any) -> dict[str, Any]:
    cells = {name: table.columns[name][row] for name in ("state", "verdict")}
    return {"case": table.cases[row], "value": value, "index": row, **cells}


def film_of(attempt: RecordedAttempt) -> dict[str, Any] | None:
    """The film as strips of :data:`FILM_FRAMES` frames; None: no picture was recorded."""
    if attempt.recording is None:
        return None
    try:
        times_ns, period_ns = schedule(attempt.recording)
        size = film_size(attempt.recording)
        pixels = pixels_of(attempt.recording.picture_at(times_ns[0]))
    except UsageError:
        return None
    return {
        "format": "webp strips",
        "per_strip": FILM_FRAMES,
        "strips": -(-len(times_ns) // FILM_FRAMES),
        "fps": 1e9 / period_ns,
        "frames": len(times_ns),
        "size": list(size),
        "picture": [pixels.shape[1], pixels.shape[0]],
        "first_t": times_ns[0] / 1e9,
    }


def _kpis(ending: CaseEnding) -> list[dict[str, Any]]:
    return [
        {
            "name": kind.name,
            "title": kind.label.partition(" [")[0] or title_of(kind.name),
            "value": _finite(ending.scalars.get(kind.name)),
            "unit": kind.unit,
            "digits": kind.digits,
            "better": {"less": "low", "more": "high"}.get(kind.better),
            "doc": kind.doc,
        }
        for kind in kpis_of([ending])
    ]


def _events(attempt: RecordedAttempt) -> list[dict[str, Any]]:
    """Lines of the recording's log, else what the rows say; by sim time."""
    if attempt.recording is not None and attempt.recording.events:
        return [
            {
                "t": event.sim_time_ns / 1e9,
                "what": event.level.lower(),
                "detail": escape(event.text),
            }
            for event in attempt.recording.events[:EVENTS_MAX]
        ]
    if not attempt.rows:
        return []
    times, braked, count = attempt.rows["sim_time_ns"], False, 0
    events = []
    for row, time_ns in enumerate(times):
        braking = bool(attempt.rows.get("aeb", [])[row : row + 1] == [True])
        if braking and not braked:
            events.append({"t": time_ns / 1e9, "what": "warn", "detail": "AEB triggered"})
        braked = braking
        collisions = (attempt.rows.get("collisions") or [0] * len(times))[row] or 0
        if collisions > count:
            events.append({"t": time_ns / 1e9, "what": "error", "detail": "collision"})
        count = collisions
    return events[:EVENTS_MAX]


def _log(attempt: RecordedAttempt) -> dict[str, Any] | None:
    read = attempt.log()
    if read is None:
        return None
    text, cut = read
    return {
        "lines": [escape(line, LINE_CHARS_MAX) for line in text.splitlines()],
        "cut": cut,
        "traceback": [escape(line, LINE_CHARS_MAX) for line in last_frames(text)] or None,
    }


def _attempts(attempt: RecordedAttempt, ending: CaseEnding) -> dict[str, Any]:
    return {
        "count": ending.attempts,
        "committed": ending.attempt or None,
        "shown": attempt.attempt or None,
        "folders": attempt.attempts,
        "charges": [escape(charge) for charge in ending.charges],
        "steered": [escape(touch) for touch in ending.steered],
        "doubles": attempt.run.doubles(attempt.case) if ending.attempts > 1 else [],
        "worker": ending.worker or None,
        "device_class": ending.device_class or None,
        "wall_s": _finite(ending.wall_s) if ending.attempt else None,
    }


def _finite(value: float | int | None) -> float | int | None:
    return value if value is not None and math.isfinite(value) else None
