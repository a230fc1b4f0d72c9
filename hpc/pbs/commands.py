"""PBS over its command-line tools: PBS Pro and OpenPBS, and what answers to the same names."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from hpc.commands import ProgramEnd, call
from hpc.pbs.job_script import options, render
from hpc.pbs.lint import lint
from hpc.request import JobRequest
from hpc.scheduler import (
    PARTITIONS_MAX,
    JobStatus,
    Partition,
    Partitions,
    State,
    job_id,
)
from hpc.script import job_name
from schemas.kinds.batch_system import PBS
from twin.base.errors import InfrastructureError, TwinError, UsageError

_STATES: dict[str, State] = {
    **dict.fromkeys("QHWTMU", "pending"),
    **dict.fromkeys("RSBE", "running"),
    **dict.fromkeys("FXC", "ended"),
}
_NOT_ANSWERING = (
    *("cannot connect to server", "Connection refused", "No Permission to connect"),
    "Problem loading jobs",  # Slurm's wrapper
)
_GONE = (153, 35)
"""Exit codes of ``qstat``: the low bytes of PBS's errors 15001, no such job, and 15139, a job of
its history."""
_NUMBER = re.compile("-?[0-9]{1,9}")


class Pbs:
    """See :class:`hpc.scheduler.Scheduler`."""

    name = PBS.name

    def render(self, request: JobRequest) -> str:
        """The job script."""
        return render(request)

    def render_array(self, _request: JobRequest, _cases: Sequence[str], /) -> str:
        """Job arrays are not written for PBS: that way is measured on Slurm alone."""
        raise UsageError("--array: for Slurm only; the comparison needs one of the two")

    def check(self, text: str, _request: JobRequest, /) -> None:
        """PBS has no trial run: the lines are checked against the reference."""
        mistakes = lint(text)
        if mistakes:
            raise UsageError("\n".join(f"job script: {mistake}" for mistake in mistakes))

    def submit(self, path: Path, folder: Path) -> str:
        """``qsub`` in the script's folder, which is where the log goes."""
        done = call("qsub", path.name, folder=folder)
        if done.code or not done.out.strip():
            raise _refusal("PBS did not take the job", done)
        return job_id(self.name, done.out.split()[-1])

    def status(self, job: str) -> JobStatus:
        """``qstat -fx`` knows ended jobs where the site keeps a history."""
        done = call("qstat", "-f", "-x", job)
        if done.code or "job_state" not in done.out:
            done = call("qstat", "-f", job)
        if done.code in _GONE:
            return JobStatus("gone")
        if done.code:
            raise _refusal(f"job {job}", done)
        return parse_job(done.out)

    def cancel(self, job: str) -> None:
        """``qdel``: SIGTERM, then SIGKILL; nothing is queued again."""
        done = call("qdel", job)
        if done.code:
            raise _refusal(f"job {job} was not deleted", done)

    def requeue(self, job: str) -> None:
        """The job is queued again as the script's own timer does it; ``qrerun`` would need operator
        privilege."""
        self.signal(job, "SIGUSR2")

    def signal(self, job: str, name: str) -> None:
        """``qsig``: to all processes of the job."""
        done = call("qsig", "-s", name, job)
        if done.code:
            raise _refusal(f"job {job} was not signalled", done)

    def interactive(self, request: JobRequest, command: list[str]) -> list[str]:
        """``qsub -I``."""
        words = [word for option in options(request) for word in shlex.split(option)]
        return ["qsub", "-I", *words, *(["--", *command] if command else [])]

    def log(self, job: str, request: JobRequest, /) -> str:
        """PBS's default name; it appears there when the job ends."""
        return f"{job_name(request.campaign)}.o{job.split('.')[0]}"

    def partitions(self, wait_s: float) -> Partitions:
        """``qstat -Qf``: every queue that the user may see."""
        done = call("qstat", "-Q", "-f", wait_s=wait_s)
        if done.code:
            return Partitions(trouble=done.last_words)
        return Partitions(parse_queues(done.out))


def parse_queues(text: str) -> tuple[Partition, ...]:
    """What ``qstat -Qf`` prints."""
    queues = [
        {**attributes(part), "name": part.partition("\n")[0].strip()}
        for part in re.split(r"^Queue:", text, flags=re.MULTILINE)[1 : PARTITIONS_MAX + 1]
    ]
    return tuple(
        Partition(
            queue["name"],
            queue.get("resources_max.walltime", ""),
            gpus=f"{n} GPUs" if (n := queue.get("resources_available.ngpus", "")) else "",
            state="up" if queue.get("started", "True") == "True" else "stopped",
        )
        for queue in queues
    )


def parse_job(text: str) -> JobStatus:
    """The attributes that ``qstat -f`` prints; long lines go on after a tab."""
    values = attributes(text)
    native = values.get("job_state", "")
    state = _STATES.get(native, "unknown")
    code = values.get("Exit_status", values.get("exit_status", ""))
    count = values.get("run_count", "1")
    return JobStatus(
        state=state,
        native=native,
        reason=values.get("comment", "") if state == "pending" else "",
        nodes=values.get("exec_host", ""),
        exit_code=int(code) if state == "ended" and _NUMBER.fullmatch(code) else None,
        restarts=max(0, int(count) - 1) if _NUMBER.fullmatch(count) else 0,
    )


def attributes(text: str) -> dict[str, str]:
    """``name = value`` lines; a line that is none goes on with the one before."""
    values: dict[str, str] = {}
    name = ""
    for line in text.splitlines():
        match = re.fullmatch(r"\s+([A-Za-z_][\w.]*) = (.*)", line)
        if match:
            name, values[match[1]] = match[1], match[2].strip()
        elif name and line.startswith("\t"):
            values[name] += line.strip()
    return values


def _refusal(what: str, done: ProgramEnd) -> TwinError:
    if any(words in done.err for words in _NOT_ANSWERING):
        return InfrastructureError(f"{what}: the PBS server does not answer; try later")
    return UsageError(f"{what}: {done.last_words.removeprefix('qsub: ')}")
