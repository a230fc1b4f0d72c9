"""What a conductor tells of itself: the answer to a status request, and to a few others.

A conductor of another version may leave keys out.
"""

from __future__ import annotations

from typing import TypedDict


class SearchStatus(TypedDict, total=False):
    """How far a search has come."""

    generation: int
    """Generations that have closed."""
    budget: int
    """Most cases."""
    answer: str
    """What is known, in a line; empty: nothing yet."""
    probability: int | float | None
    low: int | float | None
    """Ends of its 95 % interval."""
    high: int | float | None
    best: int | float | None
    """Worst value of the KPI so far."""
    best_case: str
    ended: str
    """Why it has ended; empty: it goes on."""
    cpus: list[str]
    """Classes of the processors that proposed."""


class CampaignStatus(TypedDict, total=False):
    """Counts of one campaign."""

    out: str
    """Its folder, as the conductor sees it."""
    digest: str
    simulator: str
    cases: int
    priority: int
    paused: bool
    waiting: int
    leased: int
    committed: int
    passed: int
    not_passed: int
    failed: int
    unresolved: int
    cancelled: int
    attempts: int
    disagreements: int
    """Late attempts of ended cases that came to another result."""
    left: int
    """Cases that have not ended."""
    p95_s: int | float | None
    """95th percentile of what a case took [s]; None: too few have ended."""
    software: str
    device_class: str
    search: SearchStatus
    """Missing: it is no search."""


def counts_of(campaign: CampaignStatus) -> dict[str, int]:
    """Whole numbers of a campaign's status by name."""
    return {k: v for k, v in campaign.items() if isinstance(v, int) and not isinstance(v, bool)}


class WorkerStatus(TypedDict, total=False):
    """One worker."""

    id: str
    host: str
    device_class: str
    slots: int
    draining: bool
    held: int
    """Number of leases held."""
    progress: int
    """Ticks of its leases together."""
    memory_bytes: int | None
    tags: list[str]
    remaining_s: int | float | None
    """Time left of its allocation, as it said last; None: without end [s]."""
    age_s: int | float
    """Time since its last word [s]."""
    present: bool


class RunningCase(TypedDict, total=False):
    """One lease; a case may have two."""

    campaign: str
    case: str
    worker: str
    host: str
    attempt: int
    tick: int
    for_s: int | float
    """Time since it was granted [s]."""
    by_hand: str
    """What somebody has done to it; empty: nothing."""


class KnownCase(TypedDict, total=False):
    """One case, whether it has ended or not; of one that has not, everything about its end is
    missing."""

    case: str
    attempts: int
    charges: list[str]
    """Why attempts were charged to it."""
    outcome: str
    """``verdict``, ``failed``, ``unresolved``, ``cancelled``; empty: not ended yet."""
    verdict: str
    reasons: list[str]
    scalars: dict[str, float | int | None]
    names: dict[str, str]
    """Scalars that are names."""
    attempt_dir: str
    """Folder of the committed attempt, relative to the campaign folder."""
    attempt: int
    """Number of the committed attempt."""
    worker: str
    """Worker that committed it."""
    wall_s: float
    rig_wall_s: float


class CasePage(TypedDict):
    """Consecutive cases of a campaign in submission order."""

    campaign: str
    next: int | None
    """Position of the case after the last one; None: there is none."""
    cases: list[KnownCase]


class ConductorStatus(TypedDict, total=False):
    """What a reply says beyond leases; which keys there are depends on the request."""

    epoch: int
    """Number of starts on this folder."""
    draining: bool
    left: int
    """Cases of all campaigns that have not ended."""
    campaigns: dict[str, CampaignStatus]
    workers: list[WorkerStatus]
    notes: list[str]
    """Why workers get nothing, a line each."""
    broken_hosts: list[str]
    """A line per host that is avoided."""
    running: list[RunningCase]
    """Cases that run, if they were asked for."""
    page: CasePage
    """Cases of a campaign, if they were asked for."""
    storage_error: str
    counters: dict[str, int | float]
    explain: list[str]
    """Sentences about why one case waits, runs or ended."""
    changed: int
    """Number of cases that were acted on."""
    campaign: str
    """Campaign that was submitted."""
    out: str
    """Its folder, as the conductor sees it."""
    cases: int
    digest: str
    resumed: bool
    """Whether the campaign was here already, and goes on."""
