"""How a run stands: what its Jobs and pods say, as a :class:`hpc.scheduler.JobStatus`."""

from __future__ import annotations

from typing import Any

from hpc.kubernetes.api import Namespace, NotThereError, component_of, refusals
from hpc.scheduler import JobStatus, State
from schemas.words import counted

_LEFT = "{} still there; the same `hpc submit` goes on, `hpc cancel` ends them"
"""Said of workers whose conductor has ended."""


def standing(namespace: Namespace, run: str) -> JobStatus:
    """The status of a run.

    Raises:
        TwinError: the API refuses, or is in trouble.
    """
    with refusals(f"run {run}"):  # objects may lack what a cluster always says
        return _standing(namespace, run)


def _standing(namespace: Namespace, run: str) -> JobStatus:
    try:
        job = namespace.read("Job", f"{run}-conductor")
    except NotThereError:
        return _joining(namespace, run)
    pods = namespace.pods(run)
    conductors = [pod for pod in pods if component_of(pod) == "conductor"]
    workers = [pod for pod in pods if component_of(pod) == "worker"]
    last = conductors[-1] if conductors else None
    state, native = _state(job, last)
    if state == "ended":
        left = [pod for pod in workers if pod.status.phase in ("Pending", "Running")]
        reason = _LEFT.format(counted(len(left), "worker")) if left else ""
    else:
        reasons = (
            "suspended, until its queue admits it" if job.spec.suspend else "",
            _waits(namespace, f"{run}-conductor", last),
            _workers_wait(namespace, run, workers),
        )
        reason = "; ".join(part for part in reasons if part)
    return JobStatus(
        state=state,
        native=native,
        reason=reason,
        nodes=_nodes(last, workers) if state == "running" else "",
        exit_code=_exit_code(job, last) if state == "ended" else None,
        restarts=job.status.failed or 0,
    )


def _joining(namespace: Namespace, run: str) -> JobStatus:
    """The status of workers that have their conductor elsewhere."""
    try:
        job = namespace.read("Job", f"{run}-worker")
    except NotThereError:
        gone = "" if namespace.exists() else f"namespace {namespace.name} is not there"
        return JobStatus("gone", native=gone)
    workers = namespace.pods(run)
    running = [pod for pod in workers if pod.status.phase == "Running"]
    state, native = _state(job, running[0] if running else None)
    waits = "suspended, until its queue admits it" if job.spec.suspend else ""
    if state != "ended":
        waits = waits or _workers_wait(namespace, run, workers)
    nodes = sorted({pod.spec.node_name for pod in running if pod.spec.node_name})
    return JobStatus(
        state=state,
        native=native,
        reason=waits,
        nodes=", ".join(nodes[:8]) + (" ..." if len(nodes) > 8 else ""),
        exit_code=(0 if job.status.succeeded else None) if state == "ended" else None,
        restarts=job.status.failed or 0,
    )


def _state(job: Any, conductor: Any) -> tuple[State, str]:
    conditions = {c.type for c in job.status.conditions or () if c.status == "True"}
    for condition in ("Complete", "Failed"):
        if condition in conditions:
            return "ended", condition
    if conductor is not None and conductor.status.phase == "Running":
        return "running", "Running"
    return "pending", "Suspended" if job.spec.suspend else "Pending"


def _exit_code(job: Any, conductor: Any) -> int | None:
    """The conductor's own exit code; a Job that has lost its pods has none to tell but success."""
    if conductor is not None:
        for container in conductor.status.container_statuses or ():
            if container.state.terminated is not None:
                return int(container.state.terminated.exit_code)
    return 0 if job.status.succeeded else None


def _waits(namespace: Namespace, job: str, pod: Any) -> str:
    """Why a Job has no running pod; empty: it has, or nothing is known."""
    if pod is None or pod.status.phase in ("Succeeded", "Failed"):
        return _last_warning(namespace, job)
    if pod.status.phase != "Pending":
        return ""
    for container in (*(pod.status.init_container_statuses or ()), *_containers(pod)):
        waiting = container.state.waiting
        if waiting is not None and waiting.reason not in (None, "PodInitializing"):
            return f"{waiting.reason}: {waiting.message or pod.metadata.name}"
    for condition in pod.status.conditions or ():
        if condition.type == "PodScheduled" and condition.status == "False":
            return f"{condition.reason}: {condition.message}"
    return ""


def _workers_wait(namespace: Namespace, run: str, workers: list[Any]) -> str:
    """Why workers do not run; one reason stands for all."""
    waiting = [_waits(namespace, "", pod) for pod in workers if pod.status.phase == "Pending"]
    reasons = [reason for reason in waiting if reason]
    if reasons:
        return f"{counted(len(reasons), 'worker')}: {reasons[0]}"
    if any(pod.status.phase == "Running" for pod in workers):
        return ""
    warning = _last_warning(namespace, f"{run}-worker")
    return f"workers: {warning}" if warning else ""


def _last_warning(namespace: Namespace, name: str) -> str:
    if not name:
        return ""
    warnings = [event for event in namespace.events(name) if event.type == "Warning"]
    return f"{warnings[-1].reason}: {warnings[-1].message}" if warnings else ""


def _nodes(conductor: Any, workers: list[Any]) -> str:
    running = [pod for pod in workers if pod.status.phase == "Running"]
    nodes = sorted({pod.spec.node_name for pod in running if pod.spec.node_name})
    shown = ", ".join(nodes[:8]) + (" ..." if len(nodes) > 8 else "")
    where = f" on {shown}" if shown else ""
    return f"{conductor.spec.node_name} with {counted(len(running), 'worker')}{where}"


def _containers(pod: Any) -> tuple[Any, ...]:
    return tuple(pod.status.container_statuses or ())
