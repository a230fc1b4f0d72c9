"""Facts: everything that can happen to a campaign, as values.

The journal is the list of durable facts; the state is their fold. A case is named by
(campaign name, case id).
"""

from __future__ import annotations

from typing import Any, Literal, get_args

from msgspec import Struct

from conductor.core.case_table import CaseTable
from conductor.core.searching.record import SearchRecord
from schemas.files.recording import RecordingObject
from schemas.files.search_result import ChainEstimate, SearchAnswer
from schemas.sections.fork import Branch
from schemas.wire.control import Release, Reply, Result, Share

SHARED = 0
"""Group of a case that may share a rig with any other."""
ALONE = -1
"""Group of a case that runs alone; groups from 1 are suspects that share a rig with nobody else."""


def _tag(name: str) -> str:
    """``CaseEnded`` -> ``case_ended``."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")


class _Fact(Struct, frozen=True, tag_field="fact", tag=_tag):
    """Base of all facts: frozen, told apart by the key ``fact``."""


# --- durable: journalled --------------------------------------------------------------------------


class EpochRaised(_Fact, frozen=True):
    """A conductor started on the folder; its tokens are larger than all earlier ones."""

    epoch: int
    folder: str = ""
    """State folder, absolute; journals of earlier versions do not say."""
    before: str = ""
    """Folder where it lay until then, if it was copied or moved: campaigns in it came along."""


class Submitted(_Fact, frozen=True):
    """A campaign was accepted, with its cases as they were expanded at that moment."""

    campaign: dict[str, Any]
    cases: CaseTable
    digest: str
    out: str
    """Campaign folder, absolute."""
    software: str = ""
    """Software digest of the installation that submitted; information only."""
    priority: int = 0
    """Campaigns of a higher one are served first."""
    digests: int = 0
    """Version of ``digest``, see :data:`schemas.identity.DIGESTS`."""
    search: SearchRecord | None = None
    """In a snapshot: how far its search has come."""


class Generation(_Fact, frozen=True):
    """The oldest open generation of a search has closed, and the next of its chain was proposed; or
    the chain, or the search, has ended."""

    campaign: str
    number: int
    """Generations that were proposed before; those that came with the campaign are the first."""
    results: list[float | None]
    """KPI of the cases that have closed, in the order in which they were proposed."""
    digest: str
    """Digest of the campaign with the new cases."""
    answer: SearchAnswer | None = None
    estimate: ChainEstimate = ChainEstimate()
    """What its chain knows, where chains have a mean."""
    ended: str = ""
    """Why the search proposes nothing more since this generation has closed; empty: it does, or it
    was said before."""
    u: bytes = b""
    """Standard normal coordinates of the new cases: float64, little-endian, cases by parameters."""
    values: str = ""
    """Values of their parameters, JSON of the same shape."""
    forks: list[Branch | None] = []
    """What the new cases are forks of; empty: of nothing."""
    cases: CaseTable | None = None
    """The new cases; None: there are none."""
    versions: dict[str, str] = {}
    """Libraries that proposed."""
    cpu: str = ""
    """Class of the processor."""


class Relocated(_Fact, frozen=True):
    """A campaign was submitted again whose files, of the same content, lie elsewhere now."""

    campaign: str
    paths: dict[str, str]
    """Path of a file, as it was -> as it is."""


class Pinned(_Fact, frozen=True):
    """The first lease of a campaign decides which software and device class may run it."""

    campaign: str
    software: str
    device_class: str
    """Pinned device class; empty: any."""


class WorkerJoined(_Fact, frozen=True):
    """A worker incarnation said hello."""

    worker: str
    host: str
    pid: int
    device_class: str
    software: str
    slots: int
    walltime_end_s: float | None = None
    memory_bytes: int | None = None
    tags: list[str] = []
    share: Share | None = None
    lacks: dict[str, str] = {}
    session: bytes = b""
    """Hash of its session's secret; empty in journals of earlier versions: nobody can prove it."""
    signer: bytes = b""
    """Public key of its seals."""
    plugins: dict[str, str] = {}


class WorkerLeft(_Fact, frozen=True):
    """A worker said bye; its id never comes back."""

    worker: str
    reason: str = ""
    forgotten: bool = False
    """Whether it was silent for too long; should it come back, it may join again."""


class WorkerDraining(_Fact, frozen=True):
    """A worker was asked to finish; it gets no more leases."""

    worker: str


class Leased(_Fact, frozen=True):
    """A worker got the right to run a case."""

    campaign: str
    case: str
    token: int
    attempt: int
    worker: str
    alone: bool
    speculative: bool = False
    """The case runs already, on a worker that takes too long: who is first commits."""


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
    group: int = SHARED
    """Group with which the case may share its next rig (``SHARED`` in journals of version 1)."""
    evidence: bool = False
    """Whether its worker died while all others lived: the case may be why."""


class Intervention(_Fact, frozen=True):
    """Somebody has intervened in a running attempt."""

    campaign: str
    case: str
    token: int
    tick: int
    """Control tick of the case at which it was applied."""
    what: str
    """What was done, in a few words."""
    changes: int
    """Number of changes so far; if any, the attempt gives the case no verdict."""


class Charge(Struct, frozen=True):
    """Evidence against a case: one attempt that ended badly."""

    worker: str
    reason: str
    detail: str = ""

    def __str__(self) -> str:
        text = f"{self.reason}: {self.detail}" if self.detail else self.reason
        return f"{text} (worker {self.worker})"


class SteeredAttempt(Struct, frozen=True):
    """An attempt that gave no verdict, because an intervention has changed it."""

    attempt: int
    detail: str

    def __str__(self) -> str:
        return f"attempt {self.attempt}: {self.detail}"


class CaseEnded(_Fact, frozen=True):
    """A case ended without a result; what still runs of it is in vain."""

    campaign: str
    case: str
    outcome: Literal["unresolved", "cancelled"]
    reason: str
    evidence: list[Charge] = []
    """Why a quarantined case is in quarantine."""


class Paused(_Fact, frozen=True):
    """A campaign or one case of it is granted no more leases, or is granted them again."""

    campaign: str
    case: str
    """Id of the case; empty: the campaign."""
    paused: bool


class Retried(_Fact, frozen=True):
    """A case that ended without a result waits again, and nothing is held against it."""

    campaign: str
    case: str


class LateAttempt(_Fact, frozen=True):
    """A result that came with a dead token: kept as evidence, never as an outcome."""

    result: Result
    worker: str


class RecordingStored(_Fact, frozen=True):
    """The recording of the committed attempt of a case lies in the result store."""

    campaign: str
    case: str
    token: int
    recording: RecordingObject


class Granted(Struct, frozen=True, array_like=True):
    """A lease as it stands in a stored reply: the case itself is in the state."""

    campaign: str
    case: str
    token: int
    attempt: int
    alone: bool


class Replied(_Fact, frozen=True):
    """The latest answer to a worker's ``next``; the same seq gets it again."""

    worker: str
    seq: int
    reply: Reply
    """Reply without leases (journals of version 1: with them)."""
    granted: list[Granted] = []


class Image(Struct, frozen=True, array_like=True):
    """A part of the state, packed; a later one of the same key replaces it."""

    key: str
    data: bytes


class Snapshot(_Fact, frozen=True):
    """Stands for every fact before it; see :mod:`conductor.core.snapshot`."""

    images: list[Image]
    """Images that changed since the snapshot before; what is read from the journal has all."""


# --- volatile: in memory only, rebuilt after a restart --------------------------------------------


class Seen(_Fact, frozen=True):
    """A worker spoke: its ``tokens`` live until ``until_ns``."""

    worker: str
    now_ns: int
    until_ns: int
    tokens: list[int] = []
    progress: dict[int, int] = {}
    """Token -> case ticks, where the worker said so."""
    remaining_s: float | None = None
    """Walltime left, where the worker said so [s]."""


class Shortened(_Fact, frozen=True):
    """A worker's session vanished: its leases live until ``until_ns`` at most."""

    worker: str
    until_ns: int


class Draining(_Fact, frozen=True):
    """No more leases are granted by this process."""


Durable = (
    EpochRaised
    | Submitted
    | Generation
    | Relocated
    | Pinned
    | WorkerJoined
    | WorkerLeft
    | WorkerDraining
    | Leased
    | Committed
    | AttemptEnded
    | Intervention
    | CaseEnded
    | Paused
    | Retried
    | LateAttempt
    | RecordingStored
    | Replied
    | Snapshot
)
Volatile = Seen | Shortened | Draining
Fact = Durable | Volatile

_VOLATILE = frozenset(get_args(Volatile))


def is_durable(fact: Fact) -> bool:
    """Whether ``fact`` belongs in the journal."""
    return type(fact) not in _VOLATILE
