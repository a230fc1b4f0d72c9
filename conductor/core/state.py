"""What the conductor knows: the fold of its facts, plus clocks that a restart may forget.

Fields declared ``_volatile()`` are not facts: they hold readings of this process's clock, are left
out of comparisons and are set anew after a restart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
from msgspec import Struct

from conductor.core.backlog import Backlog
from conductor.core.durations import CaseLengths, Durations
from conductor.core.facts import (
    ALONE,
    SHARED,
    CaseEnded,
    Charge,
    Committed,
    LateAttempt,
    Replied,
    SteeredAttempt,
    Submitted,
    WorkerJoined,
)
from conductor.core.searching.record import SearchRecord
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.files.recording import RecordingObject
from schemas.sections.view_mode import ViewMode

IMAGE_CASES = 1000
"""Cases in one image of a snapshot."""
FAR_NS = 2**62
"""A time that never comes [ns]."""

CaseKey = tuple[str, str]
"""(campaign name, case id)."""


_seal = msgspec.msgpack.Encoder().encode
unsealed = msgspec.msgpack.Decoder(Committed | CaseEnded).decode


def _volatile(default: Any) -> Any:
    return field(default=default, compare=False)


PROTECTED_ONLY = "this conductor runs stacks in sandboxes alone, see --allow-unprotected"
"""Why campaigns and workers without one are refused."""


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
    spread: bool = False
    """A worker that holds none and has no share gets cases from all over what waits instead of
    neighbours; not with ``by_batch``."""
    longest_first: bool = True
    """Cases that are expected to be longest begin first; not with ``by_batch``."""
    lengths_s: Mapping[str, float] = field(default_factory=dict)
    """Length of cases in an earlier run, by name [s of simulated time]."""
    protected: bool = False
    """Stacks run in sandboxes only; workers and campaigns without are refused."""
    view: ViewMode | None = None
    """View in place of what submitted campaigns say."""
    walltime_margin_s: float = 10.0
    """A case is granted if its estimate and this fit into the asker's walltime [s]."""
    host_deaths: int = 3
    """Number of different cases that die on a host, none committed in between, after which it is
    avoided."""
    forget_ns: int = 3600 * 1_000_000_000
    """A worker without leases that was silent for so long is forgotten [ns]."""
    losses_min: int = 3
    """Fewest workers that a case must take down before it is quarantined."""
    speculate: bool = True
    """Idle workers get a second lease of cases that take too long."""
    speculate_factor: float = 2.0
    """A case takes too long after this many times the estimate."""
    speculate_min_ns: int = 5_000_000_000
    """Second leases are never granted before this [ns]."""
    snapshot_facts: int = 50_000
    """A snapshot is taken after this many facts, so that a restart reads no more of them."""
    snapshot_close_facts: int = 2000
    """Fewest facts that are worth a snapshot at a clean end."""
    cpu: str = ""
    """Class of the processor that it runs on, which searches note."""
    store: str = ""
    """URL of the result store; empty: there is none."""
    folder: str = ""
    """State folder, absolute; a campaign without ``out`` gets a folder below it."""


class Issued(Struct, frozen=True, array_like=True, gc=False):
    """A token, with what a result of it must fit."""

    token: int
    attempt: int
    session: bytes
    """Hash of the session of the worker that got it; empty: a result of it fits nobody."""


@dataclass(slots=True)
class LiveLease:
    """A lease that is neither committed, given back nor expired."""

    token: int
    key: CaseKey
    worker: str
    attempt: int
    group: int
    """Group of the case as it was leased."""
    speculative: bool = False
    touched: str = ""
    """Last intervention in it, and when; empty: none."""
    granted_ns: int = _volatile(0)
    """When it was granted, or when this process learned of it [ns]."""
    expiry_ns: int = _volatile(0)
    progress: int = _volatile(0)
    """Case ticks, as the worker last reported."""

    @property
    def alone(self) -> bool:
        """Whether it runs alone in its rig."""
        return self.group == ALONE


def end_name(end: Committed | CaseEnded) -> str:
    """Under which name an ended case is counted."""
    if isinstance(end, CaseEnded):
        return end.outcome
    if end.result.outcome == "failed":
        return "failed"
    return "passed" if end.result.passed else "not_passed"


@dataclass(slots=True)
class CaseState:
    """One case. It waits while it has neither a live token nor an end, and is not paused.

    Tuples, because there may be a hundred thousand and nearly all of these are empty.
    """

    case: Case
    order: int
    """Position in its campaign."""
    rig: str
    """Rig key: cases with equal keys may share a rig."""
    group: int = SHARED
    """Group with which its next lease may share a rig; see :mod:`conductor.core.facts`."""
    paused: bool = False
    attempts: int = 0
    """Number of tokens ever granted."""
    issued: tuple[Issued, ...] = ()
    """The latest of them, for each of which one late result is evidence."""
    live: tuple[int, ...] = ()
    """Live tokens, which are all issued; the second one is speculative."""
    charges: tuple[Charge, ...] = ()
    """Attempts charged to the case."""
    losses: tuple[Charge, ...] = ()
    """Workers that died with it while all others lived."""
    lost_times: int = 0
    """Number of times that a worker fell silent with it, whatever the reason."""
    lost: tuple[str, ...] = ()
    """The latest workers that did."""
    sealed: bytes = b""
    """The fact that ended it, packed: unpacked they are most of the conductor's memory."""
    late: tuple[LateAttempt, ...] = ()
    steered: tuple[SteeredAttempt, ...] = ()
    recording: RecordingObject | None = None
    """Recording of its committed attempt in the result store; None: there is none, or not yet."""

    @property
    def alone(self) -> bool:
        """Whether its next lease runs alone."""
        return self.group == ALONE

    @property
    def ended(self) -> bool:
        """Whether the case has an outcome."""
        return bool(self.sealed)

    @property
    def end(self) -> Committed | CaseEnded | None:
        """The fact that ended it; ask :attr:`ended` where speed matters."""
        return unsealed(self.sealed) if self.sealed else None

    @end.setter
    def end(self, fact: Committed | CaseEnded | None) -> None:
        self.sealed = _seal(fact) if fact is not None else b""

    @property
    def waits(self) -> bool:
        """Whether the case stands in the backlog."""
        return not self.sealed and not self.live and not self.paused


@dataclass(slots=True)
class CampaignState:
    """One campaign and its cases in submission order."""

    campaign: Campaign
    digest: str
    digests: int
    """Version of ``digest``, see :data:`schemas.identity.DIGESTS`."""
    out: str
    cases: dict[str, CaseState]
    ordered: list[CaseState] = field(compare=False)
    """The same cases by position."""
    backlog: Backlog
    open_batches: dict[int, int]
    """Batch label -> cases not yet ended; ended batches are removed."""
    order: int
    """Position among the campaigns."""
    priority: int = 0
    paused: bool = False
    durations: Durations = field(default_factory=Durations)
    """Durations of the committed cases."""
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
    left: int = 0
    """Cases without an outcome."""

    search: SearchRecord | None = None
    """How far its search has come; None: it is none."""
    grown: bool = field(default=False, compare=False, repr=False)
    """Whether generations came since the latest snapshot."""
    imaged: int = field(default=0, compare=False, repr=False)
    """Cases up to which those of later generations are in images of their own."""
    submitted: Submitted | None = field(default=None, compare=False, repr=False)
    """The fact that brought it, until a snapshot has it."""
    lengths: CaseLengths = field(default_factory=CaseLengths, compare=False, repr=False)
    """How long its cases are expected to be."""
    _lowest: int = _volatile(0)

    def lowest_batch(self) -> int:
        """Label of the first batch with a case that has not ended."""
        if self._lowest not in self.open_batches:
            self._lowest = min(self.open_batches, default=0)
        return self._lowest

    def extend(self, cases: list[Case], keys: list[str]) -> None:
        """Add cases that wait, behind all others. ``keys``: rig keys."""
        lanes: dict[str, list[int]] = {}
        for case, rig in zip(cases, keys, strict=True):
            case_state = CaseState(case=case, order=len(self.ordered), rig=rig)
            lanes.setdefault(rig, []).append(case_state.order)
            self.ordered.append(case_state)
            self.cases[case.id] = case_state
            self.reopen(case.variation.batch)
        for rig, orders in lanes.items():
            self.backlog.extend(rig, orders, SHARED)
        self.left += len(cases)

    def reopen(self, batch: int) -> None:
        """A case of ``batch`` has no outcome any more."""
        self.open_batches[batch] = self.open_batches.get(batch, 0) + 1
        self._lowest = -1

    @property
    def waiting(self) -> int:
        """Cases with neither a live token nor an outcome, paused ones included."""
        return self.left - self.leased


@dataclass(slots=True)
class WorkerState:
    """A worker that joined and has not left."""

    joined: WorkerJoined
    tokens: dict[int, None] = field(default_factory=dict)
    """Live tokens in the order they were granted."""
    replied: Replied | None = None
    draining: bool = False
    """Whether it was asked to finish."""
    refused: dict[str, str] = field(default_factory=dict)
    """Campaign -> why its rigs cannot be built there: a file is not what was submitted."""
    seen_ns: int = _volatile(0)
    remaining_s: float | None = _volatile(None)
    """Walltime left, as it last said [s]."""
    vanished: bool = _volatile(False)
    """Whether its session is gone, and it was not heard of since."""


@dataclass(slots=True)
class State:
    """State of the conductor; changed only by :func:`conductor.core.fold.apply`."""

    config: Config = field(default_factory=Config, compare=False)
    epoch: int = 0
    folder: str = ""
    """State folder, as of the latest start; empty: the journal does not say."""
    granted: int = 0
    """Leases of this epoch; the low half of the last token."""
    groups: int = 0
    """The latest group of suspects."""
    left: int = 0
    """Cases without an outcome, over all campaigns."""
    campaigns: dict[str, CampaignState] = field(default_factory=dict)
    searches: dict[str, None] = field(default_factory=dict)
    """Campaigns that are searches and have not ended."""
    workers: dict[str, WorkerState] = field(default_factory=dict)
    departed: dict[str, None] = field(default_factory=dict)
    """Ids of workers that left, the latest last; an id is one incarnation, never two."""
    leases: dict[int, LiveLease] = field(default_factory=dict)
    deaths: dict[str, tuple[CaseKey, ...]] = field(default_factory=dict)
    """Host -> different cases that were charged on it since it committed one."""
    draining: bool = _volatile(False)
    looked_ns: int = _volatile(0)
    """When silent workers were last looked for [ns]."""
    tail: int = _volatile(0)
    """Facts since the latest snapshot."""
    applied: int = _volatile(0)
    """Facts that this process has begun to apply."""
    dirty: set[tuple[str, int]] = field(default_factory=set, compare=False, repr=False)
    """(campaign, position / IMAGE_CASES) of cases that changed since the latest snapshot."""
    expiry_floor_ns: int = _volatile(FAR_NS)
    """No live lease expires before this; spares scanning them at every turn [ns]."""

    def case(self, key: CaseKey) -> CaseState | None:
        """The case named by ``key``, or None."""
        campaign = self.campaigns.get(key[0])
        return campaign.cases.get(key[1]) if campaign else None
