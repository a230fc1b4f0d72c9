"""Slurm over its command-line tools."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from hpc.commands import ProgramEnd, call, exists
from hpc.request import JobRequest, hours_minutes
from hpc.scheduler import (
    PARTITIONS_MAX,
    WORDS_CHARS_MAX,
    JobStatus,
    Partition,
    Partitions,
    State,
    job_id,
)
from hpc.slurm import array
from hpc.slurm.job_script import options, render
from schemas.escape import escape
from schemas.kinds.batch_system import SLURM
from twin.base.errors import InfrastructureError, TwinError, UsageError

_STATES: dict[str, State] = {
    **dict.fromkeys(("PENDING", "REQUEUED", "REQUEUE_HOLD", "REQUEUE_FED"), "pending"),
    **dict.fromkeys(("SPECIAL_EXIT", "RESV_DEL_HOLD"), "pending"),
    **dict.fromkeys(("RUNNING", "COMPLETING", "CONFIGURING", "STAGE_OUT"), "running"),
    **dict.fromkeys(("SIGNALING", "SUSPENDED", "STOPPED", "RESIZING"), "running"),
    **dict.fromkeys(("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "DEADLINE"), "ended"),
    **dict.fromkeys(("NODE_FAIL", "BOOT_FAIL", "OUT_OF_MEMORY", "PREEMPTED", "REVOKED"), "ended"),
}
"""States of ``squeue``'s manual; of any other nobody knows what it means."""
_NOT_ANSWERING = ("contact slurm controller", "Socket timed out", "Connection refused")
_NO_SUCH_JOB = "Invalid job id"
_NUMBER = re.compile("[0-9]{1,9}")


class Slurm:
    """See :class:`hpc.scheduler.Scheduler`."""

    name = SLURM.name

    def render(self, request: JobRequest) -> str:
        """The job script."""
        return render(request)

    def render_array(self, request: JobRequest, cases: Sequence[str], /) -> str:
        """One index per case."""
        return array.render(request, cases)

    def check(self, text: str, request: JobRequest, /) -> None:
        """``sbatch --test-only``: partition, account and resources; then the partition's time.

        A job that is longer than its partition allows is taken by many sites, and waits for ever.
        """
        done = call("sbatch", "--test-only", text=text)
        if done.code:
            raise self._refusal("Slurm refuses this job", done)
        rows = call("sinfo", "--noheader", "--format=%P %l").out.splitlines()
        limits = dict(row.split() for row in rows if len(row.split()) == 2)
        wanted = request.partition.split(",") if request.partition else []
        names = [n for n in limits if (n.rstrip("*") in wanted if wanted else n.endswith("*"))]
        limits_min = [minutes(limits[name]) for name in names]
        if limits_min and all(
            limit is not None and limit < request.walltime_min for limit in limits_min
        ):
            allowed = ", ".join(f"{name.rstrip('*')} up to {limits[name]}" for name in names)
            raise UsageError(
                f"--time {hours_minutes(request.walltime_min)}: longer than the partition allows "
                f"({allowed}); an unfinished job queues itself again anyway"
            )

    def submit(self, path: Path, folder: Path) -> str:
        """``sbatch``; the log goes to its working folder."""
        done = call("sbatch", "--parsable", str(path), folder=folder)
        if done.code:
            raise self._refusal("Slurm did not take the job", done)
        return job_id(self.name, done.out.strip().split(";")[0])

    def status(self, job: str) -> JobStatus:
        """``scontrol`` knows jobs until some minutes after their end, ``sacct`` for ever."""
        done = call("scontrol", "--oneliner", "show", "job", job)
        if not done.code:
            return parse_job(done.out)
        if _NO_SUCH_JOB not in done.err:
            raise self._refusal(f"job {job}", done)
        if exists("sacct"):
            fields = "State,ExitCode,NodeList,Restarts"
            done = call("sacct", "-nPX", "--jobs", job, f"--format={fields}")
            if not done.code and done.out.strip():
                return parse_account(done.out)
        return JobStatus("gone")

    def cancel(self, job: str) -> None:
        """``scancel``: everything gets SIGTERM, then SIGKILL; nothing is queued again."""
        done = call("scancel", job)
        if done.code:
            raise self._refusal(f"job {job} was not cancelled", done)

    def requeue(self, job: str) -> None:
        """The job ends as before the end of the wall time: drained, then queued again by the
        script."""
        self.signal(job, "TERM")

    def signal(self, job: str, name: str) -> None:
        """The signal goes to the batch script alone, as ``--signal=B:`` does."""
        done = call("scancel", "--batch", f"--signal={name}", job)
        if done.code:
            raise self._refusal(f"job {job} was not signalled", done)

    def interactive(self, request: JobRequest, command: list[str]) -> list[str]:
        """``salloc``, then a step that takes none of the tasks."""
        terminal = ["--pty"] if sys.stdin.isatty() else []
        step = ["srun", "--interactive", "--preserve-env", "--nodes=1", "--ntasks=1", *terminal]
        words = [word for option in options(request) for word in shlex.split(option)]
        return ["salloc", *words, *step, *command]

    def log(self, job: str, _request: JobRequest, /) -> str:
        """Slurm's default name."""
        return f"slurm-{job}.out"

    def partitions(self, wait_s: float) -> Partitions:
        """``sinfo``: every partition that the user may see."""
        done = call("sinfo", "--noheader", "--format=%P|%l|%D|%G|%a", wait_s=wait_s)
        if done.code:
            return Partitions(trouble=done.last_words)
        return Partitions(parse_sinfo(done.out))

    def _refusal(self, what: str, done: ProgramEnd) -> TwinError:
        if any(words in done.err for words in _NOT_ANSWERING):
            return InfrastructureError(f"{what}: the Slurm controller does not answer; try later")
        line = re.sub(r"^(allocation failure|\w+: error): ", "", done.last_words)
        # The last line says "failed", the one before it why.
        lines = [error.strip() for error in done.err.splitlines() if ": error: " in error]
        if lines:
            line = escape(re.sub(r"^\w+: error: ", "", lines[0]), WORDS_CHARS_MAX)
        if "partition" in line.lower():
            names = call("sinfo", "--noheader", "--format=%P").out.split()
            line += f"; partitions here: {escape(', '.join(names), WORDS_CHARS_MAX) or 'none'}"
        return UsageError(f"{what}: {line}")


def parse_job(line: str) -> JobStatus:
    """One line of ``scontrol --oneliner show job``."""
    fields = dict(word.split("=", 1) for word in line.split() if "=" in word)
    native = fields.get("JobState", "")
    reason = fields.get("Reason", "None")
    nodes = fields.get("NodeList", "(null)")
    return JobStatus(
        state=_state(native),
        native=native,
        reason=reason if _state(native) == "pending" and reason != "None" else "",
        nodes="" if nodes == "(null)" else nodes,
        exit_code=_exit_code(fields.get("ExitCode", "")) if _state(native) == "ended" else None,
        restarts=_count(fields.get("Restarts", "0")),
    )


def parse_account(lines: str) -> JobStatus:
    """The last line of ``sacct -nPX --format=State,ExitCode,NodeList,Restarts``; one that is none
    says nothing."""
    words = (lines.strip().splitlines() or [""])[-1].split("|")
    native, code, nodes, restarts = words if len(words) == 4 else ("", "", "", "")
    native = native.partition(" ")[0]  # "CANCELLED by 0"
    return JobStatus(
        state=_state(native),
        native=native,
        nodes=nodes,
        exit_code=_exit_code(code) if _state(native) == "ended" else None,
        restarts=_count(restarts),
    )


def parse_sinfo(text: str) -> tuple[Partition, ...]:
    """Lines of ``sinfo --format=%P|%l|%D|%G|%a``; a partition has a line per kind of node. Other
    lines are left out."""
    partitions: dict[str, Partition] = {}
    for line in text.splitlines():
        words = line.strip().split("|")
        if len(words) != 5 or not _NUMBER.fullmatch(words[2]):
            continue
        name, limit, count, gres, state = words
        if name not in partitions and len(partitions) == PARTITIONS_MAX:
            break
        gpus = "" if gres == "(null)" else f"{count} x {gres}"
        before = partitions.get(name)
        if before is not None:
            gpus = " + ".join(part for part in (before.gpus, gpus) if part)
            count = str(int(before.nodes.split()[0]) + int(count))
        partitions[name] = Partition(name, limit, f"{count} nodes", gpus, state)
    return tuple(partitions.values())


def minutes(limit: str) -> int | None:
    """A time of Slurm (``2-12:00:00``, ``30:00``) in whole minutes; None: no limit, or unknown."""
    match = re.fullmatch(r"(?:(\d+)-)?(?:(\d+):)?(\d+):(\d+)", limit)
    if match is None:
        return None
    days, hours, mins, _ = (int((part or "0")[:9]) for part in match.groups())
    return 24 * 60 * days + 60 * hours + mins


def _count(text: str) -> int:
    """A number that is not negative; 0 for anything else."""
    return int(text) if _NUMBER.fullmatch(text) else 0


def _state(native: str) -> State:
    return _STATES.get(native, "unknown")


def _exit_code(text: str) -> int | None:
    """``1:0`` as 1; a signal as 128 + its number, as a shell says it."""
    code, _, number = text.partition(":")
    if not _NUMBER.fullmatch(code):
        return None
    return int(code) or (128 + _count(number) if _count(number) else 0)
