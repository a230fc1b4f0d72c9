"""A real S3 server of its own process, moto's, and a wire to it that breaks as asked."""

from __future__ import annotations

import http.client
import os
import random
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

BUCKET = "results"
FAULTS = ("timeout", "503", "partial write", "stale listing")
"""What a wire can do to a request."""

_SERVER = """
import sys
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server
from twin.base.process import die_with_parent
die_with_parent(sys.argv[1])
server = make_server("127.0.0.1", 0, DomainDispatcherApplication(create_backend_app), threaded=True)
print(server.server_port, flush=True)
server.serve_forever()
"""


def environment(port: int, address: str = "127.0.0.1") -> dict[str, str]:
    """Variables by which a process reaches the store at ``port``."""
    return {
        "AWS_ACCESS_KEY_ID": "tester",
        "AWS_SECRET_ACCESS_KEY": "not-to-be-told",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{address}:{port}",
    }


@contextmanager
def s3_server(log: Path) -> Iterator[int]:
    """A server with an empty bucket; its port on loopback."""
    with log.open("wb") as errors:
        server = subprocess.Popen(
            [sys.executable, "-c", _SERVER, str(os.getpid())],
            stdout=subprocess.PIPE,
            stderr=errors,
        )
        try:
            assert server.stdout is not None
            port = int(server.stdout.readline())
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
            connection.request("PUT", f"/{BUCKET}", headers={"Host": f"127.0.0.1:{port}"})
            assert connection.getresponse().status == 200
            connection.close()
            yield port
        finally:
            server.kill()
            server.communicate()


class Wire:
    """Requests that pass, are counted, and sometimes break.

    ``faults``: name -> share of the requests that it befalls, where it can.
    """

    def __init__(
        self, to_port: int, seed: int = 0, address: str = "127.0.0.1", port: int = 0
    ) -> None:
        self.faults: dict[str, float] = {}
        self.done: Counter[str] = Counter()
        """Faults that befell requests."""
        self.asked: list[tuple[str, str]] = []
        """Method and path of every request."""
        self.down = False
        """Whether nothing is answered at all."""
        self.before: Callable[[str, str], None] = lambda method, path: None
        """Called before a request is passed on."""
        self.first: Callable[[str, str], None] = lambda method, path: None
        """Called before it is drawn what befalls a request."""
        self.stale: tuple[int, list[tuple[str, str]], bytes] | None = None
        """What a stale listing answers; None: what the same one has answered first."""
        self._listings: dict[str, tuple[int, list[tuple[str, str]], bytes]] = {}
        self._dice = random.Random(seed)
        self._lock = threading.Lock()
        self._to_port = to_port
        wire = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_: object) -> None:
                """Quiet."""

            def handle_any(self) -> None:
                wire.pass_on(self)

            do_GET = do_PUT = do_HEAD = do_DELETE = do_POST = handle_any  # noqa: N815

        self._server = ThreadingHTTPServer((address, port), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """End it."""
        self._server.shutdown()
        self._server.server_close()

    def pass_on(self, handler: BaseHTTPRequestHandler) -> None:
        """Pass one request on, or do to it what the dice say."""
        method, path = handler.command, handler.path
        body = handler.rfile.read(int(handler.headers.get("Content-Length") or 0))
        self.first(method, path)
        fault = self._drawn(method, path)
        if self.down:
            self._cut(handler)
            return
        self.before(method, path)
        if fault == "timeout":
            # After the request has arrived or before: the asker cannot tell.
            if self._dice.random() < 0.5:
                self._ask(method, path, handler, body)
            self._cut(handler)
            return
        if fault == "503":
            reply(handler, 503, [], b"<Error><Code>SlowDown</Code></Error>")
            return
        if fault == "stale listing" and (old := self.stale or self._listings.get(path)):
            reply(handler, *old)
            return
        if fault == "partial write":
            body = body[: len(body) // 2]
        status, headers, answer = self._ask(method, path, handler, body)
        if "list-type" in path and status == 200:
            self._listings.setdefault(path, (status, headers, answer))
        reply(handler, status, headers, answer)

    def _drawn(self, method: str, path: str) -> str:
        with self._lock:
            self.asked.append((method, path))
            for name, share in self.faults.items():
                fits = {
                    "partial write": method == "PUT",
                    "stale listing": "list-type" in path,
                }.get(name, True)
                # Each befalls the first request that it may spoil: tests wait for no chance.
                first = not self.done[name] and (name != "partial write" or "/objects/" in path)
                if fits and share > 0.0 and (first or self._dice.random() < share):
                    self.done[name] += 1
                    return name
        return ""

    def _ask(
        self, method: str, path: str, handler: BaseHTTPRequestHandler, body: bytes
    ) -> tuple[int, list[tuple[str, str]], bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self._to_port, timeout=60)
        headers = {k: v for k, v in handler.headers.items() if k.lower() != "expect"}
        headers["Content-Length"] = str(len(body))
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            answer = response.read()
            return response.status, response.getheaders(), answer
        finally:
            connection.close()

    def _cut(self, handler: BaseHTTPRequestHandler) -> None:
        handler.close_connection = True
        handler.connection.shutdown(socket.SHUT_RDWR)


def reply(
    handler: BaseHTTPRequestHandler, status: int, headers: list[tuple[str, str]], body: bytes
) -> None:
    """Answer a request."""
    handler.send_response(status)
    length = str(len(body))
    for name, value in headers:
        if name.lower() == "content-length" and handler.command == "HEAD":
            length = value
        elif name.lower() not in ("content-length", "transfer-encoding", "connection"):
            handler.send_header(name, value)
    handler.send_header("Content-Length", length)
    handler.end_headers()
    if handler.command != "HEAD":
        handler.wfile.write(body)


@contextmanager
def broken_wire(to_port: int, seed: int = 0) -> Iterator[Wire]:
    """A :class:`Wire` for the block."""
    wire = Wire(to_port, seed)
    try:
        yield wire
    finally:
        wire.close()


@contextmanager
def reached_by(port: int) -> Iterator[str]:
    """This process reaches the store at ``port`` while the block lasts; the store's URL."""
    before = dict(os.environ)
    os.environ.update(environment(port))
    try:
        yield f"s3://{BUCKET}/run"
    finally:
        os.environ.clear()
        os.environ.update(before)


def objects_asked(wire: Wire, method: str = "GET") -> list[str]:
    """Names of objects that were asked for, in order."""
    paths = [urlsplit(path) for verb, path in wire.asked if verb == method]
    prefix = f"/{BUCKET}/run/"
    return [u.path[len(prefix) :] for u in paths if u.path.startswith(prefix) and not _lists(u)]


def _lists(url: object) -> bool:
    return "list-type" in parse_qs(getattr(url, "query", ""))
