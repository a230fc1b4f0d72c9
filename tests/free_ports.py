"""Ports that a test hands out before anybody listens there."""

from __future__ import annotations

import contextlib
import secrets
import socket
from collections.abc import Iterator

PORTS = range(20000, 32768)
"""Below those that the system gives to whoever asks for any."""


def free_port(*others: int) -> int:
    """A port that is free now, and none of ``others``, for a server that takes no port over from
    :func:`reserved_port`: the system gives it to nobody else before the server is there."""
    while True:
        port = secrets.choice(PORTS)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            if port not in others:
                return port


@contextlib.contextmanager
def reserved_port() -> Iterator[int]:
    """A port of loopback that nobody answers at, and that the system gives nobody else: whoever is
    told its number can listen there, more than once, as servers do (``SO_REUSEADDR``)."""
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        port: int = holder.getsockname()[1]
        yield port
