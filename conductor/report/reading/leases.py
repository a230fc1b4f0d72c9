"""The leases of a campaign over wall time, from ``timeline.jsonl``; and what they say of its pace.

Wall clock: nothing here reaches a result.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from conductor.records.timeline import (
    CASE_ENDED,
    COMMITTED,
    FILE_NAME,
    LATE,
    LEASED,
    STARTED,
    TimelineEvent,
)
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular

STILL_OPEN = "open"
"""How a lease ended that has not, or whose end a crash kept from being written."""

LOST = "lost"
"""How a lease ended whose worker was not heard of any more."""

_SUPERSEDED = "superseded"


@dataclass(frozen=True, slots=True)
class LeaseSpan:
    """One lease."""

    case: str
    worker: str
    attempt: int
    start_s: float
    """Time since the first lease of the campaign [s]."""
    end_s: float
    how: str
    """``committed``, ``superseded`` (another lease of the case brought the result), ``case_ended``,
    why it was given back, or :data:`STILL_OPEN`."""


@dataclass(frozen=True, slots=True)
class Leases:
    """All leases, by start."""

    spans: list[LeaseSpan]
    commits_s: list[float]
    """When results came, since the first lease [s]."""

    @property
    def busy_s(self) -> float:
        """Time for which at least one lease was held: pauses between two starts are left out
        [s]."""
        total, until = 0.0, 0.0
        for span in self.spans:
            total += max(0.0, span.end_s - max(span.start_s, until))
            until = max(until, span.end_s)
        return total

    @property
    def most(self) -> int:
        """Most leases that were held at once."""
        changes = [(span.start_s, 1) for span in self.spans]
        changes += [(span.end_s, -1) for span in self.spans]
        now = most = 0
        for _, change in sorted(changes):
            now += change
            most = max(most, now)
        return most

    @property
    def workers(self) -> list[str]:
        """Ids, in the order in which they began."""
        return list(dict.fromkeys(span.worker for span in self.spans))


def read_leases(folder: Path) -> Leases:
    """Leases of the campaign ``folder``; damaged lines are left out, without a file there are none.

    A lease that has no end lasts until the last event.
    """
    try:
        lines = read_regular(folder / FILE_NAME, RUN_FILE_BYTES_MAX).splitlines()
    except OSError:
        return Leases([], [])
    events: list[TimelineEvent] = []
    for line in lines:
        try:
            events.append(decode_json(line, TimelineEvent))
        except JsonError:
            continue  # its writer was killed, or the disk was full
    return leases_of(events)


def leases_of(events: list[TimelineEvent]) -> Leases:
    """Fold events, in the order in which they were written.

    A lease that was held while the conductor started again, and that its worker did not end, ends
    at the last event before that: nobody knows whether it was worked on while no conductor ran.
    """
    first_s = next((event.at_s for event in events if event.event == LEASED), 0.0)
    live: dict[str, dict[int, TimelineEvent]] = {}
    seen_s: dict[int, float] = {}
    """Last sign of leases that were held over a start, by token: the last event before it."""
    spans: list[LeaseSpan] = []
    commits: list[float] = []

    def close(event: TimelineEvent, at_s: float, how: str) -> None:
        start_s = event.at_s - first_s
        if how in (LOST, STILL_OPEN, _SUPERSEDED, CASE_ENDED):
            at_s = min(at_s, seen_s.get(event.token, at_s))
        spans.append(
            LeaseSpan(
                event.case, event.worker, event.attempt, start_s, max(at_s - first_s, start_s), how
            )
        )

    before_s = first_s
    for event in events:
        if event.event == STARTED:
            for held in live.values():
                for token in held:
                    seen_s.setdefault(token, before_s)
            continue
        before_s = event.at_s
        held = live.setdefault(event.case, {})
        if event.event == LEASED:
            held[event.token] = event
        elif event.event in (COMMITTED, CASE_ENDED):
            for token, lease in held.items():
                won = event.event == COMMITTED and token == event.token
                close(lease, event.at_s, COMMITTED if won else _lost(event))
            held.clear()
            if event.event == COMMITTED:
                commits.append(event.at_s - first_s)
        elif event.event != LATE and event.token in held:
            close(held.pop(event.token), event.at_s, event.event)
    last_s = max((event.at_s for event in events), default=0.0)
    for held in live.values():
        for lease in held.values():
            close(lease, last_s, STILL_OPEN)
    spans.sort(key=lambda span: (span.start_s, span.worker, span.case))
    return Leases(spans, sorted(commits))


def _lost(event: TimelineEvent) -> str:
    return _SUPERSEDED if event.event == COMMITTED else CASE_ENDED
