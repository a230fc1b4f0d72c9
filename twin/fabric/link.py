"""What comes in on a session's links, as the kernel counts it.

Zenoh hands over whole messages. One that is too large grows in its memory and is dropped without a
word, so whoever waits for an answer would never learn why there is none.

The kernel counts the bytes of TCP connections. Of Unix sockets it counts none, neither in their
options nor in ``/proc/self/io``; there the processor time of Zenoh's reading threads is taken.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from collections.abc import Collection, Sequence
from pathlib import Path

from twin.fabric.endpoint import is_socket

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
            connection = socket.socket(fileno=descriptor)
            try:
                total += _received(connection, ports)
            finally:
                connection.detach()  # it is the session's
    return total


def _received(connection: socket.socket, ports: Collection[int]) -> int:
    if (
        connection.family not in (socket.AF_INET, socket.AF_INET6)
        or connection.type != socket.SOCK_STREAM
    ):
        return 0
    if connection.getsockname()[1] not in ports:
        return 0
    info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _BYTES_RECEIVED + 8)
    if len(info) < _BYTES_RECEIVED + 8:
        return 0
    return int(struct.unpack_from("<Q", info, _BYTES_RECEIVED)[0])


class LinkWatch:
    """Compares what the links brought with the messages that came of it."""

    def __init__(self, endpoints: Sequence[str]) -> None:
        """Count from zero; ``endpoints``: where the session listens."""
        self._ports = {int(e.rpartition(":")[2]) for e in endpoints if not is_socket(e)}
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


READING_S = 0.1
"""Processor time that Zenoh's threads may read for without a message coming of it: that of some
100 MB, or of seven of the largest messages [s]."""

IDLE_SHARE = 0.002
"""Share of the time that they take for keeping a session alive [-]."""

MESSAGE_S = 0.001
"""More than what they take for a usual message [s]."""


class ReadingWatch:
    """Compares how long Zenoh has read during one wait with the messages that came of it.

    Its threads serve all sessions of a process, so nothing is compared across two waits.
    """

    def __init__(self) -> None:
        self._is_reader: dict[str, bool] = {}
        self._fresh = True
        self._since_s, self._read_s, self._messages = 0.0, 0.0, 0
        """Time at which a message last arrived, and what had been read and had arrived by then."""

    def begin(self) -> None:
        """Another wait begins."""
        self._fresh = True

    def is_in_vain(self, messages: int, now_s: float) -> bool:
        """Whether it has read for too long since a message last arrived.

        Args:
            messages: that have arrived so far.
            now_s: by a clock that is not set [s].
        """
        read_s = self.reading_s()
        arrived = messages - self._messages
        useful_s = MESSAGE_S * arrived + IDLE_SHARE * (now_s - self._since_s)
        in_vain = not self._fresh and read_s - self._read_s > READING_S + useful_s
        if arrived or self._fresh:
            self._since_s, self._read_s, self._messages = now_s, read_s, messages
            self._fresh = False
        return in_vain

    def reading_s(self) -> float:
        """Processor time that Zenoh's reading threads of this process have taken [s]."""
        total = 0
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(OSError, ValueError):  # it may have ended meanwhile
                if thread not in self._is_reader:
                    name = Path(f"/proc/self/task/{thread}/comm").read_bytes()
                    self._is_reader[thread] = name.startswith(b"rx-")
                if self._is_reader[thread]:
                    schedstat = Path(f"/proc/self/task/{thread}/schedstat").read_bytes()
                    total += int(schedstat.split()[0])
        return total / 1e9
