"""Facts: everything that can happen to a campaign, as values.

The journal is the list of durable facts; the state is their fold. A case is named by
(campaign name, case id).
"""

from __future__ import annotations

from typing import Any, Literal

from msgspec import Struct

from schemas.campaign import Case
from schemas.messages import Release, Reply, Result


def _tag(name: str) -> str:
    """``CaseEnded`` -> ``case_ended``."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")


class _Fact(Struct, frozen=True, tag_field="fact", tag=_tag):
    """Base of all facts: frozen, told apart by the key ``fact``."""


# --- durable: journalled --------------------------------------------------------------------------


class EpochRaised(_Fact, frozen=True):
    """A conductor started on the folder; its tokens are larger than all earlier ones."""

    epoch: int


class Submitted(_Fact, frozen=True):
    """A campaign was accepted, with its cases as they were expanded at that moment."""

    campaign: dict[str, Any]
    cases: list[Case]
    digest: str
    out: str
    """Campaign folder, absolute."""
    software: str = ""
    """Software digest of the installation that submitted; information only."""


class Pinned(_Fact, frozen=True):
    """The first lease of a campaign decides which software and device class may run it."""

    campaign: str
    software: str
    device_class: str
    """Empty: any device class."""


class WorkerJoined(_Fact, frozen=True):
    """A worker incarnation said hello."""

    worker: str
    host: str
    pid: int
    device_class: str
    software: str
    slots: int
    walltime_end_s: float | None = None


class WorkerLeft(_Fact, frozen=True):
    """A worker said bye; its id never comes back."""

    worker: str
    reason: str = ""


class Leased(_Fact, frozen=True):
    """A worker got the right to run a case."""

    campaign: str
    case: str
    token: int
    attempt: int
    worker: str
    alone: bool


class Committed(_Fact, frozen=True):
    """The one result of a case."""

    result: Result
    worker: str
    device_class: str
    attempt: int


class AttemptEnded(_Fact, frozen=True):
    """A lease ended without a result; the case waits again unless a CaseEnded follows."""

    campaign: str
    case: str
    token: int
    reason: Release
    charged: bool
    alone: bool
    """The next lease of the case runs alone."""
    detail: str = ""


class CaseEnded(_Fact, frozen=True):
    """A case ended without a result."""

    campaign: str
    case: str
    outcome: Literal["unresolved", "cancelled"]
    reason: str


class LateAttempt(_Fact, frozen=True):
    """A result that came with a dead token: kept as evidence, never as an outcome."""

    result: Result
    worker: str


class Replied(_Fact, frozen=True):
    """The latest answer to a worker's ``next``; the same seq gets it again."""

    worker: str
    seq: int
    reply: Reply


# --- volatile: in memory only, rebuilt after a restart --------------------------------------------


class Seen(_Fact, frozen=True):
    """A worker spoke: its ``tokens`` live until ``until_ns``."""

    worker: str
    now_ns: int
    until_ns: int
    tokens: list[int] = []
    progress: dict[int, int] = {}
    """Token -> case ticks, where the worker said so."""


class Shortened(_Fact, frozen=True):
    """A worker's session vanished: its leases live until ``until_ns`` at most."""

    worker: str
    until_ns: int


class Draining(_Fact, frozen=True):
    """No more leases are granted by this process."""


Durable = (
    EpochRaised
    | Submitted
    | Pinned
    | WorkerJoined
    | WorkerLeft
    | Leased
    | Committed
    | AttemptEnded
    | CaseEnded
    | LateAttempt
    | Replied
)
Volatile = Seen | Shortened | Draining
Fact = Durable | Volatile


def is_durable(fact: Fact) -> bool:
    """Whether ``fact`` belongs in the journal."""
    return not isinstance(fact, Volatile)
