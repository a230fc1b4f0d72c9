"""Turns at the driver for the processes of a run that begin to use a GPU
(:mod:`twin.base.gpu.first_use`).

Those of the first worker of every GPU come first, and so on: all GPUs have work early.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import threading
from collections.abc import Iterator

from twin.base.gpu.first_use import TURN_S, TURNS_VARIABLE
from twin.fabric.rig_folder import PrivateFolder

TURNS = 2
"""Processes that may begin at once: a simulator and its stack."""

GUESTS_MAX = 256
"""Most processes that wait or begin at a time: stacks come here, too, and each has a thread."""

SOCKET_NAME = "turns"
"""Name of the socket in a private folder of the run."""

_PLACE_BYTES_MAX = 16
_PEER = struct.Struct("3i")
"""Layout of what Linux says of the other end of a Unix socket: process, user, group."""


@contextlib.contextmanager
def turns(device: str) -> Iterator[None]:
    """Processes started meanwhile take turns; on a CPU nothing happens."""
    if not device.startswith("cuda"):
        yield
        return
    try:
        # A path: sandboxes without a network of the host reach it where they see its folder.
        folder = PrivateFolder()
    except OSError:
        yield  # it saves time, nothing depends on it
        return
    path = folder.path / SOCKET_NAME
    try:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(path))
            listener.listen(socket.SOMAXCONN)
            queue = Queue(listener)
            os.environ[TURNS_VARIABLE] = str(path)
            try:
                yield
            finally:
                os.environ.pop(TURNS_VARIABLE, None)
                queue.close()
    finally:
        folder.close()


class Queue:
    """Queue of processes that have a turn or wait for one; a thread for each of them, while they
    do."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._changed = threading.Condition()
        self._guests: set[socket.socket] = set()
        self.waiting: set[tuple[int, int]] = set()
        """Place and arrival of each process that waits."""
        self._arrivals = 0
        self._free = TURNS
        self._open = True
        threading.Thread(target=self._welcome, name="turns", daemon=True).start()

    def close(self) -> None:
        """End the queue: nobody waits any more."""
        with self._changed:
            self._open = False
            for end in (self._listener, *self._guests):
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
            self._changed.notify_all()

    def _welcome(self) -> None:
        # Closed; or there is no room for one more, and whoever comes then must not wait for us.
        with contextlib.suppress(OSError, RuntimeError), self._listener:
            while True:
                guest, _ = self._listener.accept()
                threading.Thread(target=self._greet, args=(guest,), daemon=True).start()

    def _greet(self, guest: socket.socket) -> None:
        with guest, contextlib.suppress(OSError, ValueError):
            peer = guest.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
            if _PEER.unpack(peer)[1] != os.getuid():
                return
            guest.settimeout(TURN_S)  # for one that holds its turn, or says nothing
            with self._changed:
                if len(self._guests) >= GUESTS_MAX:
                    return
                self._guests.add(guest)
            try:
                with guest.makefile("rb") as lines:
                    place = int(lines.readline(_PLACE_BYTES_MAX))
                    with self._turn(place):
                        guest.send(b"\n")
                        lines.read()  # until it has begun, or is dead
            finally:
                with self._changed:
                    self._guests.discard(guest)

    @contextlib.contextmanager
    def _turn(self, place: int) -> Iterator[None]:
        with self._changed:
            self._arrivals += 1
            turn = (place, self._arrivals)
            self.waiting.add(turn)
            self._changed.wait_for(
                lambda: not self._open or (self._free and turn == min(self.waiting))
            )
            self.waiting.remove(turn)
            self._free -= 1
            self._changed.notify_all()
        try:
            yield
        finally:
            with self._changed:
                self._free += 1
                self._changed.notify_all()
