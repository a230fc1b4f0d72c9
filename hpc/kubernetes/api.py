"""The API of one namespace, over the official client; whatever it refuses is one line."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hpc.commands import place
from hpc.kubernetes.objects import COMPONENT, INSTANCE, Object
from schemas.escape import escape
from twin.base.errors import InfrastructureError, TwinError, UsageError

if TYPE_CHECKING:
    from kubernetes import client as clients

TIMEOUT_S = 30.0
"""Longest wait for an answer of the API [s]."""
GONE_WAIT_S = 120.0
"""Longest wait for the end of an object that was deleted [s]."""
POLL_S = 0.2
"""How often it is looked whether it is gone [s]."""
PODS_MAX = 4200
"""Most pods of a run that are looked at: every worker's, and as many as failed lately."""

ANSWER_BYTES_MAX = 1 << 28
"""Longest answer of the API [bytes]; 4,200 pods have some tens of MiB."""
MESSAGE_CHARS_MAX = 500
"""Most that is told of the API's reason of a refusal [characters]."""

IN_CLUSTER = "in-cluster"
"""Stands for a context where a pod asks the API of its own cluster."""
OWN_NAMESPACE = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")
"""File that says in a pod which namespace is its own."""

_INTERFACES = {
    "Job": ("BatchV1Api", "job"),
    "Pod": ("CoreV1Api", "pod"),
    "Service": ("CoreV1Api", "service"),
    "Secret": ("CoreV1Api", "secret"),
    "ConfigMap": ("CoreV1Api", "config_map"),
    "PersistentVolumeClaim": ("CoreV1Api", "persistent_volume_claim"),
    "NetworkPolicy": ("NetworkingV1Api", "network_policy"),
}
"""Class of the client, and end of its methods' names, by kind of object."""


class AlreadyThereError(UsageError):
    """An object of that name is there."""


class NotThereError(UsageError):
    """No object of that name is there, or no such namespace."""


class Namespace:
    """Objects of a namespace, as a context of the user's kubeconfig sees them."""

    def __init__(self, context: str = "", name: str = "") -> None:
        """``context``: empty for the current one; ``name``: empty for that of the context,
        or of the pod in which this runs.

        Raises:
            UsageError: the client is not installed, or there is no such context.
        """
        try:
            from kubernetes import client, config
            from kubernetes.config.config_exception import ConfigException
        except ImportError:
            raise UsageError(
                "the Kubernetes client is not installed: pip install 'drivetwin[kubernetes]'"
            ) from None
        configuration = client.Configuration()
        usual = ""
        try:
            if context == IN_CLUSTER or (not context and "KUBERNETES_SERVICE_HOST" in os.environ):
                config.load_incluster_config(client_configuration=configuration)
                self.context = IN_CLUSTER
                if not name:
                    usual = OWN_NAMESPACE.read_text(encoding="utf-8").strip()
            else:
                file = place().kubeconfig or None
                known, current = config.list_kube_config_contexts(config_file=file)
                names = [str(found["name"]) for found in known]
                self.context = context or str(current["name"])
                if self.context not in names:
                    raise UsageError(
                        f"context {self.context}: not in your kubeconfig, which has "
                        f"{', '.join(names)}"
                    )
                usual = known[names.index(self.context)]["context"].get("namespace", "")
                config.load_kube_config(
                    config_file=file,
                    context=self.context,
                    client_configuration=configuration,
                )
        except (ConfigException, OSError, KeyError, TypeError) as error:
            raise UsageError(
                f"no cluster: {error}; set KUBECONFIG to a file that names one"
            ) from None
        if any(char.isspace() for char in self.context):
            raise UsageError(
                f"context {self.context!r}: a name with white space cannot be kept; rename it by "
                "`kubectl config rename-context`"
            )
        configuration.retries = 1
        self._client: clients.ApiClient = bounded(client.ApiClient(configuration))
        self.name = name or usual or "default"

    def create(self, found: Object, *, dry_run: bool = False) -> None:
        """Create an object.

        Raises:
            AlreadyThereError: there is one of its name.
            TwinError: it is refused, or the API is in trouble.
        """
        options = {"dry_run": "All"} if dry_run else {}
        self._call(found["kind"], "create_namespaced", body=found, **options)

    def read(self, kind: str, name: str) -> Any:
        """An object as the client gives it.

        Raises:
            NotThereError: there is none.
            TwinError: it is refused, or the API is in trouble.
        """
        return self._call(kind, "read_namespaced", name)

    def exists(self) -> bool:
        """Whether the namespace is there, as far as one may ask."""
        try:
            with refusals(f"namespace {self.name}"):
                self._interface("CoreV1Api").read_namespace(self.name, _request_timeout=TIMEOUT_S)
        except NotThereError:
            return False
        except UsageError:
            pass
        return True

    def pods(self, run: str) -> list[Any]:
        """Pods of a run, in the order in which they were created."""
        found = self._call(
            "Pod", "list_namespaced", label_selector=f"{INSTANCE}={run}", limit=PODS_MAX
        ).items
        return sorted(found, key=lambda pod: (pod.metadata.creation_timestamp, pod.metadata.name))

    def events(self, name: str) -> list[Any]:
        """Events about an object, the last one last."""
        api = self._interface("CoreV1Api")
        with refusals(f"events of {name}"):
            found = api.list_namespaced_event(
                self.name,
                field_selector=f"involvedObject.name={name}",
                limit=PODS_MAX,
                _request_timeout=TIMEOUT_S,
            ).items
        return sorted(found, key=lambda event: str(event.last_timestamp or ""))

    def nodes(self, wait_s: float) -> list[Any]:
        """Nodes of the cluster; not everybody may see them."""
        with refusals("nodes"):
            found: list[Any] = (
                self._interface("CoreV1Api")
                .list_node(limit=PODS_MAX, _request_timeout=wait_s)
                .items
            )
        return found

    def evict(self, pod: str) -> None:
        """Have the cluster take a pod away, as before the work on its node."""
        body = {"apiVersion": "policy/v1", "kind": "Eviction", "metadata": {"name": pod}}
        with refusals(f"pod {pod}"):
            self._interface("CoreV1Api").create_namespaced_pod_eviction(
                pod, self.name, body, _request_timeout=TIMEOUT_S
            )

    def delete(self, kind: str, name: str, *, wait: bool = False) -> bool:
        """Delete an object and what it made; False: there is none.

        Raises:
            InfrastructureError: ``wait``, and it is still there after minutes.
        """
        try:
            self._call(kind, "delete_namespaced", name, propagation_policy="Foreground")
        except NotThereError:
            return False
        until_s = time.monotonic() + GONE_WAIT_S
        while wait:
            try:
                self.read(kind, name)
            except NotThereError:
                break
            if time.monotonic() > until_s:
                raise InfrastructureError(
                    f"{kind} {name} is still there {GONE_WAIT_S:.0f} s after it was deleted; its "
                    f"pods may be on a lost node: kubectl --namespace {self.name} get pods"
                )
            time.sleep(POLL_S)
        return True

    def exec(self, pod: str, container: str, command: list[str]) -> Any:
        """A running command in a pod: the client's web socket, which gives bytes."""
        from kubernetes.stream import stream

        with refusals(f"pod {pod}"):
            return stream(
                self._interface("CoreV1Api").connect_get_namespaced_pod_exec,
                pod,
                self.name,
                container=container,
                command=command,
                stdin=False,
                stdout=True,
                stderr=True,
                tty=False,
                binary=True,
                _preload_content=False,
                _request_timeout=TIMEOUT_S,
            )

    def _call(self, kind: str, verb: str, *words: str, **options: Any) -> Any:
        interface, end = _INTERFACES[kind]
        method = getattr(self._interface(interface), f"{verb}_{end}")
        found = options.get("body")
        name = found["metadata"]["name"] if found else words[0] if words else ""
        with refusals(f"{kind} {name}".rstrip()):
            return method(*words, namespace=self.name, _request_timeout=TIMEOUT_S, **options)

    def _interface(self, name: str) -> Any:
        from kubernetes import client

        return getattr(client, name)(self._client)


def component_of(pod: Any) -> str:
    """What a pod is in its run; empty: somebody else has made it, or taken its labels."""
    return str((pod.metadata.labels or {}).get(COMPONENT, ""))


@contextmanager
def refusals(what: str) -> Iterator[None]:
    """Turn what the client raises in the block into an error of ours; ``what`` begins its line."""
    import urllib3
    from kubernetes.client.exceptions import ApiException

    try:
        yield
    except ApiException as error:
        raise _refusal(what, error.status or 0, _message(error)) from None
    except _TooLongError:
        raise InfrastructureError(
            f"{what}: the API server's answer is longer than {ANSWER_BYTES_MAX} bytes"
        ) from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # The client builds objects of whatever it is told.
        raise InfrastructureError(
            f"{what}: the API server's answer cannot be read ({type(error).__name__})"
        ) from None
    except (urllib3.exceptions.HTTPError, OSError) as error:
        raise InfrastructureError(
            f"{what}: the API server does not answer ({type(error).__name__}); check the network "
            "and `kubectl cluster-info`, then try again"
        ) from None


def _refusal(what: str, status: int, message: str) -> TwinError:
    if status == 409:
        return AlreadyThereError(f"{what}: {message}")
    if status == 404:
        return NotThereError(f"{what}: {message}")
    if status == 401:
        return UsageError(f"{what}: your credentials are not accepted; log in to the cluster again")
    if status == 403:
        return UsageError(f"{what}: {message}; ask who runs the namespace")
    if 400 <= status < 500 and status != 429:
        return UsageError(f"{what}: refused: {message}")
    return InfrastructureError(f"{what}: the API server is in trouble ({message}); try later")


def _message(error: Any) -> str:
    """What the API says in an answer, escaped on one line."""
    try:
        said = str(json.loads(error.body)["message"])
    except (TypeError, ValueError, LookupError, RecursionError):
        said = str(error.reason or "")
    return escape(said.strip(), MESSAGE_CHARS_MAX) or f"status {error.status}"


class _TooLongError(Exception):
    """An answer is longer than any that makes sense."""


def bounded(found: Any) -> Any:
    """A client that reads no longer answers than :data:`ANSWER_BYTES_MAX`."""
    ask = found.call_api

    def call_api(*words: Any, **options: Any) -> Any:
        response = ask(*words, **options)
        data = response.response.read(ANSWER_BYTES_MAX + 1, decode_content=True)
        if len(data) > ANSWER_BYTES_MAX:
            response.response.close()
            raise _TooLongError
        response.data = data
        return response

    found.call_api = call_api
    return found
