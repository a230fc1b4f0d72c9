"""A TCP line between two processes that can be held up, torn, and mended."""

from __future__ import annotations

import contextlib
import socket
import threading


class CutLine:
    """Passes on what comes to :attr:`port`, to another port of this host."""

    def __init__(self, to: int) -> None:
        self._to = to
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._flows = threading.Event()
        self._flows.set()
        self._ends: list[socket.socket] = []
        self._lines: list[threading.Thread] = []
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()

    def hold(self) -> None:
        """Let nothing through, as a network that is down: both ends wait, and nobody is told."""
        self._flows.clear()

    def tear(self) -> None:
        """End every line, as a tunnel that dies or a host that slept; let no new one through."""
        self._flows.clear()
        for end in list(self._ends):
            _shut(end)

    def mend(self) -> None:
        """Let everything through again, what was held as well."""
        self._flows.set()

    def close(self) -> None:
        """End it, and all lines."""
        _shut(self._listener)
        self.tear()
        self.mend()
        self._accepting.join()
        for line in self._lines:
            line.join()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            line = threading.Thread(target=self._join, args=(near,), daemon=True)
            self._lines.append(line)
            line.start()

    def _join(self, near: socket.socket) -> None:
        self._ends.append(near)
        with near, contextlib.suppress(OSError):
            self._flows.wait()
            with socket.create_connection(("127.0.0.1", self._to)) as far:
                self._ends.append(far)
                back = threading.Thread(target=self._copy, args=(far, near), daemon=True)
                back.start()
                self._copy(near, far)
                back.join()

    def _copy(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                self._flows.wait()
                sink.sendall(data)
        _shut(source)
        _shut(sink)


def _shut(end: socket.socket) -> None:
    """End a line for both sides; it may have ended already."""
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
