"""Messages of the control plane (worker - conductor): leases out, results in, and commands."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from schemas.case import CASE_VERSION, Case
from schemas.files.recording import RecordingObject
from schemas.messages import PerceptionCost
from schemas.verdict import Judged
from schemas.wire.bounds import (
    ENTRIES_MAX,
    SEALED_MAX,
    Count,
    Int64,
    Priority,
    Progress,
    Session,
    Ticks,
    Token,
    TokenText,
    Whole,
)
from schemas.wire.realtime import Realtime
from schemas.wire.status import ConductorStatus

Outcome = Literal["verdict", "failed", "unresolved", "cancelled"]
"""Terminal outcomes of a case; exactly one each."""

Release = Literal[
    "released",
    "walltime",
    "crash",
    "deadline",
    "out_of_memory",
    "suspect",
    "lost",
    "intervened",
    "refused",
]
"""Why an attempt ended without a result; ``intervened``: an intervention has changed it;
``refused``: a file that it needs is not what the campaign was submitted with."""


ATTEMPT_DIR = r"^(cases/[A-Za-z0-9_][A-Za-z0-9_.-]{0,254}/attempt-[0-9]{1,9})?\Z"
"""The one form of an attempt folder's name: nobody can commit a path that leads elsewhere."""


class Touch(Struct, frozen=True):
    """Last intervention in an attempt."""

    tick: Ticks
    what: str
    """What was done, in a few words."""
    changes: Count
    """Actions so far that cost the case its verdict; 0: it keeps it."""


class Result(Judged, Struct, frozen=True):
    """A finished attempt, ready to be committed."""

    campaign: str
    case: str
    token: Token
    outcome: Literal["verdict", "failed"]
    verdict: str
    """``pass``, ``collision``, ``false_braking``, ``lane_departure``, ``time_up``; the reason for
    ``failed``."""
    scalars: dict[str, float | Int64 | None] = {}
    reasons: list[str] = []
    names: dict[str, str] = {}
    """Scalars that are names, :data:`schemas.files.kpi.NAMES`."""
    attempt_dir: Annotated[str, Meta(pattern=ATTEMPT_DIR)] = ""
    """Attempt folder, relative to the campaign folder."""
    kpi_sha256: str = ""
    """SHA-256 of the values in its KPI file; empty: it has none."""
    manifest_sha256: str = ""
    wall_s: float = 0.0
    perception: PerceptionCost | None = None
    """Cost of perception, summed over the case; None: the stack reported none."""
    rig_wall_s: float = 0.0
    """The rig's wall time, each tick divided evenly among the cases in its slots [s]."""
    realtime: Realtime | None = None
    """How it went by the wall clock; None: in lockstep."""
    protection: str = ""
    """What kept the stack from the machine, as :mod:`twin.worker.protection` says it; empty: there
    was no stack."""


class Ended(Struct, frozen=True):
    """A lease given back without a result."""

    campaign: str
    case: str
    token: Token
    reason: Release
    detail: str = ""


class Lease(Struct, frozen=True):
    """The right to run one case, until the token is committed, released or expires."""

    token: Token
    attempt: Count
    out: str
    """Campaign folder."""
    case: Case
    alone: bool = False
    """Run it alone in a fresh rig (its last rig died)."""
    case_version: Count = CASE_VERSION
    """Which shape the case has."""

    @property
    def attempt_dir(self) -> str:
        """Folder of the attempt, below :attr:`out`."""
        return f"cases/{self.case.id}/attempt-{self.attempt}"


def noop_result(lease: Lease) -> Result:
    """What ``simulator: noop`` says of a case: a test of the scheduling, which reports refuse."""
    return Result(
        campaign=lease.case.variation.campaign,
        case=lease.case.id,
        token=lease.token,
        outcome="verdict",
        verdict="pass",
    )


class Sealed(Struct, frozen=True):
    """A result that has outlived its worker, for whoever delivers it; nobody can change it."""

    token: Token
    worker: str
    """Worker whose result it is."""
    result: bytes
    """A :class:`Result`, encoded."""
    seal: bytes
    """Seal over :attr:`result`, with the secret of that worker's session."""


class Share(Struct, frozen=True):
    """Which cases of a campaign a worker prefers, among several that work side by side.

    Campaigns are cut into as many stretches as there are workers on a device: neighbours in a
    matrix are alike, and networks like many pictures of one case each. Every stretch is dealt out
    to the devices case by case, so that all have the same to do.
    """

    stretch: Count
    stretches: Count
    device: Count
    devices: Count

    def __post_init__(self) -> None:
        if not (0 <= self.stretch < self.stretches and 0 <= self.device < self.devices):
            raise ValueError(
                f"stretch {self.stretch} of {self.stretches}, device {self.device} of "
                f"{self.devices}: both count from 0"
            )


class Hello(Struct, frozen=True, tag_field="verb", tag="hello"):
    """A worker introduces itself: one incarnation, never reused."""

    v: int
    worker: str
    host: str
    pid: Count
    device_class: str
    software: str
    """Software digest."""
    slots: Count
    walltime_end_s: float | None = None
    """When the worker's allocation ends [s since 1970]; information only."""
    memory_bytes: Whole | None = None
    """Most memory that its rig may use [bytes]; None: no limit."""
    tags: list[str] = []
    """What campaigns may ask for, see :class:`schemas.campaign.Requirements`."""
    share: Share | None = None
    """Share of the cases that it prefers; None: it prefers none."""
    lacks: dict[str, str] = {}
    """Bridges that cannot run there, the word ``sandbox`` if stacks have none there, ``recorder``
    if nothing is recorded there, ``perception NAME`` for a kind that cannot run there, and
    ``plug-in NAME`` for one that cannot be used there, each with why or what to do, in a line."""
    session: Session = b""
    """Secret of 32 bytes that this process alone knows; every later request shows it again."""
    case_version: Count = CASE_VERSION
    """Which shape of cases it reads."""
    plugins: dict[str, str] = {}
    """Other distributions that bring kinds and are installed there, by name, with versions."""


class Next(Struct, frozen=True, tag_field="verb", tag="next"):
    """Commit what is finished and ask for up to ``k`` cases, in one round trip."""

    v: int
    worker: str
    seq: Whole
    k: Count
    rig: str = ""
    """Rig key of the running rig; its cases are preferred."""
    results: Annotated[list[Result], Meta(max_length=ENTRIES_MAX)] = []
    ended: Annotated[list[Ended], Meta(max_length=ENTRIES_MAX)] = []
    held: Annotated[list[Token], Meta(max_length=ENTRIES_MAX)] = []
    """Tokens that the worker holds; a lease of this worker that is not listed was lost on the
    way."""
    remaining_s: float | None = None
    """Walltime left for cases [s]; None: no end is known."""
    session: Session = b""
    sealed: Annotated[list[Sealed], Meta(max_length=SEALED_MAX)] = []
    """Results of earlier workers, which the conductor has not got."""


class Beat(Struct, frozen=True, tag_field="verb", tag="beat"):
    """Heartbeat: tokens held and the progress counter of each."""

    v: int
    worker: str
    held: Annotated[dict[TokenText, Progress], Meta(max_length=ENTRIES_MAX)]
    """Token (decimal) -> progress (case ticks)."""
    touched: Annotated[dict[TokenText, Touch], Meta(max_length=ENTRIES_MAX)] = {}
    """Token (decimal) -> last intervention in it since the last beat that was answered."""
    session: Session = b""


class Bye(Struct, frozen=True, tag_field="verb", tag="bye"):
    """The worker leaves; every lease it holds is given back."""

    v: int
    worker: str
    detail: str = ""
    session: Session = b""


class Recorded(Struct, frozen=True, tag_field="verb", tag="recorded"):
    """The recording of an attempt that this worker has committed lies in the result store."""

    v: int
    worker: str
    campaign: str
    case: str
    token: Token
    recording: RecordingObject
    session: Session = b""


class Submit(Struct, frozen=True, tag_field="verb", tag="submit"):
    """Submit a campaign; the same campaign again is a resume."""

    v: int
    campaign: dict[str, Any]
    """The campaign file's content."""
    software: str = ""
    out: str = ""
    """Campaign folder, absolute; empty: a folder of the campaign's name in the state folder."""
    priority: Priority = 0
    """Campaigns of a higher one are served first; equals share the workers."""


class Control(Struct, frozen=True, tag_field="verb", tag="control"):
    """Act on a campaign, one case of it (``case`` not empty), or a worker (``drain``)."""

    v: int
    action: Literal["pause", "resume", "cancel", "retry", "drain"]
    campaign: str = ""
    case: str = ""
    worker: str = ""


class Explain(Struct, frozen=True, tag_field="verb", tag="explain"):
    """Ask why a case waits, runs or ended; the answer is ``Reply.status["explain"]``, a list."""

    v: int
    campaign: str
    case: str


class StatusRequest(Struct, frozen=True, tag_field="verb", tag="status", omit_defaults=True):
    """Ask for the conductor's state."""

    v: int
    running: bool = False
    """Also for the cases that run now, which may be thousands."""
    cases: str = ""
    """Also for a page of the cases of this campaign; empty: of none."""
    first: Count = 0
    """Position of the page's first case in the campaign."""


class Stop(Struct, frozen=True, tag_field="verb", tag="stop"):
    """Ask the conductor to stop serving; workers are told to drain."""

    v: int


Request = Hello | Next | Beat | Bye | Recorded | Submit | Control | Explain | StatusRequest | Stop


class Reply(Struct, frozen=True):
    """Answer to any request; ``error`` not empty: refused, with the reason."""

    v: int
    epoch: Count
    error: str = ""
    ttl_s: float = 0.0
    seq: Whole = 0
    acks: list[Token] = []
    """Tokens whose result is settled (committed, already committed, or fenced)."""
    fenced: list[Token] = []
    leases: list[Lease] = []
    left: Count = 0
    """Cases not yet ended."""
    drain: bool = False
    retry_after_s: float = 0.0
    lost: list[Token] = []
    """Tokens that are no longer valid: stop working on them."""
    status: ConductorStatus = {}
    store: str = ""
    """To a hello: result store that results are put into before they are committed; empty: none."""
