"""What is asked of a batch system, whichever it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from hpc.commands import exists
from hpc.request import JobRequest
from twin.base.errors import InfrastructureError

State = Literal["pending", "running", "ended", "unknown"]
Kind = Literal["slurm", "pbs"]


@dataclass(frozen=True, slots=True)
class JobStatus:
    """A job as the scheduler sees it."""

    state: State
    """``unknown``: the scheduler does not remember it; it ended long ago, or never was."""
    native: str = ""
    """The scheduler's own word, e.g. ``PENDING`` or ``Q``."""
    reason: str = ""
    """Why it waits."""
    nodes: str = ""
    exit_code: int | None = None
    restarts: int = 0


class Scheduler(Protocol):
    """A batch system. Refusals are UsageError, a batch system in trouble is InfrastructureError."""

    kind: Kind

    def render(self, request: JobRequest) -> str:
        """The job script."""

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


def scheduler(kind: Literal["auto", "slurm", "pbs"]) -> Scheduler:
    """The backend for a batch system; ``auto`` looks which commands are there.

    Raises:
        InfrastructureError: they are not.
    """
    from hpc.pbs.commands import Pbs
    from hpc.slurm.commands import Slurm

    if kind in ("auto", "slurm") and exists("sbatch"):
        return Slurm()
    if kind in ("auto", "pbs") and exists("qsub"):
        return Pbs()
    wanted = {"auto": "neither sbatch nor qsub", "slurm": "no sbatch", "pbs": "no qsub"}[kind]
    raise InfrastructureError(
        f"{wanted} on this host, so nothing can be submitted from here; log in to a login node of "
        "the cluster, or write the script with `hpc render` and submit it there"
    )
