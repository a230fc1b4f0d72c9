"""The table of batch systems: what submits jobs to a cluster, and how to tell which one is here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.schedulers"
"""Entry points that bring batch systems."""

OURS = {"shipped": "schemas.kinds.batch_system:KINDS"}
"""Batch systems that are shipped; the same as in pyproject.toml."""

AUTO = "auto"
"""Word in place of a name: the batch system whose commands are here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchSystemKind:
    """Declaration of a batch system."""

    name: str
    """The word for `--scheduler` and site files, e.g. ``slurm``."""
    title: str
    """The name in sentences, e.g. ``Slurm``."""
    short: str = ""
    """A shorter word for it in `--on`; empty: none."""
    implementation: str
    """``module:attribute`` of its :class:`hpc.scheduler.Scheduler`, a class without arguments."""
    submits: str = ""
    """Program that submits a job; where it is on the PATH, the batch system is here. Empty: a
    library of its own asks it, and it is used only where it is named."""
    version: tuple[str, ...] = ()
    """Command that prints its version in one line."""
    opens: str = ""
    """Command that opens an interactive allocation, for ``--help``; empty: none does."""
    constraint: str
    """What ``--constraint`` means, for ``--help``."""
    job_variable: str
    """Environment variable that holds a job's id inside the job."""
    restarts_variable: str = ""
    """Environment variable that holds how often the job was started again; empty: none does."""
    job_ids: str = r"[0-9][^/]*"
    """Pattern of its jobs' ids."""
    script: str = "job.sh"
    """Name of the file in the run folder that is submitted."""
    afterwards: tuple[tuple[str, str], ...] = (
        ("queue", "hpc status {folder}"),
        ("watch", "conductor status --state {folder} --watch"),
        ("log", "tail -F {log}"),
        ("view", "viewer live --run {folder}"),
        ("cancel", "hpc cancel {folder}"),
    )
    """What a user may do with a submitted job: a word and a command each, with the run folder and
    the log in place of ``{folder}`` and ``{log}``."""


SLURM = BatchSystemKind(
    name="slurm",
    title="Slurm",
    implementation="hpc.slurm.commands:Slurm",
    submits="sbatch",
    version=("sbatch", "--version"),
    opens="salloc",
    constraint="a feature",
    job_variable="SLURM_JOB_ID",
    restarts_variable="SLURM_RESTART_COUNT",
)
"""Slurm."""

PBS = BatchSystemKind(
    name="pbs",
    title="PBS",
    implementation="hpc.pbs.commands:Pbs",
    submits="qsub",
    version=("qsub", "--version"),
    opens="qsub -I",
    constraint="name=value",
    job_variable="PBS_JOBID",
)
"""PBS Pro and OpenPBS."""

KUBERNETES = BatchSystemKind(
    name="kubernetes",
    title="Kubernetes",
    short="k8s",
    implementation="hpc.kubernetes.commands:Kubernetes",
    constraint="label=value of nodes",
    job_variable="DRIVETWIN_JOB",
    job_ids=r"[a-z0-9-]+/[a-z0-9-]+@\S+",
    script="job.yaml",
    afterwards=(
        ("queue", "hpc status {folder}"),
        ("results", "hpc pull {folder}"),
        ("cancel", "hpc cancel {folder}"),
    ),
)
"""Kubernetes, over its API; used only where it is named: a `kubectl` says nothing about a cluster
that is meant."""

KINDS = (SLURM, PBS, KUBERNETES)
"""Batch systems in the order in which they are looked for. The first is the one that `hpc render`
writes for where nothing else is said."""


@cache
def batch_systems() -> Kinds[BatchSystemKind]:
    """All batch systems, the shipped ones first."""
    return read_kinds(GROUP, BatchSystemKind, OURS)


if TYPE_CHECKING:
    SchedulerChoice = str
else:
    SchedulerChoice = Literal[(AUTO, *batch_systems().names())]
