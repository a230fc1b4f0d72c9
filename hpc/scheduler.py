"""What is asked of a batch system, whichever it is. :mod:`hpc.backends` says which it is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from hpc.commands import UnknownOutcomeError
from hpc.request import JobRequest
from schemas.escape import escape
from schemas.kinds.batch_system import batch_systems

WORDS_CHARS_MAX = 300
"""Longest text of a batch system that is told [characters]."""
PARTITIONS_MAX = 1000
"""Most partitions that are told."""
JOB_ID_CHARS_MAX = 400
"""Longest id of a job [characters]."""

State = Literal["pending", "running", "ended", "gone", "unknown"]


@dataclass(frozen=True, slots=True)
class JobStatus:
    """A job as the scheduler sees it."""

    state: State
    """``gone``: the scheduler says that it knows of no such job; it ended long ago, or never was.
    ``unknown``: its answer says nothing of the job, which may be there."""
    native: str = ""
    """The scheduler's own word, e.g. ``PENDING`` or ``Q``."""
    reason: str = ""
    """Why the job waits."""
    nodes: str = ""
    exit_code: int | None = None
    restarts: int = 0

    def __post_init__(self) -> None:
        _escape_words(self, "native", "reason", "nodes")


@dataclass(frozen=True, slots=True)
class Partition:
    """A partition or queue."""

    name: str
    limit: str = ""
    """Longest time of a job, in the scheduler's words."""
    nodes: str = ""
    gpus: str = ""
    """Generic resources, in the scheduler's words."""
    state: str = ""

    def __post_init__(self) -> None:
        _escape_words(self, "name", "limit", "nodes", "gpus", "state")


@dataclass(frozen=True, slots=True)
class Partitions:
    """What a batch system offers on this host."""

    partitions: tuple[Partition, ...] = ()
    trouble: str = ""
    """Why its controller cannot be used; empty: it can."""


def job_id(system: str, said: str) -> str:
    """What a batch system's program has answered to a submission, if it is a job's id.

    Raises:
        UnknownOutcomeError: it is none, so nobody knows whether the job was taken.
    """
    kind = batch_systems().find(system)
    if len(said) <= JOB_ID_CHARS_MAX and said.isprintable() and re.fullmatch(kind.job_ids, said):
        return said
    raise UnknownOutcomeError(
        f"{kind.title} answered {escape(said, 80)!r} in place of a job's id; see its queue whether "
        "the job is there before you submit again"
    )


def _escape_words(found: object, *names: str) -> None:
    """Whoever may name nodes and jobs of a cluster writes on no terminal of ours."""
    for name in names:
        object.__setattr__(found, name, escape(getattr(found, name), WORDS_CHARS_MAX))


class Scheduler(Protocol):
    """A batch system. Refusals are UsageError, a batch system in trouble is InfrastructureError."""

    name: str
    """Name of its declaration, a :class:`schemas.kinds.batch_system.BatchSystemKind`."""

    def render(self, request: JobRequest) -> str:
        """The job script."""

    def render_array(self, request: JobRequest, cases: Sequence[str], /) -> str:
        """A job array over ``cases``, for comparison."""

    def check(self, text: str, request: JobRequest, /) -> None:
        """Raise unless the script would be accepted; nothing is submitted."""

    def submit(self, path: Path, folder: Path) -> str:
        """Submit the script; its log will be in ``folder``. Returns the job's id."""

    def status(self, job: str) -> JobStatus:
        """What has become of a job."""

    def cancel(self, job: str) -> None:
        """End a job for good."""

    def requeue(self, job: str) -> None:
        """Let a running job stop cleanly and queue itself again."""

    def signal(self, job: str, name: str) -> None:
        """Send the job script a signal, e.g. ``TERM``."""

    def interactive(self, request: JobRequest, command: list[str]) -> list[str]:
        """The command line that opens an allocation and runs ``command`` on its first node."""

    def log(self, job: str, request: JobRequest, /) -> str:
        """Name of the job's log in its folder."""

    def partitions(self, wait_s: float) -> Partitions:
        """What may be asked for here; ``wait_s``: longest wait for a program [s]."""


@runtime_checkable
class FolderScheduler(Protocol):
    """A batch system that takes more than one file."""

    def files(self, request: JobRequest) -> Mapping[str, str]:
        """Texts by file name: what ``hpc render --into FOLDER`` writes."""


@runtime_checkable
class ChartScheduler(Protocol):
    """A batch system for which Helm installs things."""

    def chart(self, request: JobRequest) -> Mapping[str, str]:
        """Texts by file name: what ``hpc render --helm FOLDER`` writes."""


@runtime_checkable
class RemoteScheduler(Protocol):
    """A batch system whose jobs do not see the run folder of this machine."""

    def pull(self, job: str, target: Path) -> None:
        """Copy the results of a job into ``target``; called again, what is newer there."""
