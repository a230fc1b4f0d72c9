"""The conductor's status and events -> plots and log lines of the overview. No I/O, no clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import rerun as rr

from schemas.wire.status import ConductorStatus
from viewer.live.throughput import Throughput
from viewer.recording import naming
from viewer.recording.scenery import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    Color,
    Logged,
    verdict_color,
)

WORKERS_MAX = 32
"""Workers with a plot of their own, at most: a view with hundreds of lines shows nothing."""

LINES_MAX = 64
"""Events that wait to be logged, at most; the oldest are left out, and counted."""

_COLORS: dict[str, Color] = {
    "worker_joined": BLUE,
    "worker_left": GREY,
    "worker_draining": GREY,
    "epoch_raised": BLUE,
    "submitted": BLUE,
    "attempt_ended": ORANGE,
    "case_ended": RED,
    "late_attempt": GREY,
    "intervention": VIOLET,
}


class Pulse:
    """What the conductor said, until it is logged."""

    def __init__(self) -> None:
        self.left_out = 0
        """Events that were not logged, because too many came."""
        self._lines: deque[Logged] = deque()
        self._throughput = Throughput()
        self._workers: dict[str, str] = {}
        """Worker -> entity path of its plot."""
        self._fresh: list[Logged] = []

    def status(self, found: ConductorStatus, now_s: float) -> None:
        """The conductor's status as of ``now_s``; takes the place of one not logged yet."""
        campaigns = list(found.get("campaigns", {}).values())
        ended = sum(row["cases"] - row["left"] for row in campaigns)
        per_min = self._throughput.count(ended, now_s)
        here = [row for row in found.get("workers", []) if row["present"]]
        logged: list[Logged] = [
            (naming.RUNNING, rr.Scalars(sum(row["leased"] for row in campaigns))),
            (naming.WORKERS_PRESENT, rr.Scalars(len(here))),
        ]
        if per_min is not None:
            logged.append((naming.THROUGHPUT, rr.Scalars(per_min)))
        for row in here:
            path = self._plot(row["id"])
            if path:
                logged.append((path, rr.Scalars(row["held"])))
        self._fresh = logged

    def event(self, fact: Mapping[str, Any]) -> None:
        """A fact that the conductor has published."""
        text = sentence(fact)
        if text:
            self.say(text, _color(fact))

    def say(self, text: str, color: Color = GREY) -> None:
        """A line for the log."""
        if len(self._lines) >= LINES_MAX:
            self._lines.popleft()
            self.left_out += 1
        self._lines.append((naming.EVENTS, rr.TextLog(text, color=color)))

    def styles(self) -> list[Logged]:
        """Names and colours of the plots that are always there, logged without a time."""
        return [
            (naming.THROUGHPUT, _line("cases per minute", GREEN)),
            (naming.RUNNING, _line("running cases", BLUE)),
            (naming.WORKERS_PRESENT, _line("workers", ORANGE)),
        ]

    def take(self) -> list[Logged]:
        """Rows that have not been logged yet; they are forgotten here."""
        logged = [*self._fresh, *self._lines]
        self._fresh = []
        self._lines.clear()
        return logged

    def _plot(self, worker: str) -> str:
        """Entity path of a worker's plot; empty: there are too many."""
        if worker not in self._workers:
            if len(self._workers) >= WORKERS_MAX:
                return ""
            self._workers[worker] = f"{naming.WORKERS}/{naming.safe_id(worker)}"
            self._lines.append((self._workers[worker], rr.SeriesLines(names=worker)))
        return self._workers[worker]


def sentence(fact: Mapping[str, Any]) -> str:
    """One line for people; empty: not worth one."""
    case = f"{fact.get('campaign', '')}/{fact.get('case', '')}"
    match fact.get("fact"):
        case "submitted":
            return f"campaign {fact['campaign'].get('campaign', '?')} submitted"
        case "worker_joined":
            return f"worker {fact['worker']} joined ({fact['device_class']}, {fact['slots']} slots)"
        case "worker_left":
            return f"worker {fact['worker']} left{_because(fact.get('reason'))}"
        case "worker_draining":
            return f"worker {fact['worker']} drains"
        case "committed":
            result = fact["result"]
            text = ": ".join([result["verdict"] or result["outcome"], *result["reasons"]])
            return f"{result['campaign']}/{result['case']} {text}"
        case "attempt_ended":
            detail = fact.get("detail") or fact["reason"]
            return f"{case} attempt ended without a result: {detail}"
        case "case_ended":
            return f"{case} {fact['outcome']}: {fact['reason']}"
        case "intervention":
            return f"{case} by hand: {fact['what']}, at tick {fact['tick']}"
        case "paused":
            what = case if fact["case"] else fact["campaign"]
            return f"{what} {'paused' if fact['paused'] else 'goes on'}"
        case "retried":
            return f"{case} waits again"
        case "late_attempt":
            result = fact["result"]
            return f"{result['campaign']}/{result['case']} came too late; kept as evidence"
    return ""


def _because(reason: str | None) -> str:
    return f": {reason}" if reason else ""


def _color(fact: Mapping[str, Any]) -> Color:
    if fact.get("fact") == "committed":
        return verdict_color(fact["result"]["verdict"])
    return _COLORS.get(str(fact.get("fact")), GREY)


def _line(name: str, color: Color) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=[color], widths=2.0)
