"""A frame buffer that two processes of one host share without leaving anything behind.

The buffer is a memfd: it has no name in the file system, so it is gone with its last user, however
that one died. The other process opens it through ``/proc/PID/fd/N`` and proves by a nonce in the
first bytes that it sees the same memory; if it cannot, frames travel as payload.
"""

from __future__ import annotations

import math
import mmap
import os
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER_BYTES = 64
"""Bytes before the first frame; the nonce stands there. Keeps frames aligned."""


@dataclass(frozen=True, slots=True)
class Channel:
    """An array that a simulator writes at every frame of a sensor."""

    name: str
    """Of the sensor message."""
    shape: tuple[int, ...]
    dtype: str
    """Little-endian, as NumPy writes it (``|u1``, ``<f4``)."""

    @property
    def size(self) -> int:
        """[bytes]"""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


def lay_out(channels: Sequence[Channel]) -> tuple[dict[str, int], int]:
    """Where each channel lies in one buffer, aligned, and the size of the buffer [bytes]."""
    offsets, size = {}, 0
    for channel in channels:
        offsets[channel.name] = size
        size += -(-channel.size // HEADER_BYTES) * HEADER_BYTES
    return offsets, size


class FrameBuffer:
    """A shared buffer of ``size`` bytes behind the header."""

    def __init__(self, size: int) -> None:
        """Create the buffer (simulator side).

        Raises:
            OSError: the system has no memory, file or descriptor for it.
        """
        self.size = size
        self.nonce = secrets.token_hex(16)
        self._fd = os.memfd_create("twin-frames", os.MFD_CLOEXEC)
        try:
            os.ftruncate(self._fd, HEADER_BYTES + size)
            self._map = mmap.mmap(self._fd, HEADER_BYTES + size)
        except OSError:
            self.close()
            raise
        self._map[: len(self.nonce)] = self.nonce.encode()

    @property
    def path(self) -> str:
        """Where a process of the same user on this host can open it."""
        return f"/proc/{os.getpid()}/fd/{self._fd}"

    def array(self, channel: Channel, offset: int) -> NDArray[Any]:
        """The channel's array; it begins at ``offset`` [bytes]."""
        count = math.prod(channel.shape)
        flat: NDArray[Any] = np.frombuffer(self._map, channel.dtype, count, HEADER_BYTES + offset)
        return flat.reshape(channel.shape)

    def close(self) -> None:
        """Forget the buffer; arrays made of it stay valid until they are freed."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def offer_frames(size: int) -> FrameBuffer | None:
    """A buffer, or None where the system grants none: then frames travel as payload."""
    try:
        return FrameBuffer(size)
    except OSError:
        return None


def open_frames(path: str, size: int, nonce: str) -> mmap.mmap | None:
    """Map the other side's buffer read-only; None if it is not reachable or not the same memory."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, ValueError):  # a path with a zero byte is the latter
        return None
    try:
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
