"""What the conductor knows: the fold of its facts, plus clocks that a restart may forget.

Fields declared ``_volatile()`` are not facts: they hold readings of this process's clock, are left
out of comparisons and are set anew after a restart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from conductor.backlog import Backlog
from conductor.facts import CaseEnded, Committed, LateAttempt, Replied, WorkerJoined
from schemas.campaign import Campaign, Case

FAR_NS = 2**62
"""A time that never comes [ns]."""

CaseKey = tuple[str, str]
"""(campaign name, case id)."""


def _volatile(default: Any) -> Any:
    return field(default=default, compare=False)


@dataclass(frozen=True, slots=True)
class Config:
    """Limits and options of one conductor process."""

    ttl_ns: int = 15_000_000_000
    """A lease lives this long after its worker last spoke of it [ns]."""
    vanished_ns: int = 3_000_000_000
    """Leases of a worker whose session vanished live at most this much longer [ns]."""
    leases_max: int = 256
    """Most leases in one reply."""
    retry_busy_s: float = 0.5
    """A worker that got nothing asks again after this, while cases are left [s]."""
    retry_idle_s: float = 2.0
    """The same with no cases left [s]."""
    by_batch: bool = False
    """Grant only cases of a campaign's lowest batch that has not ended."""
    folder: str = ""
    """State folder, absolute; a campaign without ``out`` gets a folder below it."""


@dataclass(slots=True)
class LiveLease:
    """A lease that is neither committed, given back nor expired."""

    token: int
    key: CaseKey
    worker: str
    attempt: int
    alone: bool
    expiry_ns: int = _volatile(0)
    progress: int = _volatile(0)
    """Case ticks, as the worker last reported."""


@dataclass(slots=True)
class CaseState:
    """One case. It waits while it has neither a live token nor an end."""

    case: Case
    order: int
    """Position in its campaign."""
    rig: str
    """Rig key: cases with equal keys may share a rig."""
    alone: bool = False
    """Its next lease runs alone."""
    issued: list[int] = field(default_factory=list)
    """Every token ever granted; its length is the number of attempts."""
    live: list[int] = field(default_factory=list)
    """Live tokens."""
    charges: list[str] = field(default_factory=list)
    """Reasons of the attempts charged to the case."""
    end: Committed | CaseEnded | None = None
    late: list[LateAttempt] = field(default_factory=list)


@dataclass(slots=True)
class CampaignState:
    """One campaign and its cases in submission order."""

    campaign: Campaign
    digest: str
    out: str
    cases: dict[str, CaseState]
    ordered: list[CaseState] = field(compare=False)
    """The same cases by position."""
    backlog: Backlog
    open_batches: dict[int, int]
    """Batch label -> cases not yet ended; ended batches are removed."""
    pinned: bool = False
    """A lease was granted: software and device class are decided."""
    software: str = ""
    """Pinned software digest."""
    device_class: str = ""
    """Pinned device class; empty: any."""
    ended: dict[str, int] = field(default_factory=dict)
    """Outcome -> cases; verdicts are counted as ``passed`` and ``not_passed``."""
    leased: int = 0
    """Cases with a live token."""
    attempts: int = 0
    disagreements: int = 0
    """Late attempts whose result differs from the committed one: determinism is broken."""

    @property
    def ended_count(self) -> int:
        """Cases with an outcome."""
        return sum(self.ended.values())

    @property
    def left(self) -> int:
        """Cases without an outcome."""
        return len(self.cases) - self.ended_count


@dataclass(slots=True)
class WorkerState:
    """A worker that joined and has not left."""

    joined: WorkerJoined
    tokens: dict[int, None] = field(default_factory=dict)
    """Live tokens in the order they were granted."""
    replied: Replied | None = None
    seen_ns: int = _volatile(0)


@dataclass(slots=True)
class State:
    """Everything; changed only by :func:`conductor.fold.apply`."""

    config: Config = field(default_factory=Config, compare=False)
    epoch: int = 0
    granted: int = 0
    """Leases of this epoch; the low half of the last token."""
    campaigns: dict[str, CampaignState] = field(default_factory=dict)
    workers: dict[str, WorkerState] = field(default_factory=dict)
    departed: set[str] = field(default_factory=set)
    """Ids of workers that left; an id is one incarnation and never comes back."""
    leases: dict[int, LiveLease] = field(default_factory=dict)
    draining: bool = _volatile(False)
    expiry_floor_ns: int = _volatile(FAR_NS)
    """No live lease expires before this; spares scanning them at every turn [ns]."""

    @property
    def left(self) -> int:
        """Cases without an outcome, over all campaigns."""
        return sum(campaign.left for campaign in self.campaigns.values())

    def case(self, key: CaseKey) -> CaseState | None:
        """The case named by ``key``, or None."""
        campaign = self.campaigns.get(key[0])
        return campaign.cases.get(key[1]) if campaign else None
