"""What pods of ours are held to: the restricted Pod Security Standard, and more of our own.

Source of the restricted profile: https://kubernetes.io/docs/concepts/security/pod-security-standards/
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

VOLUMES = {
    *("configMap", "csi", "downwardAPI", "emptyDir", "ephemeral", "persistentVolumeClaim"),
    *("projected", "secret"),
}
"""Types of volumes that the restricted profile allows."""


def restricted(pod: dict[str, Any]) -> list[str]:
    """How a pod's spec breaks the restricted profile, a line each."""
    return list(_restricted(pod))


def violations(pod: dict[str, Any]) -> list[str]:
    """The same, and how it breaks rules of ours."""
    return [*_restricted(pod), *_ours(pod)]


def containers(pod: dict[str, Any]) -> list[dict[str, Any]]:
    """All containers of a pod's spec."""
    return [*pod.get("initContainers", ()), *pod["containers"]]


def _restricted(pod: dict[str, Any]) -> Iterator[str]:
    for name in ("hostNetwork", "hostPID", "hostIPC"):
        if pod.get(name):
            yield f"{name}: the host's"
    for volume in pod.get("volumes", ()):
        if not set(volume) - {"name"} <= VOLUMES:
            yield f"volume {volume['name']}: a type that is not allowed"
    whole = pod.get("securityContext", {})
    for container in containers(pod):
        own = container.get("securityContext", {})
        name = container["name"]
        if not own.get("runAsNonRoot", whole.get("runAsNonRoot")):
            yield f"{name}: may be root"
        if own.get("runAsUser", whole.get("runAsUser")) == 0:
            yield f"{name}: is root"
        if own.get("allowPrivilegeEscalation") is not False or own.get("privileged"):
            yield f"{name}: may gain rights"
        capabilities = own.get("capabilities", {})
        if capabilities.get("drop") != ["ALL"]:
            yield f"{name}: keeps capabilities"
        if set(capabilities.get("add", ())) - {"NET_BIND_SERVICE"}:
            yield f"{name}: adds capabilities"
        profile = own.get("seccompProfile", whole.get("seccompProfile", {}))
        if profile.get("type") not in ("RuntimeDefault", "Localhost"):
            yield f"{name}: no seccomp profile"


def _ours(pod: dict[str, Any]) -> Iterator[str]:
    if pod.get("automountServiceAccountToken") is not False:
        yield "a token of the API is mounted"
    if pod.get("enableServiceLinks") is not False:
        yield "variables name every service of the namespace"
    if not pod.get("activeDeadlineSeconds"):
        yield "it may run for ever"
    for container in containers(pod):
        name = container["name"]
        if not container.get("securityContext", {}).get("readOnlyRootFilesystem"):
            yield f"{name}: writes its root"
        limits = container.get("resources", {}).get("limits", {})
        if not {"cpu", "memory"} <= set(limits):
            yield f"{name}: no limits"
        for variable in container.get("env", ()):
            if "valueFrom" in variable:
                yield f"{name}: variable {variable['name']} may hold a secret"
        if container.get("envFrom"):
            yield f"{name}: variables may hold secrets"
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        if name != "key" and "secret" in mounted:
            yield f"{name}: sees the Secret itself"
