"""The gate before the hub: other clients stay outside, and a viewer that stops reading is shown out
while others wait for it.

Rerun's server hands all viewers the same stream and waits for the slowest. No socket shows which
that is: what a viewer may be sent is limited one layer above. But when the stream stands still,
those who read have come further than the one that does not.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from urllib.parse import urlsplit

from twin.fabric.loopback import is_ours, is_own_name
from viewer.live.inner_port import InnerPort

LAG_S = 1.0
"""A viewer whose latest bytes are so much older than those of another lags behind [s]."""
LEAST_BYTES = 1 << 16
"""A client that has been sent less is no viewer of the stream [bytes]."""
PIECE_BYTES = 1 << 16
HEAD_BYTES_MAX = 1 << 16
"""Largest head of a request [bytes]."""
HEAD_S = 10.0
"""Longest time a request's head may take to come [s]."""
NATIVE = b"PRI * HTTP/2.0\r\n"
"""First bytes of native viewers. Browsers speak no HTTP/2 without TLS, so no page sends it."""
REFUSED = b"HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
LINES_MAX = 64
"""Most lines at the same time; browsers need one per page."""


@dataclass(slots=True, eq=False)
class ViewerLine:
    """The connection of one viewer."""

    viewer: socket.socket
    passed_bytes: int = 0
    """Amount sent from the hub to the viewer so far [bytes]."""
    passed_s: float = 0.0
    """Time at which the latest bytes were sent [s]."""


def laggards(lines: Collection[ViewerLine]) -> list[ViewerLine]:
    """Viewers of one stream that stands still that have not come as far as others."""
    reading = [line for line in lines if line.passed_bytes >= LEAST_BYTES]
    newest_s = max((line.passed_s for line in reading), default=0.0)
    return [line for line in reading if newest_s - line.passed_s > LAG_S]


class Gate:
    """Passes on what this user's viewers send to a loopback port, a line per viewer."""

    def __init__(self, port: int, say: Callable[[str], None]) -> None:
        """Listen for viewers.

        Args:
            port: where viewers come; 0: a free one.
            say: takes a line for people.

        Raises:
            OSError: the port is in use.
        """
        self._say = say
        self._lock = threading.Lock()
        self._lines: set[ViewerLine] = set()
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port: int = self._listener.getsockname()[1]

    def serve(self, hub: InnerPort) -> None:
        """Let viewers in; those that have come wait until then."""
        threading.Thread(target=self._accept, args=(hub,), name="gate", daemon=True).start()

    def relieve(self) -> None:
        """The stream stands still: cut off whoever holds the others up."""
        with self._lock:
            slow = laggards(self._lines)
            self._lines.difference_update(slow)
        for line in slow:
            _hang_up(line.viewer)
            self._say("a viewer that does not read was cut off, because others waited for it")

    def close(self) -> None:
        """Let nobody in any more, and everybody out."""
        # A thread that waits in accept is woken by this only.
        _hang_up(self._listener)
        self._listener.close()
        with self._lock:
            lines = list(self._lines)
        for line in lines:
            _hang_up(line.viewer)

    def _accept(self, hub: InnerPort) -> None:
        while True:
            try:
                viewer, _ = self._listener.accept()
            except OSError:
                return
            if not is_ours(viewer):
                with contextlib.suppress(OSError):
                    viewer.sendall(REFUSED + b"this hub belongs to another user\n")
                viewer.close()
                continue
            ends = viewer, hub
            threading.Thread(target=self._serve, args=ends, name="line", daemon=True).start()

    def _serve(self, viewer: socket.socket, inner: InnerPort) -> None:
        line = ViewerLine(viewer)
        try:
            with self._lock:
                if len(self._lines) >= LINES_MAX:
                    return
                self._lines.add(line)
            begin, why = _welcome(viewer)
            if why:
                viewer.sendall(REFUSED + why.encode() + b"\n")
                return
            hub = inner.connect()
            try:
                hub.sendall(begin)
                threading.Thread(target=_upwards, args=(viewer, hub), daemon=True).start()
                while data := hub.recv(PIECE_BYTES):
                    viewer.sendall(data)
                    line.passed_bytes += len(data)
                    line.passed_s = time.monotonic()
            finally:
                inner.close(hub)
        except OSError:
            pass  # either side has gone
        finally:
            with self._lock:
                self._lines.discard(line)
            _hang_up(viewer)
            viewer.close()


def _welcome(viewer: socket.socket) -> tuple[bytes, str]:
    """What a viewer has sent first, and why it is not let in; empty: it is.

    A page of another site reaches loopback under a name of its own, and would read what is shown.
    """
    viewer.settimeout(HEAD_S)
    begin = b""
    while not begin.startswith(NATIVE) and b"\r\n\r\n" not in begin:
        data = viewer.recv(PIECE_BYTES)
        begin += data
        if not data or len(begin) > HEAD_BYTES_MAX:
            return begin, "no request"
    viewer.settimeout(None)
    if begin.startswith(NATIVE):
        return begin, ""
    head = begin.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")[1:]
    fields = [line.partition(":") for line in head]
    hosts = [value.strip() for name, _, value in fields if name.strip().lower() == "host"]
    origins = [value.strip() for name, _, value in fields if name.strip().lower() == "origin"]
    if len(hosts) != 1 or not is_own_name(hosts[0]):
        return begin, "ask for localhost"
    if any(not is_own_name(urlsplit(origin).netloc) for origin in origins):
        return begin, "asked by a page of another site"
    return begin, ""


def _upwards(viewer: socket.socket, hub: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := viewer.recv(PIECE_BYTES):
            hub.sendall(data)
    _hang_up(hub)


def _hang_up(line: socket.socket) -> None:
    with contextlib.suppress(OSError):
        line.shutdown(socket.SHUT_RDWR)
