"""Kubernetes over its API. See :class:`hpc.scheduler.Scheduler`."""

from __future__ import annotations

import base64
import contextlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from hpc.kubernetes.api import AlreadyThereError, Namespace, NotThereError, component_of
from hpc.kubernetes.chart import chart_of
from hpc.kubernetes.copying import copy_run
from hpc.kubernetes.object_store import CREDENTIALS
from hpc.kubernetes.objects import (
    CAMPAIGN_BYTES_MAX,
    COMPONENT,
    INSTANCE,
    JOIN_KEY,
    Object,
    as_yaml,
    kustomization,
    objects_of,
    secrets_of,
)
from hpc.kubernetes.options import KubernetesOptions, options_of
from hpc.kubernetes.standing import standing
from hpc.request import JobRequest
from hpc.scheduler import JobStatus, Partition, Partitions
from hpc.submit import job_of
from schemas.files.regular_file import read_regular
from schemas.kinds.batch_system import KUBERNETES
from twin.base.errors import TwinError, UsageError
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key, read_private
from twin.fabric.keys.own_keys import fabric_folder, fabric_name, make_way, note
from twin.fabric.keys.roles import Role

_MEMBERS = {"conductor": Role.conductor, "worker": Role.worker}
"""Role of each component's key. No other key leaves this machine."""


class Kubernetes:
    """Jobs of a namespace. A job's id is ``NAMESPACE/RUN@CONTEXT``."""

    name = KUBERNETES.name

    def render(self, request: JobRequest) -> str:
        """The objects but the keys, as one file."""
        return as_yaml(request, _objects(request)[1])

    def render_array(self, _request: JobRequest, _cases: Sequence[str], /) -> str:
        """There is none."""
        raise UsageError("--array: Kubernetes has a work queue; leave --array away")

    def files(self, request: JobRequest) -> Mapping[str, str]:
        """A kustomize base; the keys are added by who has them."""
        options, objects = _objects(request)
        return {
            "objects.yaml": as_yaml(request, objects),
            "kustomization.yaml": kustomization(request, options.namespace),
        }

    def chart(self, request: JobRequest) -> Mapping[str, str]:
        """A Helm chart."""
        return chart_of(request, options_of(request), _campaign_text(request))

    def check(self, text: str, request: JobRequest, /) -> None:
        """A dry run on the server: its schemas, quotas and admission see every object."""
        options = options_of(request)
        namespace = Namespace(name=options.namespace)
        if options.store:
            _check_secret(namespace, options.store_secret)
        for found in _read(text):
            try:
                namespace.create(found, dry_run=True)
            except AlreadyThereError:
                continue  # of an earlier start; submission looks whose it is

    def submit(self, path: Path, folder: Path) -> str:
        """Create keys and objects; on a refusal what was created is deleted again."""
        objects = _read(path.read_text(encoding="utf-8"))
        said = next((found["metadata"].get("namespace", "") for found in objects), "")
        namespace = Namespace(name=said)
        run = objects[0]["metadata"]["labels"][INSTANCE]
        job = f"{namespace.name}/{run}@{namespace.context}"
        joins = not any(found["metadata"]["labels"][COMPONENT] == "conductor" for found in objects)
        if joins:
            keys = {"worker": base64.b64encode(read_private(folder / JOIN_KEY)).decode()}
        else:
            _refuse_others_claim(namespace, run, job, folder)
            keys = {name: _key(folder, role) for name, role in _MEMBERS.items()}
        objects[:0] = secrets_of(run, said, keys)
        made: list[Object] = []
        try:
            for found in objects:
                _create(namespace, found, made, keep=joins)
        except BaseException:  # also Ctrl-C: no key and no half of a run may stay there
            for found in reversed(made):
                with contextlib.suppress(TwinError):
                    namespace.delete(found["kind"], found["metadata"]["name"])
            raise
        return job

    def status(self, job: str) -> JobStatus:
        """What the conductor's Job says, and what its pods wait for."""
        namespace, run = _where(job)
        return standing(namespace, run)

    def cancel(self, job: str) -> None:
        """Delete what runs, and the keys; the claim with the results stays."""
        namespace, run = _where(job)
        for component in ("worker", "conductor"):
            namespace.delete("Job", f"{run}-{component}")
        for kind, suffix in (
            *(("Secret", "-conductor"), ("Secret", "-worker"), ("ConfigMap", "-campaign")),
            *(("NetworkPolicy", "-conductor"), ("NetworkPolicy", "-worker"), ("Service", "")),
        ):
            namespace.delete(kind, f"{run}{suffix}")

    def requeue(self, job: str) -> None:
        """Have the cluster take every pod away, as before work on its node; others go on."""
        namespace, run = _where(job)
        running = [pod for pod in namespace.pods(run) if pod.status.phase == "Running"]
        if not running:
            raise UsageError(f"job {job}: no pod of it runs; `hpc status` says why")
        for pod in sorted(running, key=component_of, reverse=True):
            namespace.evict(pod.metadata.name)

    def signal(self, job: str, name: str) -> None:
        """Pods get none but SIGTERM."""
        raise UsageError(f"job {job}: pods hear no {name}; `hpc requeue` stops them cleanly")

    def interactive(self, _request: JobRequest, _command: list[str]) -> list[str]:
        """There is no allocation to open."""
        raise UsageError("hpc shell: Kubernetes opens no allocation; use `kubectl debug` or `run`")

    def log(self, job: str, _request: JobRequest, /) -> str:
        """No file: the cluster keeps the logs of pods."""
        return f"{job.partition('@')[0].rpartition('/')[2]}.log"

    def partitions(self, wait_s: float) -> Partitions:
        """Nodes by what they offer, as far as one may see them."""
        try:
            nodes = Namespace().nodes(wait_s)
        except TwinError as error:
            return Partitions(trouble=str(error))
        return Partitions(tuple(_partition(node) for node in nodes))

    def pull(self, job: str, target: Path) -> None:
        """Copy the run folder out of the claim."""
        namespace, run = _where(job)
        copy_run(namespace, run, target)


def _objects(request: JobRequest) -> tuple[KubernetesOptions, list[Object]]:
    options = options_of(request)
    return options, objects_of(request, options, _campaign_text(request))


def _campaign_text(request: JobRequest) -> str:
    text = ""
    if request.campaign.startswith("/"):
        try:
            text = read_regular(Path(request.campaign), CAMPAIGN_BYTES_MAX + 1).decode()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{request.campaign}: {error}") from None
    return text


def _read(text: str) -> list[Object]:
    return [found for found in yaml.safe_load_all(text) if found]


def _check_secret(namespace: Namespace, name: str) -> None:
    """Pods would wait for it without a word."""
    try:
        namespace.read("Secret", name)
    except NotThereError:
        raise UsageError(
            f"--store-secret {name}: namespace {namespace.name} has no such Secret; kubectl "
            f"--namespace {namespace.name} create secret generic {name} "
            f"--from-file={CREDENTIALS}=FILE"
        ) from None
    except UsageError:
        pass  # not everybody may read Secrets


def _refuse_others_claim(namespace: Namespace, run: str, job: str, folder: Path) -> None:
    """A claim that is there is this folder's own only if an earlier submission said so."""
    try:
        namespace.read("PersistentVolumeClaim", run)
    except NotThereError:
        return
    if job_of(folder) != (KUBERNETES.name, job):
        raise UsageError(
            f"namespace {namespace.name} has a claim {run} that no job of {folder} made; write "
            f"'{KUBERNETES.name} {job}' into {folder}/job.id if it is yours and to be gone on "
            "with, or choose another --out"
        )


def _create(namespace: Namespace, found: Object, made: list[Object], *, keep: bool = False) -> None:
    """Create an object; one of an earlier start is kept if it is storage, else replaced.

    ``keep``: an allocation's name is never used again, so what is there is of this submission,
    whose answer was lost.

    ``made`` gets what is to be deleted if the run cannot be submitted. Storage is there only when
    it was created for certain; whatever else has this name is of this run, also when no answer
    came.
    """
    kind, name = found["kind"], found["metadata"]["name"]
    storage = kind == "PersistentVolumeClaim" or keep
    if not storage:
        made.append(found)
    try:
        namespace.create(found)
    except AlreadyThereError:
        if storage:
            return
        namespace.delete(kind, name, wait=True)
        namespace.create(found)
    if storage:
        made.append(found)


def _key(folder: Path, role: Role) -> str:
    """The key of a role of the run's own fabric, base64; it is made with the first submission."""
    name = fabric_name(folder)
    keys = fabric_folder(name)
    if not keys.exists():
        note(make_keys(make_way(name)), folder)
    load_key(keys, role)  # refuses one that is not fit
    return base64.b64encode((keys / f"{role}.key").read_bytes()).decode()


def _where(job: str) -> tuple[Namespace, str]:
    match = re.fullmatch(r"([a-z0-9-]+)/([a-z0-9-]+)@(\S+)", job)
    if match is None:
        raise UsageError(f"job {job!r}: expected NAMESPACE/RUN@CONTEXT, as job.id has it")
    return Namespace(match[3], match[1]), match[2]


def _partition(node: Any) -> Partition:
    offered = node.status.allocatable or {}
    gpus = ", ".join(
        f"{count} x {name}" for name, count in sorted(offered.items()) if "gpu" in name
    )
    ready = any(c.type == "Ready" and c.status == "True" for c in node.status.conditions or ())
    return Partition(
        name=node.metadata.name,
        nodes=f"{offered.get('cpu', '?')} CPUs, {offered.get('memory', '?')}",
        gpus=gpus,
        state="up" if ready and not node.spec.unschedulable else "down",
    )
