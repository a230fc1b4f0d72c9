"""A double of the Kubernetes API: the part that ``hpc`` and its tests ask, over HTTP.

Objects are checked by the strict schemas of ``kubernetes-validate`` and pods by the restricted Pod
Security Standard, as an API server with that admission would. What makes objects work, Jobs and a
kubelet, is in :mod:`kube_cluster`.
"""

from __future__ import annotations

import base64
import copy
import hashlib
import json
import re
import struct
import subprocess
import threading
import time
import urllib.parse
import uuid
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import kubernetes_validate
from kube_policy import restricted

VERSION = "1.37"
"""Version of the schemas."""
KINDS = {
    "jobs": "Job",
    "pods": "Pod",
    "services": "Service",
    "secrets": "Secret",
    "configmaps": "ConfigMap",
    "persistentvolumeclaims": "PersistentVolumeClaim",
    "networkpolicies": "NetworkPolicy",
    "events": "Event",
}
PLURALS = {kind: plural for plural, kind in KINDS.items()}
GROUPS = {"jobs": "jobs.batch", "networkpolicies": "networkpolicies.networking.k8s.io"}

_PATH = re.compile(
    r"/(?:api|apis/[a-z0-9.]+)/v1/namespaces/(?P<namespace>[a-z0-9-]+)"
    r"/(?P<plural>[a-z]+)(?:/(?P<name>[^/]+)(?:/(?P<part>log|exec|eviction))?)?"
)
_NAMESPACE = re.compile(r"/api/v1/namespaces/(?P<namespace>[a-z0-9-]+)")

Object = dict[str, Any]


class RefusalError(Exception):
    """An answer that is no success."""

    def __init__(self, code: int, reason: str, message: str) -> None:
        super().__init__(message)
        self.code, self.reason, self.message = code, reason, message

    def body(self) -> Object:
        """As the API says it."""
        said = {"message": self.message, "reason": self.reason, "code": self.code}
        return {"kind": "Status", "apiVersion": "v1", "status": "Failure", **said}


class Store:
    """Objects by plural, namespace and name, each with its history."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self.namespaces = {"default", "robots"}
        self.objects: dict[tuple[str, str, str], Object] = {}
        self.history: list[tuple[str, str, Object]] = []
        self.pods_max: int | None = None
        """Quota of pods of a namespace."""

    def create(self, plural: str, namespace: str, given: Object, *, dry_run: bool) -> Object:
        """Admit an object."""
        with self.lock:
            if namespace not in self.namespaces:
                raise RefusalError(404, "NotFound", f'namespaces "{namespace}" not found')
            found = copy.deepcopy(given)
            name = found["metadata"]["name"]
            if found["metadata"].setdefault("namespace", namespace) != namespace:
                raise RefusalError(400, "BadRequest", "the namespace of the object is another one")
            self._check(plural, namespace, found)
            if (plural, namespace, name) in self.objects:
                message = f'{GROUPS.get(plural, plural)} "{name}" already exists'
                raise RefusalError(409, "AlreadyExists", message)
            now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            found["metadata"] |= {"uid": str(uuid.uuid4()), "creationTimestamp": now}
            found.setdefault("status", {})
            if not dry_run:
                self.put(plural, found, "ADDED")
            return found

    def _check(self, plural: str, namespace: str, found: Object) -> None:
        if plural == "events":
            return
        try:
            kubernetes_validate.validate(found, VERSION, strict=True)
        except kubernetes_validate.ValidationError as error:
            message = str(error).splitlines()[0]
            raise RefusalError(422, "Invalid", f"{found['kind']} is invalid: {message}") from None
        if plural == "pods":
            if wrong := restricted(found["spec"]):
                message = f'violates PodSecurity "restricted": {"; ".join(wrong)}'
                raise RefusalError(403, "Forbidden", f"pods is forbidden: {message}")
            if self.pods_max is not None and len(self.list("pods", namespace)) >= self.pods_max:
                message = f"exceeded quota: compute, used: pods={self.pods_max}"
                raise RefusalError(403, "Forbidden", f"pods is forbidden: {message}")

    def put(self, plural: str, found: Object, event: str = "MODIFIED") -> None:
        """Keep an object as it is now."""
        with self.changed:
            place = (plural, found["metadata"]["namespace"], found["metadata"]["name"])
            if event == "MODIFIED" and place not in self.objects:
                return  # it was removed meanwhile
            self.history.append((event, plural, found))
            found["metadata"]["resourceVersion"] = str(len(self.history))
            if event == "DELETED":
                self.objects.pop(place, None)
            else:
                self.objects[place] = found
            self.history[-1] = (event, plural, copy.deepcopy(found))
            self.changed.notify_all()

    def read(self, plural: str, namespace: str, name: str) -> Object:
        """The object itself, for whoever holds the lock."""
        try:
            return self.objects[plural, namespace, name]
        except KeyError:
            message = f'{GROUPS.get(plural, plural)} "{name}" not found'
            raise RefusalError(404, "NotFound", message) from None

    def list(self, plural: str, namespace: str = "", labels: str = "") -> list[Object]:
        """Objects themselves, in the order in which they were made."""
        wanted = dict(part.split("=", 1) for part in labels.split(",")) if labels else {}
        return [
            found
            for (kind, place, _), found in self.objects.items()
            if kind == plural
            and namespace in ("", place)
            and wanted.items() <= found["metadata"].get("labels", {}).items()
        ]

    def event(self, namespace: str, about: str, reason: str, message: str) -> None:
        """A warning about an object."""
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        found = {
            "apiVersion": "v1",
            "kind": "Event",
            "metadata": {"name": f"{about}.{uuid.uuid4().hex[:12]}", "namespace": namespace},
            "involvedObject": {"name": about},
            "type": "Warning",
            "reason": reason,
            "message": message,
            "lastTimestamp": now,
        }
        if namespace in self.namespaces:
            self.put("events", found, "ADDED")


class Api(ThreadingHTTPServer):
    """Serves a store at :attr:`url`."""

    daemon_threads = True

    def __init__(self, store: Store) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.store = store
        self.tokens = {"admin": {"GET", "POST", "DELETE", "PATCH"}, "looker": {"GET"}}
        """What the holder of a token may do."""
        self.refuses: set[str] = set()
        """What a quota refuses, but in a dry run, as quotas of others may change meanwhile."""
        self.in_trouble = False
        """Answer 503 to everything."""
        self.delete: Callable[[str, str, str], None] = lambda *_: None
        self.evict: Callable[[str, str], None] = lambda *_: None
        self.delete_namespace: Callable[[str], None] = lambda _: None
        self.log: Callable[[str, str], bytes] = lambda *_: b""
        self.run_in: Callable[[str, str, str, list[str]], list[str]] = lambda *_: []
        self.nodes: Callable[[], list[Object]] = list
        self.url = f"http://127.0.0.1:{self.server_address[1]}"

    def kubeconfig(self, token: str = "admin", namespace: str = "robots") -> Object:
        """A kubeconfig for the holder of ``token``."""
        context = {"cluster": "double", "user": token, "namespace": namespace}
        return {
            "apiVersion": "v1",
            "kind": "Config",
            "current-context": "double",
            "clusters": [{"name": "double", "cluster": {"server": self.url}}],
            "users": [{"name": token, "user": {"token": token}}],
            "contexts": [{"name": "double", "context": context}],
        }


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Api

    def log_message(self, *_: Any) -> None:
        """Nobody reads it."""

    def do_GET(self) -> None:
        self._answer("GET")

    def do_POST(self) -> None:
        self._answer("POST")

    def do_PATCH(self) -> None:
        self._answer("PATCH")

    def do_DELETE(self) -> None:
        self._answer("DELETE")

    def _answer(self, verb: str) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        body = json.loads(self.rfile.read(length) or b"null")
        path, _, query = self.path.partition("?")
        options = dict(urllib.parse.parse_qsl(query))
        try:
            self._authorize(verb)
            if options.get("watch"):
                self._watch(path, options)
                return
            if path.endswith("/exec"):
                self._exec(path, urllib.parse.parse_qs(query))
                return
            found = self._carry_out(verb, path, options, body)
        except RefusalError as refusal:
            self._send(refusal.code, json.dumps(refusal.body()).encode())
            return
        plain = isinstance(found, bytes)
        self._send(200, found if plain else json.dumps(found).encode(), plain=plain)

    def _authorize(self, verb: str) -> None:
        if self.server.in_trouble:
            raise RefusalError(503, "ServiceUnavailable", "etcdserver: leader changed")
        token = self.headers.get("Authorization", "").removeprefix("Bearer ")
        if token not in self.server.tokens:
            raise RefusalError(401, "Unauthorized", "Unauthorized")
        if verb not in self.server.tokens[token]:
            message = f'User "{token}" cannot create resource in the namespace "robots"'
            raise RefusalError(403, "Forbidden", message)

    def _carry_out(self, verb: str, path: str, options: dict[str, str], body: Any) -> Any:
        server, store = self.server, self.server.store
        if path == "/api/v1/nodes":
            return {"kind": "NodeList", "apiVersion": "v1", "items": server.nodes()}
        if match := _NAMESPACE.fullmatch(path):
            name = match["namespace"]
            if name not in store.namespaces:
                raise RefusalError(404, "NotFound", f'namespaces "{name}" not found')
            if verb == "DELETE":
                server.delete_namespace(name)
            return {"kind": "Namespace", "apiVersion": "v1", "metadata": {"name": name}}
        match = _PATH.fullmatch(path)
        if match is None or match["plural"] not in KINDS:
            raise RefusalError(404, "NotFound", "the server could not find the requested resource")
        plural, namespace, name = match["plural"], match["namespace"], match["name"]
        if match["part"] == "log":
            return server.log(namespace, name)
        if match["part"] == "eviction":
            server.evict(namespace, name)
            return {"kind": "Status", "apiVersion": "v1", "status": "Success"}
        if verb == "POST":
            dry_run = options.get("dryRun") == "All"
            if plural in server.refuses and not dry_run:
                message = f"exceeded quota: count/{GROUPS.get(plural, plural)}"
                raise RefusalError(403, "Forbidden", message)
            return store.create(plural, namespace, body, dry_run=dry_run)
        with store.lock:
            if name is None:
                items = store.list(plural, namespace, options.get("labelSelector", ""))
                about = options.get("fieldSelector", "").removeprefix("involvedObject.name=")
                items = [i for i in items if not about or i["involvedObject"]["name"] == about]
                kind = f"{KINDS[plural]}List"
                version = "batch/v1" if plural == "jobs" else "v1"
                return {"kind": kind, "apiVersion": version, "items": copy.deepcopy(items)}
            found = store.read(plural, namespace, name)
            if verb == "PATCH":
                _merge(found, body)
                store.put(plural, found)
            found = copy.deepcopy(found)
        if verb == "DELETE":
            server.delete(plural, namespace, name)
        return found

    def _watch(self, path: str, options: dict[str, str]) -> None:
        """Changes from ``resourceVersion`` on, until the time that was asked for is over."""
        match = _PATH.fullmatch(path)
        assert match is not None
        store = self.server.store
        until_s = time.monotonic() + float(options.get("timeoutSeconds", "60"))
        seen = int(options.get("resourceVersion", "0"))
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Transfer-Encoding", "chunked")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        while time.monotonic() < until_s:
            with store.changed:
                if len(store.history) == seen:
                    store.changed.wait(0.5)
                changes = store.history[seen:]
                seen = len(store.history)
            for event, plural, found in changes:
                if plural == match["plural"]:
                    line = json.dumps({"type": event, "object": found}).encode() + b"\n"
                    try:
                        self.wfile.write(b"%x\r\n%s\r\n" % (len(line), line))
                    except OSError:
                        return
        self.wfile.write(b"0\r\n\r\n")

    def _exec(self, path: str, query: dict[str, list[str]]) -> None:
        """A command in a pod, over a web socket (RFC 6455, subprotocol v4.channel.k8s.io)."""
        match = _PATH.fullmatch(path)
        assert match is not None
        words = self.server.run_in(
            match["namespace"], match["name"], query["container"][0], query["command"]
        )
        key = self.headers["Sec-WebSocket-Key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
        self.send_response(101)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        accept = base64.b64encode(hashlib.sha1(key.encode()).digest()).decode()
        self.send_header("Sec-WebSocket-Accept", accept)
        self.send_header("Sec-WebSocket-Protocol", "v4.channel.k8s.io")
        self.end_headers()
        self.close_connection = True
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
            assert child.stdout is not None
            assert child.stderr is not None
            for part in iter(lambda: child.stdout.read(1 << 16), b""):  # type: ignore[union-attr]
                self.wfile.write(_frame(b"\x01" + part))
            if said := child.stderr.read():
                self.wfile.write(_frame(b"\x02" + said))
        ended: Object = {"status": "Success"}
        if child.returncode:
            cause = {"reason": "ExitCode", "message": str(child.returncode)}
            ended = {"status": "Failure", "reason": "NonZeroExitCode"}
            ended["details"] = {"causes": [cause]}
        self.wfile.write(_frame(b"\x03" + json.dumps(ended).encode()))
        self.wfile.write(_frame(b"", 0x8))

    def _send(self, code: int, data: bytes, *, plain: bool = False) -> None:
        self.send_response(code)
        self.send_header("Content-Type", "text/plain" if plain else "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


def _frame(data: bytes, kind: int = 0x2) -> bytes:
    """A web socket's frame from a server, which masks nothing."""
    head = bytes([0x80 | kind])
    if len(data) < 126:
        return head + bytes([len(data)]) + data
    if len(data) < 1 << 16:
        return head + b"\x7e" + struct.pack(">H", len(data)) + data
    return head + b"\x7f" + struct.pack(">Q", len(data)) + data


def _merge(found: Object, patch: Object) -> None:
    """JSON merge patch."""
    for key, value in patch.items():
        if value is None:
            found.pop(key, None)
        elif isinstance(value, dict) and isinstance(found.get(key), dict):
            _merge(found[key], value)
        else:
            found[key] = value


def conditions(found: Object) -> Iterator[str]:
    """Types of an object's conditions that hold."""
    for condition in found["status"].get("conditions", ()):
        if condition["status"] == "True":
            yield condition["type"]
