"""A :class:`JobRequest` as objects of Kubernetes: plain dictionaries, and their YAML. Pure.

One run is a Job of one pod that is the conductor, and a work-queue Job whose pods are workers. The
conductor keeps journal and results on a claim of its own, or in an object store
(:mod:`hpc.kubernetes.object_store`); workers see no disk of it. They reach it by the name of a
Service, prove themselves by the worker's key, and deliver the files of a result before they commit
it (:mod:`twin.worker.delivery`), so nothing else has to be shared.

How the parts of a run end:

- The conductor's exit code is the verdict. 1 (a verdict is not a pass) and 2 (bad input) end the
  Job; whatever else is started again, at most ``restarts_max`` times.
- A worker ends with 0 when no case is left, and with 75 while some are, or when no conductor has
  answered for a while, as after an end that it has missed: only the first counts as success of a
  work-queue Job, which then starts no further pods.
  75 is no failure either, so a conductor may be slow to come.
- A pod that the cluster takes away (eviction, drain, preemption, a lost node) carries the condition
  ``DisruptionTarget`` and counts for nothing.
- Before a pod goes it has ``signal_lead_s`` after SIGTERM. Running cases may go on for most of
  them; what is left is given back, uncharged. A pod's own end, ``walltime_min``, is known to its
  worker, which takes only cases that fit.
"""

from __future__ import annotations

import hashlib
import re
from typing import Any

import yaml

from hpc.kubernetes import object_store
from hpc.kubernetes.options import SPOT, KubernetesOptions, Toleration
from hpc.request import JobRequest
from hpc.script import ALLOCATION_TAG, job_name, who
from hpc.software.container import BIN_FOLDER
from twin.base.errors import UsageError
from twin.fabric.endpoint import host_and_port

Object = dict[str, Any]
"""An object as the API takes it."""

CAMPAIGN_BYTES_MAX = 900_000
"""Longest campaign file; a ConfigMap holds 1 MiB [bytes]."""
NAME_CHARS_MAX = 40
"""Longest name of a run; names of its objects and pods begin with it [characters]."""
USER = 10001
"""User and group id in the pods."""
CONDUCTOR_GRACE_S = 60
"""How long the conductor may take to end [s]."""
HAND_BACK_S = 30
"""Of a worker's time after SIGTERM, what running cases do not get [s]."""
START_WAIT_S = 120
"""How long a worker waits for a conductor that is to come, or does not answer any more, before
another pod does [s]."""
WORKER_FAILURES = 2
"""Failures, for each worker, before the workers' Job is given up."""
DISK = "10Gi"
"""What a container may write to its pod's own disks."""
WORK, RUN, HOME, KEYS = "/work", "/work/run", "/work/home", "/keys"
"""Mount of the claim; the run folder and the conductor's own folder there; folder of the key."""

JOIN_KEY = "worker.key"
"""File beside the objects of workers that join a conductor elsewhere: the key for their Secret."""

INSTANCE, COMPONENT = "app.kubernetes.io/instance", "app.kubernetes.io/component"
"""Labels that say of an object to which run it belongs, and as what."""
IMAGE, PULL_SECRET = "drivetwin/image", "drivetwin/pull-secret"
"""Annotations of a claim: image whose pods use it, and the Secret by which that is pulled."""
QUEUE = "kueue.x-k8s.io/queue-name"
"""Label that says to which queue of Kueue a Job belongs."""

_CONFINED = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "readOnlyRootFilesystem": True,
}
_LOOKUPS: Object = {
    "to": [{"namespaceSelector": {}, "podSelector": {"matchLabels": {"k8s-app": "kube-dns"}}}],
    "ports": [{"protocol": protocol, "port": 53} for protocol in ("UDP", "TCP")],
}
"""Rule of a network policy: the cluster's name service."""
_SMALL = {"cpu": "100m", "memory": "64Mi"}


def run_name(request: JobRequest) -> str:
    """Name of a run in its namespace: of the campaign, and of the run folder, which it may run in
    only once; of an allocation, also of its run's id."""
    said = request.allocation or job_name(request.campaign)
    stem = re.sub(r"[^a-z0-9]+", "-", said.lower()).strip("-")
    mark = hashlib.sha256(f"{request.out}{request.run}".encode()).hexdigest()[:8]
    return f"dt-{stem[: NAME_CHARS_MAX - 12].strip('-')}-{mark}"


def objects_of(request: JobRequest, options: KubernetesOptions, campaign: str = "") -> list[Object]:
    """All objects of a run but its keys, in the order in which they are created.

    Args:
        request: what is asked for.
        options: what is asked of Kubernetes.
        campaign: text of the campaign file; empty: a shipped campaign, by its name.

    Raises:
        UsageError: the campaign file is too long.
    """
    if len(campaign.encode()) > CAMPAIGN_BYTES_MAX:
        raise UsageError(
            f"{request.campaign}: {len(campaign.encode())} bytes, at most {CAMPAIGN_BYTES_MAX}; "
            "put it into the image as a shipped campaign of a package"
        )
    run = _Run(request, options, campaign)
    if request.join:
        return [run.policy_of_joining_workers(), run.workers()]
    found = [run.service(), run.policy_of_conductor(), run.policy_of_workers()]
    if not options.store:
        found.insert(0, run.claim())
    if campaign:
        found.insert(0, run.campaign_file())
    return [*found, run.conductor(), run.workers()]


def secrets_of(name: str, namespace: str, keys: dict[str, str]) -> list[Object]:
    """The Secrets of a run: a key each, so that a worker's pod never sees the conductor's.

    Args:
        name: name of the run.
        namespace: its namespace; empty: none is said.
        keys: base64 of the key file, by component.
    """
    return [
        _object("v1", "Secret", f"{name}-{component}", name, component, namespace)
        | {"type": "Opaque", "data": {f"{component}.key": key}}
        for component, key in keys.items()
    ]


def reader_of(run: str, image: str, pull_secret: str, duration_s: int) -> Object:
    """A pod that sees the claim of a run and nothing else, and does nothing for ``duration_s``."""
    container = {
        "name": "reader",
        "image": image,
        "command": ["sleep", str(duration_s)],
        "resources": {"requests": _SMALL, "limits": {"cpu": "1", "memory": "256Mi"}},
        "securityContext": _CONFINED,
        "volumeMounts": [{"name": "work", "mountPath": WORK, "readOnly": True}],
    }
    spec = {
        **_confined_pod(duration_s, 1, pull_secret),
        "containers": [container],
        "volumes": [
            {"name": "work", "persistentVolumeClaim": {"claimName": run, "readOnly": True}}
        ],
    }
    return _object("v1", "Pod", f"{run}-reader", run, "reader") | {"spec": spec}


def as_yaml(request: JobRequest, objects: list[Object]) -> str:
    """The objects as one file."""
    name = run_name(request)
    if request.join:
        return f"""\
# Objects of Kubernetes, written by `hpc`: {who(request)}.
# They need the Secret {name}-worker with the file worker.key, which `hpc` makes.
{_dumped(objects)}"""
    head = f"""\
# Objects of Kubernetes, written by `hpc`: {who(request)}.
# They need the keys of a fabric, which `hpc submit` makes by itself. By hand:
#   conductor keygen keys
#   kubectl create secret generic {name}-conductor --from-file=keys/conductor.key
#   kubectl create secret generic {name}-worker --from-file=keys/worker.key
"""
    return head + _dumped(objects)


def kustomization(request: JobRequest, namespace: str = "") -> str:
    """The ``kustomization.yaml`` beside ``objects.yaml``."""
    name = run_name(request)
    content: Object = {
        "apiVersion": "kustomize.config.k8s.io/v1beta1",
        "kind": "Kustomization",
        "resources": ["objects.yaml"],
        "generatorOptions": {"disableNameSuffixHash": True},
        "secretGenerator": [
            {"name": f"{name}-{component}", "files": [f"keys/{component}.key"]}
            for component in ("conductor", "worker")
        ],
    }
    if namespace:
        content["namespace"] = namespace
    head = """\
# A kustomize base, written by `hpc render --into`. The keys first, here, once:
#   conductor keygen keys      (private: keep this folder out of version control)
# then: kubectl apply -k .
"""
    return head + _dumped([content])


def _dumped(objects: list[Object]) -> str:
    return "".join(
        "---\n" + yaml.dump(found, Dumper=_Plain, sort_keys=False, width=100) for found in objects
    )


class _Plain(yaml.SafeDumper):
    """Without anchors: what is said twice stands there twice."""

    def ignore_aliases(self, _data: Any) -> bool:
        """No value is a reference to another."""
        return True


def _object(
    version: str, kind: str, name: str, run: str, component: str, namespace: str = ""
) -> Object:
    metadata: Object = {"name": name}
    if namespace:
        metadata["namespace"] = namespace
    metadata["labels"] = _labels(run, component)
    return {"apiVersion": version, "kind": kind, "metadata": metadata}


def _confined_pod(duration_s: int, grace_s: int, pull_secret: str) -> Object:
    """What every pod is held to: an ordinary user, no token of the API, an end."""
    pod: Object = {
        "restartPolicy": "Never",
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "activeDeadlineSeconds": duration_s,
        "terminationGracePeriodSeconds": grace_s,
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER,
            "runAsGroup": USER,
            "fsGroup": USER,
            "fsGroupChangePolicy": "OnRootMismatch",
            "seccompProfile": {"type": "RuntimeDefault"},
        },
    }
    if pull_secret:
        pod["imagePullSecrets"] = [{"name": pull_secret}]
    return pod


def _labels(run: str, component: str) -> dict[str, str]:
    return {
        "app.kubernetes.io/name": "drivetwin",
        INSTANCE: run,
        COMPONENT: component,
        "app.kubernetes.io/managed-by": "hpc",
    }


class _Run:
    """What the objects of one run have in common."""

    def __init__(self, request: JobRequest, options: KubernetesOptions, campaign: str) -> None:
        self.request, self.options, self.campaign = request, options, campaign
        self.name = run_name(request)

    def claim(self) -> Object:
        """Storage of journal and results. One node at a time writes it: one pod does."""
        spec: Object = {
            "accessModes": ["ReadWriteOnce"],
            "resources": {"requests": {"storage": self.options.storage}},
        }
        if self.options.storage_class:
            spec["storageClassName"] = self.options.storage_class
        claim = self._object("v1", "PersistentVolumeClaim", "", "conductor")
        # What reads it when everything else is gone.
        claim["metadata"]["annotations"] = {
            IMAGE: self.options.image,
            PULL_SECRET: self.options.pull_secret,
        }
        return claim | {"spec": spec}

    def campaign_file(self) -> Object:
        """The campaign file of this machine."""
        content = {"data": {"campaign.yaml": self.campaign}}
        return self._object("v1", "ConfigMap", "campaign", "conductor") | content

    def service(self) -> Object:
        """The name by which workers reach the conductor, wherever it runs."""
        port = {"name": "fabric", "port": self.options.port, "targetPort": self.options.port}
        spec = {"selector": self._selector("conductor"), "ports": [port]}
        return self._object("v1", "Service", "", "conductor") | {"spec": spec}

    def policy_of_conductor(self) -> Object:
        """The conductor hears its workers, and calls nobody but its store."""
        heard = [{"podSelector": {"matchLabels": self._selector("worker")}}]
        spec = {
            "podSelector": {"matchLabels": self._selector("conductor")},
            "policyTypes": ["Ingress", "Egress"],
            "ingress": [{"from": heard, "ports": [self._port()]}],
            "egress": self._ways_to_store(),
        }
        return self._policy("conductor", spec)

    def policy_of_workers(self) -> Object:
        """Workers, and the stacks in them, reach the conductor and look up its name."""
        conductor = [{"podSelector": {"matchLabels": self._selector("conductor")}}]
        return self._policy_of_workers({"to": conductor, "ports": [self._port()]})

    def policy_of_joining_workers(self) -> Object:
        """The conductor is outside of the cluster: its address where that is known, its port."""
        host, port = host_and_port(self.request.connect)
        way: Object = {"ports": [{"protocol": "TCP", "port": port}]}
        if re.fullmatch(r"[0-9]{1,3}(\.[0-9]{1,3}){3}", host):
            way = {"to": [{"ipBlock": {"cidr": f"{host}/32"}}], **way}
        return self._policy_of_workers(way)

    def _policy_of_workers(self, way: Object) -> Object:
        ways = self._ways_to_store() or [_LOOKUPS]
        spec = {
            "podSelector": {"matchLabels": self._selector("worker")},
            "policyTypes": ["Ingress", "Egress"],
            "ingress": [],
            "egress": [way, *ways],
        }
        return self._policy("worker", spec)

    def _ways_to_store(self) -> list[Object]:
        """The store and the name service; without a store nothing."""
        return [object_store.way(self.options), _LOOKUPS] if self.options.store else []

    def conductor(self) -> Object:
        """One pod; another one goes on where it stopped, with the same claim or store."""
        named = "/campaign/campaign.yaml" if self.campaign else self.request.campaign
        command = [
            *(f"{BIN_FOLDER}/conductor", "serve", "--campaign", named, "--until-done"),
            *("--state", RUN, "--listen", f"tls/0.0.0.0:{self.options.port}"),
            *("--key", f"{KEYS}/conductor.key"),
            *(object_store.words(self.options, self.name) if self.options.store else ()),
        ]
        container = {
            **self._container("conductor", command, {"cpu": "2", "memory": "4Gi"}),
            "ports": [{"name": "fabric", "containerPort": self.options.port}],
            # No probe of the port: what is no TLS there is written into its log of attacks.
            "readinessProbe": {
                "exec": {"command": ["test", "-s", f"{RUN}/conductor.json"]},
                "periodSeconds": 5,
            },
        }
        container["env"].append({"name": "DRIVETWIN_HOME", "value": HOME})
        container["volumeMounts"].append({"name": "work", "mountPath": WORK})
        disk: Object = {"persistentVolumeClaim": {"claimName": self.name}}
        if self.options.store:
            disk = {"emptyDir": {"sizeLimit": self.options.storage}}
            # A pod whose disks together exceed it is evicted.
            limits = container["resources"]["limits"]
            limits["ephemeral-storage"] = _sum_of(DISK, self.options.storage)
        volumes = [{"name": "work", **disk}]
        if self.campaign:
            mount = {"name": "campaign", "mountPath": "/campaign", "readOnly": True}
            container["volumeMounts"].append(mount)
            volumes.append({"name": "campaign", "configMap": {"name": f"{self.name}-campaign"}})
        pod = self._pod("conductor", container, volumes, CONDUCTOR_GRACE_S)
        # The same host in every pod: whether another conductor works is decided by the lock on the
        # claim, which one node has, and not by how long ago it was heard.
        pod["hostname"] = "conductor"
        verdicts = {"containerName": "conductor", "operator": "In", "values": [1, 2]}
        rules = [_rule("FailJob", verdicts)]
        job = self._job("conductor", pod, rules, 1, self.request.restarts_max)
        if self.options.store:
            where = object_store.url_of(self.options, self.name)
            job["metadata"]["annotations"] = {object_store.STORE: where}
        return job

    def workers(self) -> Object:
        """A work queue: pods until one has found that no case is left."""
        request, lead_s = self.request, self.request.signal_lead_s
        # An invitation says by itself where the conductor is.
        where = ["--connect", f"tls/{self.name}:{self.options.port}"]
        if request.join:
            where = ["--site", request.site] if request.site else []
            if request.allocation:
                where += ["--tag", f"{ALLOCATION_TAG}{request.allocation}"]
        command = [
            *(f"{BIN_FOLDER}/twin", "worker", *where),
            *("--key", f"{KEYS}/worker.key", "--wait", str(START_WAIT_S)),
            *("--away-s", str(START_WAIT_S)),
            *("--until-done", "--started-again", "--drain-s", str(max(0, lead_s - HAND_BACK_S))),
            *(() if request.slots is None else ("--slots", str(request.slots))),
            *("--device", "cuda:0" if request.gpus else "cpu"),
        ]
        limits = {"cpu": str(request.cpus), "memory": self.options.memory}
        if request.gpus:
            limits[self.options.gpu_resource] = "1"
        container = self._container("worker", command, limits)
        walltime_s = 60 * request.walltime_min - lead_s
        container["env"].append({"name": "TWIN_WALLTIME_S", "value": str(walltime_s)})
        container["volumeMounts"].append({"name": "shm", "mountPath": "/dev/shm"})
        shared = {"name": "shm", "emptyDir": {"medium": "Memory", "sizeLimit": "1Gi"}}
        pod = self._pod("worker", container, [shared], lead_s)
        chosen = dict(self.options.labels)
        tolerated = list(self.options.tolerations)
        if self.options.spot:
            spot = SPOT[self.options.spot]
            chosen[spot.label[0]] = spot.label[1]
            tolerated += [spot.taint] if spot.taint is not None else []
        if chosen:
            pod["nodeSelector"] = chosen
        if tolerated:
            pod["tolerations"] = [_tolerated(taint) for taint in tolerated]
        left = {"containerName": "worker", "operator": "In", "values": [75]}
        rules = [_rule("Ignore", left)]
        count = request.worker_count
        return self._job("worker", pod, rules, count, WORKER_FAILURES * count)

    def _job(
        self, component: str, pod: Object, rules: list[Object], count: int, failures: int
    ) -> Object:
        disruption = {"type": "DisruptionTarget", "status": "True"}
        job = self._object("batch/v1", "Job", component, component)
        spec: Object = {
            "parallelism": count,
            "backoffLimit": failures,
            "podFailurePolicy": {
                "rules": [{"action": "Ignore", "onPodConditions": [disruption]}, *rules]
            },
            "template": {
                "metadata": {"labels": _labels(self.name, component)},
                "spec": pod,
            },
        }
        if component == "conductor":
            spec = {"completions": 1, **spec}
        if self.request.join:
            spec = {"activeDeadlineSeconds": 60 * self.request.walltime_min, **spec}
        if self.options.queue:
            job["metadata"]["labels"] |= {QUEUE: self.options.queue}
            spec = {"suspend": True, **spec}
        return job | {"spec": spec}

    def _pod(
        self, component: str, container: Object, volumes: list[Object], grace_s: int
    ) -> Object:
        """``component`` finds its key at :data:`KEYS`, as a file of its own user."""
        secret = {"secretName": f"{self.name}-{component}", "defaultMode": 0o440}
        pod: Object = {
            **_confined_pod(60 * self.request.walltime_min, grace_s, self.options.pull_secret),
            "initContainers": [self._key_bringer(component)],
            "containers": [container],
            "volumes": [
                {"name": "secret", "secret": secret},
                {"name": "keys", "emptyDir": {"medium": "Memory", "sizeLimit": "1Mi"}},
                {"name": "tmp", "emptyDir": {"sizeLimit": "8Gi"}},
                *volumes,
            ],
        }
        if self.options.store:
            object_store.add_to(container, self.options)
            pod["volumes"].append(object_store.volume(self.options))
        if self.options.priority_class:
            pod["priorityClassName"] = self.options.priority_class
        return pod

    def _key_bringer(self, component: str) -> Object:
        """Files of a Secret belong to root, and a key that is not its user's alone is refused."""
        file = f"{component}.key"
        return {
            "name": "key",
            "image": self.options.image,
            "command": ["install", "-m", "0600", f"/secret/{file}", f"{KEYS}/{file}"],
            "resources": {"requests": _SMALL, "limits": _SMALL},
            "securityContext": _CONFINED,
            "volumeMounts": [
                {"name": "secret", "mountPath": "/secret", "readOnly": True},
                {"name": "keys", "mountPath": KEYS},
            ],
        }

    def _container(self, name: str, command: list[str], limits: dict[str, str]) -> Object:
        disk = {"ephemeral-storage": DISK}
        return {
            "name": name,
            "image": self.options.image,
            "command": command,
            "env": [
                {"name": "HOME", "value": "/tmp"},
                {"name": "USER", "value": "drivetwin"},
                {"name": "DRIVETWIN_JOB", "value": self.name},
            ],
            "resources": {"requests": {**limits}, "limits": {**limits, **disk}},
            "securityContext": _CONFINED,
            "volumeMounts": [
                {"name": "keys", "mountPath": KEYS},
                {"name": "tmp", "mountPath": "/tmp"},
            ],
        }

    def _object(self, version: str, kind: str, suffix: str, component: str) -> Object:
        name = f"{self.name}-{suffix}" if suffix else self.name
        return _object(version, kind, name, self.name, component, self.options.namespace)

    def _policy(self, component: str, spec: Object) -> Object:
        return self._object("networking.k8s.io/v1", "NetworkPolicy", component, component) | {
            "spec": spec
        }

    def _selector(self, component: str) -> dict[str, str]:
        return {INSTANCE: self.name, COMPONENT: component}

    def _port(self) -> Object:
        return {"protocol": "TCP", "port": self.options.port}


def _rule(action: str, exit_codes: Object) -> Object:
    # Schemas before 1.29 ask for conditions in every rule; an empty list is none.
    return {"action": action, "onExitCodes": exit_codes, "onPodConditions": []}


def _sum_of(first: str, second: str) -> str:
    """Two sizes, as ``8Gi``, together."""
    units = {"Mi": 1, "Gi": 1 << 10, "Ti": 1 << 20}
    return f"{sum(int(size[:-2]) * units[size[-2:]] for size in (first, second))}Mi"


def _tolerated(taint: Toleration) -> Object:
    found: Object = {"key": taint.key, "operator": "Exists"}
    if taint.value:
        found |= {"operator": "Equal", "value": taint.value}
    if taint.effect:
        found["effect"] = taint.effect
    return found
