"""The hub's own port, closed to everybody but its gate.

Rerun's server listens on loopback and takes what anybody on the host sends. A socket filter on its
listening socket drops what does not come from a port that the gate holds.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import struct
import sys
import threading

_LOOPBACK = "127.0.0.1"
_SO_ATTACH_FILTER = 26
_LOAD_SOURCE_PORT = struct.pack("HBBI", 0x28, 0, 0, 0)
_DROP, _TAKE = struct.pack("HBBI", 0x06, 0, 0, 0), struct.pack("HBBI", 0x06, 0, 0, 0xFFFFFFFF)
_IF_EQUAL = 0x15


class InnerPort:
    """A port of this process that only :meth:`connect` reaches."""

    def __init__(self, port: int) -> None:
        """Close the ``port``, on which a socket of this process listens.

        Raises:
            OSError: none does.
        """
        self._port = port
        self._lock = threading.Lock()
        self._held: set[int] = set()
        self._listener = _listener(port) if sys.platform == "linux" else None
        self._filter()
        early_lines = _own(port, listening=False) if self._listener is not None else []
        for early in early_lines:  # who came before the filter
            with contextlib.suppress(OSError):
                early.shutdown(socket.SHUT_RDWR)
            early.close()

    def connect(self) -> socket.socket:
        """A connection to the port; give it back by :meth:`close`.

        Raises:
            OSError: nobody listens any more.
        """
        line = socket.socket()
        try:
            line.bind((_LOOPBACK, 0))
            with self._lock:
                self._held.add(line.getsockname()[1])
                self._filter()
            line.connect((_LOOPBACK, self._port))
        except OSError:
            self.close(line)
            raise
        return line

    def close(self, line: socket.socket) -> None:
        """End a connection; from now on its port may be anybody's."""
        with self._lock:
            with contextlib.suppress(OSError):
                self._held.discard(line.getsockname()[1])
            self._filter()
        line.close()

    def end(self) -> None:
        """Let go of the listening socket."""
        with self._lock:
            if self._listener is not None:
                self._listener.close()
                self._listener = None

    def _filter(self) -> None:
        if self._listener is None:
            return
        ports = sorted(self._held)
        count = len(ports)
        tests = [struct.pack("HBBI", _IF_EQUAL, count - i, 0, p) for i, p in enumerate(ports)]
        program = b"".join([_LOAD_SOURCE_PORT, *tests, _DROP, _TAKE])
        buffer = ctypes.create_string_buffer(program)
        head = struct.pack("HL", len(program) // 8, ctypes.addressof(buffer))
        with contextlib.suppress(OSError):  # the hub has ended
            self._listener.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, head)


def _listener(port: int) -> socket.socket:
    listeners = _own(port, listening=True)
    if not listeners:
        raise OSError(f"nobody listens on port {port}")
    for one in listeners[1:]:
        one.close()
    return listeners[0]


def _own(port: int, *, listening: bool) -> list[socket.socket]:
    """Duplicates of this process's sockets at a loopback port."""
    duplicates = []
    for name in os.listdir("/proc/self/fd"):
        if any(one.fileno() == int(name) for one in duplicates):
            continue  # our duplicate, where the list's own descriptor was
        try:
            descriptor = os.dup(int(name))
        except OSError:
            continue  # gone by now
        try:
            one = socket.socket(fileno=descriptor)
        except OSError:  # no socket, or only the path of one
            os.close(descriptor)
            continue
        try:
            is_listener = bool(one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))
            if one.getsockname() == (_LOOPBACK, port) and is_listener is listening:
                duplicates.append(one)
                continue
        except OSError:
            pass
        one.close()
    return duplicates
