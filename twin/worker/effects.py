"""Effects of the worker's decisions: what its shell is to do."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.wire.control import Lease, Request


@dataclass(frozen=True, slots=True)
class Ask:
    """Send a request to the conductor; the shell answers with :meth:`Core.on_reply`."""

    request: Request


@dataclass(frozen=True, slots=True)
class StartRig:
    """Start simulator and stack for this lease's rig key."""

    lease: Lease
    slots: int
    """Cases that the rig drives at once."""


@dataclass(frozen=True, slots=True)
class StopRig:
    """End both processes of the rig."""


@dataclass(frozen=True, slots=True)
class AssignLease:
    """Hand a lease to the simulator."""

    lease: Lease


@dataclass(frozen=True, slots=True)
class AbandonToken:
    """The simulator stops working on a token."""

    token: int


@dataclass(frozen=True, slots=True)
class FailCase:
    """The simulator ends the case of a token as ``failed``: its stack cannot go on."""

    token: int
    reason: str


@dataclass(frozen=True, slots=True)
class FailUnbegun:
    """Make results of cases whose stack failed before they began; :meth:`Core.on_done` hears of
    each."""

    leases: tuple[Lease, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class KeepLogs:
    """Write what the stack printed into the logs of attempts that end without a result."""

    leases: tuple[Lease, ...]
    end: str
    """End of the attempts, in a line."""


@dataclass(frozen=True, slots=True)
class Say:
    """One line for the log."""

    line: str


@dataclass(frozen=True, slots=True)
class Leave:
    """End the worker."""

    error: str = ""
    """Why the conductor refused it; empty: it did not."""
    silent: str = ""
    """That no conductor answers any more; empty: one does, or it leaves for another reason."""


@dataclass(frozen=True, slots=True)
class SpoolWrite:
    """Keep a result that the conductor has not got yet; a later incarnation delivers it."""

    token: int
    data: bytes


@dataclass(frozen=True, slots=True)
class SpoolForget:
    """The conductor has settled this result."""

    token: int


Effect = (
    Ask
    | StartRig
    | StopRig
    | AssignLease
    | AbandonToken
    | FailCase
    | FailUnbegun
    | KeepLogs
    | Say
    | Leave
    | SpoolWrite
    | SpoolForget
)
