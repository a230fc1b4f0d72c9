"""Submission of a request: a queued job, or one clear line and nothing left behind."""

from __future__ import annotations

import contextlib
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from hpc.request import SIGNAL_SLACK_S, JobRequest, hours_minutes
from hpc.scheduler import ChartScheduler, FolderScheduler, Scheduler
from schemas.kinds.batch_system import batch_systems
from twin.base.errors import InfrastructureError, TwinError, UsageError, storage_error
from twin.base.files import write_atomic

JOB_FILE = "job.id"
"""Name of the file in the run folder that says which job runs it: ``slurm 12``."""
PROBE_BYTES = 1 << 20
"""Size of a file that must fit into the run folder [bytes]."""


@dataclass(frozen=True, slots=True)
class SubmittedJob:
    """A job that the scheduler has taken."""

    scheduler: str
    job: str
    out: str
    script: str
    log: str


def submit(request: JobRequest, scheduler: Scheduler, deadline_s: float) -> SubmittedJob:
    """Check everything that can be checked, then submit.

    Raises:
        TwinError: it could not be submitted; the folder is as it was.
    """
    folder = Path(request.out)
    check_walltime(request, deadline_s, p95_s(folder))
    check_free(folder, scheduler)
    text = scheduler.render(request)
    with _undone_on_failure(folder) as undo:
        probe(folder)
        scheduler.check(text, request)
        script = folder / batch_systems().find(scheduler.name).script
        undo.file(script)
        _write(script, text, mode=0o755)
        job = scheduler.submit(script, folder)
        try:
            _write(folder / JOB_FILE, f"{scheduler.name} {job}\n")
        except TwinError as error:
            scheduler.cancel(job)
            raise type(error)(f"{error}; job {job} was cancelled again") from None
        except BaseException:  # Ctrl-C: nobody would know of the job
            with contextlib.suppress(TwinError):
                scheduler.cancel(job)
            raise
    log = folder / scheduler.log(job, request)
    return SubmittedJob(scheduler.name, job, str(folder), str(script), str(log))


def write_files(
    scheduler: Scheduler, request: JobRequest, folder: Path, *, array: bool = False
) -> list[Path]:
    """Write what a batch system takes, several files, into ``folder``; their paths.

    Raises:
        UsageError: it takes one script, or a file cannot be written.
        InfrastructureError: the disk is full or broken.
    """
    if array or not isinstance(scheduler, FolderScheduler):
        what = "--array" if array else batch_systems().find(scheduler.name).title
        raise UsageError(f"--into {folder}: {what} takes one script; leave --into away")
    return _written(scheduler.files(request), folder)


def write_chart(scheduler: Scheduler, request: JobRequest, folder: Path) -> list[Path]:
    """Write a Helm chart into ``folder``; the paths of its files.

    Raises:
        UsageError: there is none for this batch system, or a file cannot be written.
        InfrastructureError: the disk is full or broken.
    """
    if not isinstance(scheduler, ChartScheduler):
        what = batch_systems().find(scheduler.name).title
        raise UsageError(f"--helm {folder}: {what} is no Kubernetes; leave --helm away")
    return _written(scheduler.chart(request), folder)


def _written(texts: Mapping[str, str], folder: Path) -> list[Path]:
    paths = {folder / name: text for name, text in texts.items()}
    for path, text in paths.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        _write(path, text)
    return [*paths]


def check_walltime(request: JobRequest, deadline_s: float, case_s: float | None) -> None:
    """The job must be able to finish a case, and to give up one that hangs.

    Args:
        request: what is asked for.
        deadline_s: the campaign's limit without progress [s].
        case_s: what 95 of 100 cases of earlier starts took; None: unknown [s].

    Raises:
        UsageError: the wall time is too short.
    """
    usable_s = 60 * request.walltime_min - request.signal_lead_s - SIGNAL_SLACK_S
    need_s = max(deadline_s, case_s or 0.0)
    if usable_s >= need_s:
        return
    least_min = math.ceil((need_s + request.signal_lead_s + SIGNAL_SLACK_S) / 60)
    why = f"the campaign waits up to {deadline_s:.0f} s for a case that stands still (deadline_s)"
    if case_s is not None and case_s > deadline_s:
        why = f"95 of 100 cases took up to {case_s:.0f} s so far"
    raise UsageError(
        f"--time {hours_minutes(request.walltime_min)}: leaves {max(usable_s, 0)} s before the job "
        f"is told to stop, but {why}; give --time {hours_minutes(least_min)} or more"
    )


def p95_s(folder: Path) -> float | None:
    """The wall time that 95 of 100 cases of earlier starts stayed within; None: unknown [s]."""
    try:
        rows = json.loads((folder / "outcomes.json").read_text(encoding="utf-8"))["cases"]
        times = sorted(row["wall_s"] for row in rows.values() if row["outcome"] == "verdict")
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return times[math.ceil(0.95 * len(times)) - 1] if times else None


def check_free(folder: Path, scheduler: Scheduler) -> None:
    """One job per folder: a second one would wait for the folder's lock and fail.

    Raises:
        UsageError: an earlier job is still there.
        InfrastructureError: nobody knows whether it is.
    """
    submitted = job_of(folder)
    if submitted is None or submitted[0] != scheduler.name:
        return
    status = scheduler.status(submitted[1])
    if status.state in ("pending", "running"):
        raise UsageError(
            f"{folder}: job {submitted[1]} is {status.native} and works here; "
            f"`hpc cancel {folder}` ends it, --out chooses another folder"
        )
    if status.state == "unknown":
        said = repr(status.native) if status.native else "nothing is said of it"
        raise InfrastructureError(
            f"{folder}: job {submitted[1]} may still work here: {said} instead of a known state; "
            f"try again, or `hpc cancel {folder}`, or choose another --out"
        )


def job_of(folder: Path) -> tuple[str, str] | None:
    """Scheduler and job id of a run folder, or None."""
    try:
        words = (folder / JOB_FILE).read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError):
        return None
    return (words[0], words[1]) if len(words) == 2 and words[0] in batch_systems().names() else None


def probe(folder: Path) -> None:
    """Write, sync and rename a file, as every result will be.

    Raises:
        TwinError: that does not work: no permission, no space, quota used up.
    """
    path = folder / f".probe-{secrets.token_hex(4)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, bytes(PROBE_BYTES))
    except OSError as error:
        failure = storage_error(error, str(folder))
        raise type(failure)(f"{failure}; nothing was submitted") from None
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def _write(path: Path, text: str, mode: int = 0o644) -> None:
    try:
        write_atomic(path, text.encode(), mode=mode)
    except OSError as error:
        raise storage_error(error, str(path)) from None


class _Undo:
    """Contents of files as they were before."""

    def __init__(self) -> None:
        self.before: dict[Path, bytes | None] = {}

    def file(self, path: Path) -> None:
        try:
            self.before[path] = path.read_bytes()
        except FileNotFoundError:
            self.before[path] = None
        except OSError as error:
            raise InfrastructureError(f"{path}: {error.strerror}") from None


@contextlib.contextmanager
def _undone_on_failure(folder: Path) -> Iterator[_Undo]:
    """Remove folders and files that were made meanwhile, if the block fails."""
    made = [ancestor for ancestor in (folder, *folder.parents) if not ancestor.exists()]
    undo = _Undo()
    try:
        yield undo
    except BaseException:
        with contextlib.suppress(OSError):
            for path, content in undo.before.items():
                if content is None:
                    path.unlink(missing_ok=True)
                else:
                    write_atomic(path, content)
            for created in made:
                os.rmdir(created)  # noqa: PTH106 - only if it is empty
        raise
