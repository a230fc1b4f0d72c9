"""Brings a run folder from the cluster to this machine."""

from __future__ import annotations

from pathlib import Path

from hpc.backends import backend
from hpc.commands import exists, watch
from hpc.scheduler import RemoteScheduler
from hpc.submit import job_of
from twin.base.errors import InfrastructureError, UsageError

LEFT_THERE = (".*.tmp", "spool", "rigs", "conductor.json", "conductor.owner", "/keys")
"""What only means something beside its conductor; private keys above all stay where they are."""


def pull_command(source: str, folder: Path, *, rsync: bool) -> list[str]:
    """The program that copies ``HOST:RUN`` (or a local path) into ``folder``."""
    trimmed = source.rstrip("/")
    if rsync:
        excluded = [f"--exclude={pattern}" for pattern in LEFT_THERE]
        # Symbolic links and times stay; what is half there is continued.
        return ["rsync", "-a", "--partial", *excluded, "--", f"{trimmed}/", f"{folder}/"]
    return ["scp", "-r", "-p", "-q", "--", f"{trimmed}/.", str(folder)]


def pull(source: str, folder: Path | None) -> Path:
    """Copy a run folder; called again, it goes on where it was cut off (with rsync).

    Raises:
        UsageError: no such run.
        InfrastructureError: no program to copy with, or it failed.
    """
    name = source.rstrip("/").replace(":", "/").rpartition("/")[2]
    if not name or source.startswith("-"):
        raise UsageError(f"{source!r}: expected HOST:RUN, e.g. login1:work/runs/aeb-256")
    local = ":" not in source.partition("/")[0]
    if local and not Path(source).is_dir():
        raise UsageError(f"{source}: no such folder; from a cluster, give HOST:RUN")
    rsync = exists("rsync")
    if not rsync and not exists("scp"):
        raise InfrastructureError("neither rsync nor scp here; install rsync (Debian: rsync)")
    target = folder or Path("runs") / name
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}") from None
    code = watch(*pull_command(source, target, rsync=rsync))
    if code:
        program = "rsync" if rsync else "scp"
        raise InfrastructureError(
            f"{source}: {program} ended with {code}, see above; the same command goes on"
        )
    return target


def pull_job(run: Path, folder: Path | None) -> Path | None:
    """Copy the results of the job of a run folder of this machine; into ``folder``, else beside
    what says which job it is. None: ``run`` has no job that keeps its results elsewhere.

    Raises:
        TwinError: they cannot be had, or not be written.
    """
    submitted = job_of(run)
    if submitted is None:
        return None
    system = backend(submitted[0])
    if not isinstance(system, RemoteScheduler):
        return None
    target = folder or run
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}") from None
    system.pull(submitted[1], target)
    return target
