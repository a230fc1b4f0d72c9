"""What a user may say of a job on Kubernetes beyond what every batch system knows. Pure.

They are the *directives* of a job, ``--NAME=VALUE``, on the command line (``--directive``) or in a
site file, where what stays the same for every job belongs.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from hpc.kubernetes import object_store
from hpc.request import JobRequest
from twin.base.errors import UsageError

PORT = 7447
"""Port of a conductor unless another is given; every pod has its own network."""
TOLERATIONS_MAX = 16
"""Most tolerations of one job."""
LABELS_MAX = 16
"""Most labels that a node is chosen by."""
IMAGE_CHARS_MAX = 500
"""Longest name of an image [characters]."""

IN_IMAGES = ("/opt/", "/usr/", "/bin/")
"""Where an image may have what a campaign names by its absolute path."""

_EFFECTS = ("NoSchedule", "PreferNoSchedule", "NoExecute")

_DNS_LABEL = re.compile(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?")
_DNS_NAME = re.compile(r"[a-z0-9]([-a-z0-9]*[a-z0-9])?(\.[a-z0-9]([-a-z0-9]*[a-z0-9])?)*")
_KEY = re.compile(
    r"([a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?/)?[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?"
)
_VALUE = re.compile(r"([A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?)?")
QUANTITY_PATTERN = r"[1-9][0-9]{0,8}(Mi|Gi|Ti)"
"""Size of memory or storage."""
_QUANTITY = re.compile(QUANTITY_PATTERN)
_RESOURCE = re.compile(r"[a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?/[A-Za-z0-9]([-A-Za-z0-9_.]{0,61})")
IMAGE_PATTERN = (
    r"[a-z0-9][a-z0-9._-]*(:[0-9]{1,5})?(/[a-z0-9][a-z0-9._-]*)*"
    r"(:[A-Za-z0-9_][A-Za-z0-9_.-]{0,127})?(@sha256:[0-9a-f]{64})?"
)
"""Name of an image."""
_IMAGE = re.compile(IMAGE_PATTERN)


@dataclass(frozen=True, slots=True)
class Toleration:
    """A taint of nodes that workers put up with."""

    key: str
    value: str = ""
    """Empty: any."""
    effect: str = ""
    """Empty: every."""


@dataclass(frozen=True, slots=True)
class SpotNodes:
    """How a provider marks nodes that it may take away."""

    label: tuple[str, str]
    taint: Toleration | None


SPOT = {
    "gke": SpotNodes(
        ("cloud.google.com/gke-spot", "true"),
        Toleration("cloud.google.com/gke-spot", "true", "NoSchedule"),
    ),
    "eks": SpotNodes(("eks.amazonaws.com/capacityType", "SPOT"), None),
    "aks": SpotNodes(
        ("kubernetes.azure.com/scalesetpriority", "spot"),
        Toleration("kubernetes.azure.com/scalesetpriority", "spot", "NoSchedule"),
    ),
    "karpenter": SpotNodes(("karpenter.sh/capacity-type", "spot"), None),
}
"""Labels and taints of spot nodes, as the providers' documentation names them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KubernetesOptions:
    """Directives of one job, checked."""

    image: str
    """Image that nodes pull, with this project in ``/opt/drivetwin``."""
    namespace: str = ""
    """Namespace; empty: that of the kubeconfig's context."""
    memory: str = "8Gi"
    """Memory of one worker."""
    storage: str = "10Gi"
    """Size of the conductor's claim; with a store, of its disk."""
    storage_class: str = ""
    """Storage class of the claim; empty: the cluster's default."""
    priority_class: str = ""
    """Priority class of all pods; empty: the cluster's default."""
    pull_secret: str = ""
    """Secret by which nodes pull the image; empty: none."""
    gpu_resource: str = "nvidia.com/gpu"
    """Extended resource that is one GPU."""
    spot: str = ""
    """Provider, of :data:`SPOT`, whose spot nodes run the workers; empty: any node."""
    port: int = PORT
    """Port of the conductor, 1024-65535."""
    store: str = ""
    """Object store of journal and results, in place of a claim; empty: a claim."""
    store_secret: str = ""
    """Secret of the namespace with the files by which pods reach the store."""
    store_endpoint: str = ""
    """Server that speaks the protocol of S3; empty: Amazon's."""
    store_network: str = ""
    """Network of the store's addresses, for network policies; empty: any."""
    durable: str = ""
    """What replies wait for, of :data:`hpc.kubernetes.object_store.DURABLE`; empty: the default
    of ``conductor serve``."""
    tolerations: tuple[Toleration, ...] = ()
    """Taints that workers tolerate."""
    labels: tuple[tuple[str, str], ...] = ()
    """Labels that the workers' nodes have, of ``--constraint``."""
    queue: str = ""
    """Kueue's local queue, of ``--partition``; empty: jobs start at once."""


def options_of(request: JobRequest) -> KubernetesOptions:
    """The options of a request.

    Raises:
        UsageError: one cannot be used, or the request asks for what Kubernetes does not give.
    """
    _refuse_what_is_elsewhere(request)
    values: dict[str, str] = {}
    tolerations: list[Toleration] = []
    for directive in request.directives:
        name, value = _split(directive)
        if name == "toleration":
            tolerations.append(_toleration(value))
        else:
            _CHECKS[name](name, value)
            values[name.replace("-", "_")] = value
    if len(tolerations) > TOLERATIONS_MAX:
        raise UsageError(f"--toleration: {len(tolerations)} given, at most {TOLERATIONS_MAX}")
    if "image" not in values:
        raise UsageError(
            "--directive=--image=NAME is missing: nodes pull the software as an image, e.g. "
            "registry.example/drivetwin:1; `hpc image context` writes what one is built from"
        )
    port = int(values.pop("port", str(PORT)))
    if request.partition:
        _check(_DNS_LABEL, "a local queue of Kueue, e.g. gpu-queue", "--partition")(
            "--partition", request.partition
        )
    found = KubernetesOptions(
        image=values.pop("image"),
        port=port,
        tolerations=tuple(tolerations),
        labels=_labels(request.constraint),
        queue=request.partition,
    )
    found = replace(found, **values)  # type: ignore[arg-type]  # names and types were checked
    if request.join and (found.store or found.durable):
        name = "store" if found.store else "durable"
        raise UsageError(f"--{name}: the conductor of these workers is elsewhere; leave it away")
    if request.store:
        object_store.check_url("store", request.store)
        found = replace(found, store=request.store)
    object_store.check_together(found)
    if request.records and not (found.store or request.join):
        raise UsageError(
            "recordings (view: record): workers here share no disk with the conductor, so they "
            "would be lost; give --directive=--store=URL, or take them out of the campaign"
        )
    return found


def _refuse_what_is_elsewhere(request: JobRequest) -> None:
    """Say in one line what a pod has no use for, instead of leaving it out silently."""
    elsewhere = [path for path in request.own_paths if not path.startswith(IN_IMAGES)]
    for given, line in (
        (request.container_binds, "--container-bind: pods see no folder of this machine"),
        (request.container_runtime != "apptainer", "--container-runtime: nodes have their own"),
        (request.container, "--container: give --directive=--image=NAME, a name that nodes pull"),
        (request.account, "--account: Kubernetes knows none; --directive=--namespace=NAME"),
        (request.modules, "modules (site file): the image has all software; leave them away"),
        (request.scratch, "--scratch: pods have their own /tmp; leave it away"),
        (request.interface, "--interface: pods meet at a Service; leave it away"),
        (request.address, "--address: pods meet at a Service; leave it away"),
        (request.nodes, "--nodes: the cluster places pods; choose nodes with --constraint"),
        (request.remote_stacks, "autonomy.placement: node: stacks run beside their simulator here"),
        (
            request.drive_records,
            "recording.drive: workers here share no disk with the conductor, and no store has such "
            "records, so they would be lost; take it out of the campaign",
        ),
        (
            request.own_files,
            f"{request.campaign}: names {', '.join(request.own_files[:3])}, which pods do not see; "
            "put them into the image and name their path there in a package of yours",
        ),
        (request.history, "--history: pods see no run of this machine; leave it away"),
        (
            elsewhere,
            f"{', '.join(elsewhere[:3])}: a path of this machine, which pods do not see; put it "
            f"into the image, below {' or '.join(IN_IMAGES)}, and name that path",
        ),
    ):
        if given:
            raise UsageError(line)


def _split(directive: str) -> tuple[str, str]:
    match = re.fullmatch(r"--([a-z-]+)=(.*)", directive)
    if match is None or (match[1] not in _CHECKS and match[1] != "toleration"):
        allowed = ", ".join(f"--{name}=" for name in sorted([*_CHECKS, "toleration"]))
        raise UsageError(f"directive {directive!r}: allowed are {allowed}")
    return match[1], match[2]


def _check(
    pattern: re.Pattern[str], expected: str, shown: str = "", chars_max: int = 253
) -> Callable[[str, str], None]:
    def check(name: str, value: str) -> None:
        if len(value) > chars_max or not pattern.fullmatch(value):
            raise UsageError(f"{shown or f'--{name}'} {value[:80]!r}: expected {expected}")

    return check


def _check_spot(name: str, value: str) -> None:
    if value not in SPOT:
        raise UsageError(f"--{name} {value[:80]!r}: expected one of {', '.join(SPOT)}")


def _check_port(name: str, value: str) -> None:
    if not re.fullmatch(r"[0-9]{4,5}", value) or not 1024 <= int(value) <= 65535:
        raise UsageError(f"--{name} {value[:80]!r}: expected a port, 1024 to 65535")


_NAME = _check(_DNS_NAME, "a name of lower-case letters, digits, - and .")
_CHECKS: dict[str, Callable[[str, str], None]] = {
    "image": _check(
        _IMAGE, "an image, e.g. registry.example/drivetwin:1", chars_max=IMAGE_CHARS_MAX
    ),
    "namespace": _check(_DNS_LABEL, "a namespace, lower-case letters, digits and -"),
    "memory": _check(_QUANTITY, "a quantity, e.g. 8Gi or 512Mi"),
    "storage": _check(_QUANTITY, "a quantity, e.g. 10Gi or 1Ti"),
    "storage-class": _NAME,
    "priority-class": _NAME,
    "pull-secret": _NAME,
    "gpu-resource": _check(_RESOURCE, "an extended resource, e.g. nvidia.com/gpu"),
    "spot": _check_spot,
    "port": _check_port,
    "store": object_store.check_url,
    "store-secret": _NAME,
    "store-endpoint": object_store.check_endpoint,
    "store-network": object_store.check_network,
    "durable": object_store.check_durable,
}


def _toleration(text: str) -> Toleration:
    words, _, effect = text.partition(":")
    key, _, value = words.partition("=")
    if not _KEY.fullmatch(key) or not _VALUE.fullmatch(value) or effect not in ("", *_EFFECTS):
        raise UsageError(
            f"--toleration {text[:80]!r}: expected KEY, KEY=VALUE or KEY=VALUE:EFFECT with an "
            f"effect of {', '.join(_EFFECTS)}"
        )
    return Toleration(key, value, effect)


def _labels(text: str) -> tuple[tuple[str, str], ...]:
    pairs = [part.partition("=") for part in text.split(",")] if text else []
    if len(pairs) > LABELS_MAX:
        raise UsageError(f"--constraint: {len(pairs)} labels given, at most {LABELS_MAX}")
    for key, equal, value in pairs:
        if not equal or not _KEY.fullmatch(key) or not _VALUE.fullmatch(value):
            raise UsageError(
                f"--constraint {text[:80]!r}: expected labels of nodes, LABEL=VALUE with commas "
                "between, e.g. nvidia.com/gpu.product=A100"
            )
    return tuple((key, value) for key, _, value in pairs)
