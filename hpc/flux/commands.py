"""Flux over ``flux``: one node, the workers as children of the job script."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hpc import script
from hpc.commands import ProgramEnd, call
from hpc.request import JobRequest
from hpc.scheduler import JobStatus, Partition, Partitions, State
from schemas.kinds.batch_system import FLUX
from twin.base.errors import InfrastructureError, UsageError

_STATES: dict[str, State] = {
    **dict.fromkeys(("DEPEND", "PRIORITY", "SCHED"), "pending"),
    **dict.fromkeys(("RUN", "CLEANUP"), "running"),
    "INACTIVE": "ended",
}

_TRAPS = """\
signalled=no stopping=no lost=no
trap 'signalled=yes stopping=yes; kill -TERM "$conductor" 2>/dev/null' TERM
trap 'signalled=yes lost=yes; kill -TERM "$conductor" 2>/dev/null' USR1"""

_WORKERS = """\
# --- The workers, children of this script.
end_workers() {{ pkill "-$1" --parent "$workers"; }}
{{
  for _ in {{1..{count}}}; do (worker) & done
  wait
{lost}
}} &
workers=$!"""


class Flux:
    """See :class:`hpc.scheduler.Scheduler`."""

    name = FLUX.name

    def render(self, request: JobRequest) -> str:
        """The job script; everything is on one node."""
        if not request.one_node:
            raise UsageError("Flux: one node so far; give --nodes 1")
        if request.remote_stacks:
            raise UsageError("Flux: stacks run beside their simulators; leave out placement: node")
        device = "cuda:0" if request.gpus else "cpu"
        workers = _WORKERS.format(count=request.worker_count, lost=script.LOST)
        return "\n\n".join(
            (
                "#!/bin/bash\n" + "\n".join(f"# flux: {option}" for option in _options(request)),
                script.names(request),
                script.on_each_node(request, "  hostname -I | cut -d ' ' -f 1", device),
                script.conductor(request).replace("{TRAPS}", _TRAPS),
                workers,
                script.WAIT,
                script.VERDICT + '\nexit "$verdict"\n',
            )
        )

    def render_array(self, _request: JobRequest, _cases: Sequence[str], /) -> str:
        """None."""
        raise UsageError("--array: Flux has no job arrays; leave it out")

    def check(self, text: str, _request: JobRequest, /) -> None:
        """``flux batch --dry-run`` writes the job's specification and submits nothing."""
        _good(call("flux", "batch", "--dry-run", text=text), "Flux refuses this job")

    def submit(self, path: Path, folder: Path) -> str:
        """``flux batch``; the log goes to its working folder."""
        done = call("flux", "batch", "--output=flux-{{id}}.out", str(path), folder=folder)
        return _good(done, "Flux did not take the job").strip()

    def status(self, job: str) -> JobStatus:
        """``flux jobs`` knows jobs as long as their instance lives."""
        done = call("flux", "jobs", "--no-header", "--format={state} {returncode}", job)
        words = done.out.split()
        if done.code or len(words) != 2:
            return JobStatus("unknown")
        code = int(words[1]) if words[1].lstrip("-").isdigit() else None
        state = _STATES.get(words[0], "unknown")
        return JobStatus(state, words[0], exit_code=code if state == "ended" else None)

    def cancel(self, job: str) -> None:
        """``flux cancel``."""
        _good(call("flux", "cancel", job), f"job {job}")

    def requeue(self, job: str) -> None:
        """Not offered."""
        raise UsageError(f"job {job}: Flux queues none again; submit it again, and it goes on")

    def signal(self, job: str, name: str) -> None:
        """``flux job kill``."""
        _good(call("flux", "job", "kill", f"--signal={name}", job), f"job {job}")

    def interactive(self, request: JobRequest, command: list[str]) -> list[str]:
        """``flux alloc``."""
        return ["flux", "alloc", *_options(request), *command]

    def log(self, job: str, _request: JobRequest, /) -> str:
        """As ``submit`` says."""
        return f"flux-{job}.out"

    def partitions(self, wait_s: float) -> Partitions:
        """Its queues."""
        done = call("flux", "queue", "list", "--no-header", "--format={queue}", wait_s=wait_s)
        return Partitions(tuple(Partition(name) for name in done.out.split()))


def _options(request: JobRequest) -> list[str]:
    found = [
        f"--job-name={script.job_name(request.campaign)}",
        f"--time-limit={request.walltime_min}m",
        f"--nslots={request.worker_count}",
        f"--cores-per-slot={request.cpus}",
    ]
    found += ["--gpus-per-slot=1"] if request.gpus else []
    found += [f"--queue={request.partition}"] if request.partition else []
    return [*found, *request.directives]


def _good(done: ProgramEnd, what: str) -> str:
    """What a program wrote.

    Raises:
        InfrastructureError: it failed.
    """
    if done.code:
        raise InfrastructureError(f"{what}: {done.last_words}")
    return done.out
