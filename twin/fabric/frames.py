"""A frame buffer that two processes of one host share without leaving anything behind.

The buffer is a memfd: it has no name in the file system, so it is gone with its last user, however
that one died. Its descriptor is handed out over a Unix socket in the rig's folder, and sealed: who
gets it can map it for reading, and nobody can change its size. The other process proves by a nonce
in the first bytes that it sees the same memory; if it cannot, frames travel as payload.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import os
import secrets
import socket
import struct
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER_BYTES = 64
"""Bytes before the first frame; the nonce stands there. Keeps frames aligned."""

PEERS_MAX = 8
"""Most that are handed the descriptor: a stack, and what it started before it was ready."""

HAND_OUT_S = 2.0
"""Longest time to take it [s]."""

_SEAL, _SHRINK, _GROW, _FUTURE_WRITE = 0x1, 0x2, 0x4, 0x10
"""``F_SEAL_*`` of Linux; of the last, mappings made before stay writable, and no others are."""


@dataclass(frozen=True, slots=True)
class FrameChannel:
    """An array that a simulator writes at every frame of a sensor."""

    name: str
    """Name of the sensor message."""
    shape: tuple[int, ...]
    dtype: str
    """Little-endian, as NumPy writes it (``|u1``, ``<f4``)."""

    @property
    def size(self) -> int:
        """Size of a frame [bytes]."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


def lay_out(channels: Sequence[FrameChannel]) -> tuple[dict[str, int], int]:
    """Offset of each channel in one buffer, aligned, and the size of the buffer [bytes]."""
    offsets, size = {}, 0
    for channel in channels:
        offsets[channel.name] = size
        size += -(-channel.size // HEADER_BYTES) * HEADER_BYTES
    return offsets, size


class FrameBuffer:
    """A shared buffer of ``size`` bytes behind the header, and the socket that hands it out."""

    def __init__(self, size: int, place: Path) -> None:
        """Create the buffer (simulator side).

        Args:
            size: of the frames [bytes].
            place: path of the Unix socket to make.

        Raises:
            OSError: the system has no memory, file, descriptor or seals for it.
        """
        self.size = size
        self.nonce = secrets.token_hex(16)
        self.path = str(place)
        """Socket at which processes of the same user on this host get the descriptor."""
        self._listener: socket.socket | None = None
        self._fd = os.memfd_create("twin-frames", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(self._fd, HEADER_BYTES + size)
            self._map = mmap.mmap(self._fd, HEADER_BYTES + size)
            _seal(self._fd, _SEAL | _SHRINK | _GROW | _FUTURE_WRITE)
            self._listener = _listening(self.path)
        except OSError:
            self.close()
            raise
        self._map[: len(self.nonce)] = self.nonce.encode()
        threading.Thread(
            target=self._hand_out, args=[self._listener], name="frames", daemon=True
        ).start()

    def _hand_out(self, listener: socket.socket) -> None:
        """Give the same user's first few processes the descriptor, until the socket is shut."""
        for _ in range(PEERS_MAX):
            try:
                peer, _ = listener.accept()
            except OSError:  # it was shut
                return
            with peer, contextlib.suppress(OSError):
                peer.settimeout(HAND_OUT_S)
                if _user_of(peer) == os.geteuid():
                    socket.send_fds(peer, [b"frames"], [self._fd])

    def shut(self) -> None:
        """Hand the descriptor to no further process."""
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)  # wakes who waits there
            self._listener.close()
            self._listener = None
            Path(self.path).unlink(missing_ok=True)

    def array(self, channel: FrameChannel, offset: int) -> NDArray[Any]:
        """The channel's array; it begins at ``offset`` [bytes]."""
        count = math.prod(channel.shape)
        flat: NDArray[Any] = np.frombuffer(self._map, channel.dtype, count, HEADER_BYTES + offset)
        return flat.reshape(channel.shape)

    def close(self) -> None:
        """Forget the buffer; arrays made of it stay valid until they are freed."""
        self.shut()
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _listening(path: str) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    try:
        listener.bind(path)
        listener.listen(PEERS_MAX)
    except OSError:
        listener.close()
        raise
    return listener


def _user_of(peer: socket.socket) -> int:
    """User id of the process at the other end, as the kernel says."""
    size = struct.calcsize("3i")
    credentials = peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    return int(struct.unpack("3i", credentials)[1])


def offer_frames(size: int, path: Path) -> FrameBuffer | None:
    """A buffer, or None where the system grants none: then frames travel as payload."""
    try:
        return FrameBuffer(size, path)
    except OSError:
        return None


def _seal(fd: int, seals: int) -> None:
    import fcntl  # not everywhere where the fabric is

    fcntl.fcntl(fd, fcntl.F_ADD_SEALS, seals)


def _seals(fd: int) -> int:
    import fcntl

    return fcntl.fcntl(fd, fcntl.F_GET_SEALS)


def open_frames(path: str, size: int, nonce: str) -> mmap.mmap | None:
    """Map the other side's buffer read-only; None if it is not reachable or not the same memory."""
    fd = _handed_out(path)
    if fd is None:
        return None
    try:
        # One that shrinks under us would be the end of this process.
        if not _seals(fd) & _SHRINK:
            return None
        if os.fstat(fd).st_size != HEADER_BYTES + size:
            return None
        mapped = mmap.mmap(fd, HEADER_BYTES + size, prot=mmap.PROT_READ)
    except (OSError, ValueError):
        return None
    finally:
        os.close(fd)
    if mapped[: len(nonce)] != nonce.encode():
        mapped.close()
        return None
    return mapped


def _handed_out(path: str) -> int | None:
    """The descriptor that is had at ``path``, if one is."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(HAND_OUT_S)
            connection.connect(path)
            _, descriptors, _, _ = socket.recv_fds(connection, 16, 1, socket.MSG_CMSG_CLOEXEC)
    except (OSError, ValueError):  # a path with a zero byte is the latter
        return None
    return descriptors[0] if descriptors else None
