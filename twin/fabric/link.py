"""What comes in on a session's links, as the kernel counts it.

Zenoh hands over whole messages. One that is too large grows in its memory and is dropped without a
word, so whoever waits for an answer would never learn why there is none.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from collections.abc import Collection, Sequence

_BYTES_RECEIVED = 128
"""Where Linux's ``struct tcp_info`` has ``tcpi_bytes_received``, a uint64."""


def received_bytes(ports: Collection[int]) -> int:
    """Bytes that TCP connections to these ports of this process have brought [bytes].

    0 where the kernel does not say.
    """
    total = 0
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # it may have been closed meanwhile
            descriptor = int(name)
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            found = socket.socket(fileno=descriptor)
            try:
                total += _received(found, ports)
            finally:
                found.detach()  # it is the session's
    return total


def _received(found: socket.socket, ports: Collection[int]) -> int:
    if found.family not in (socket.AF_INET, socket.AF_INET6) or found.type != socket.SOCK_STREAM:
        return 0
    if found.getsockname()[1] not in ports:
        return 0
    info = found.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _BYTES_RECEIVED + 8)
    if len(info) < _BYTES_RECEIVED + 8:
        return 0
    return int(struct.unpack_from("<Q", info, _BYTES_RECEIVED)[0])


class LinkWatch:
    """Compares what the links brought with the messages that came of it."""

    def __init__(self, endpoints: Sequence[str]) -> None:
        """``endpoints``: where the session listens."""
        self._ports = {int(endpoint.rpartition(":")[2]) for endpoint in endpoints}
        self._received = self._arrived = self._excess = 0

    def excess(self, arrived: int) -> int:
        """Bytes that came since a message last arrived, and belong to none [bytes].

        Args:
            arrived: sum of all messages so far [bytes].
        """
        received = received_bytes(self._ports) if self._ports else 0
        came = max(0, received - self._received)  # a connection that was closed counts no more
        messages = arrived - self._arrived
        self._received, self._arrived = received, arrived
        excess = max(0, self._excess + came - messages)
        # Frames and keep-alives of a night are many bytes, too: only what is under way counts.
        self._excess = 0 if messages else excess
        return excess
