"""``timeline.jsonl``: when leases began and ended, by the wall clock, in the campaign folder.

The journal knows what happened, not for whom it may be drawn: it is locked by its conductor and
forgets facts that a snapshot stands for. This file is appended to after every commit and may be
read at any moment. It is a log: nothing is ever decided from it, and no result depends on it.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
from msgspec import Struct

from conductor.core.facts import AttemptEnded, CaseEnded, Committed, Fact, LateAttempt, Leased
from conductor.core.state import CampaignState

FILE_NAME = "timeline.jsonl"

LEASED, COMMITTED, CASE_ENDED, LATE = "leased", "committed", "case_ended", "late"
STARTED = "started"
"""Events beside the reasons of :data:`schemas.wire.control.Release`, which end one lease."""

_log = logging.getLogger(__name__)
_encode = msgspec.json.Encoder().encode


class TimelineEvent(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of the file."""

    at_s: float
    """Wall clock since 1970 [s]."""
    event: str
    """``leased``, ``committed``, ``case_ended`` (both end every lease of the case), ``late`` (a
    result with a dead token), ``started`` (the conductor, again), or why a lease was given back."""
    case: str = ""
    token: int = 0
    """Token of the lease; 0: no single lease is meant."""
    worker: str = ""
    attempt: int = 0


def mark_start(folder: Path, at_s: float) -> None:
    """Say in the file of a campaign that its conductor has started again.

    Nobody saw what happened between this event and the one before. A line that a kill has torn is
    ended first, so that it takes no event with it. Without a file there is nothing to say.
    """
    path = folder / FILE_NAME
    try:
        with open(path, "r+b", buffering=0, opener=_no_link) as file:
            if file.seek(0, os.SEEK_END) == 0:
                return
            file.seek(-1, os.SEEK_END)
            torn = file.read(1) != b"\n"
            file.write(b"\n" * torn + _encode(TimelineEvent(at_s=at_s, event=STARTED)) + b"\n")
    except FileNotFoundError:
        pass
    except OSError as error:
        _log.debug("%s: %s", path, error.strerror)


def append_events(
    facts: Iterable[Fact], campaigns: Mapping[str, CampaignState], at_s: float
) -> None:
    """Append what ``facts`` say about leases to the files of their campaigns.

    A file that cannot be written, or is a link, loses these lines; the journal has them.
    """
    lines: dict[str, bytearray] = {}
    for fact in facts:
        named_event = _event(fact, at_s)
        if named_event is not None:
            name, event = named_event
            lines.setdefault(name, bytearray()).extend(_encode(event) + b"\n")
    for name, text in lines.items():
        path = f"{campaigns[name].out}/{FILE_NAME}"
        try:
            # Without a file object: this is done after every commit.
            descriptor = _no_link(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            try:
                os.write(descriptor, text)
            finally:
                os.close(descriptor)
        except OSError as error:
            _log.debug("%s: %s", path, error.strerror)


def _no_link(path: str, flags: int) -> int:
    """Other files of a campaign are replaced; this one is written into, so what lies there counts:
    neither a link nor a pipe that nobody reads."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)


def _event(fact: Fact, at_s: float) -> tuple[str, TimelineEvent] | None:
    """Campaign and event of a fact; None: it is about no lease."""
    match fact:
        case Leased():
            return fact.campaign, TimelineEvent(
                at_s=at_s,
                event=LEASED,
                case=fact.case,
                token=fact.token,
                worker=fact.worker,
                attempt=fact.attempt,
            )
        case Committed() | LateAttempt():
            result = fact.result
            return result.campaign, TimelineEvent(
                at_s=at_s,
                event=COMMITTED if isinstance(fact, Committed) else LATE,
                case=result.case,
                token=result.token,
                worker=fact.worker,
            )
        case AttemptEnded():
            return fact.campaign, TimelineEvent(
                at_s=at_s, event=fact.reason, case=fact.case, token=fact.token
            )
        case CaseEnded():
            return fact.campaign, TimelineEvent(at_s=at_s, event=CASE_ENDED, case=fact.case)
    return None
