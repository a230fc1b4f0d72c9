"""A frame buffer that two processes of one host share without leaving anything behind.

The buffer is a memfd: it has no name in the file system, so it is gone with its last user, however
that one died. The other process opens it through ``/proc/PID/fd/N`` and proves by a nonce in the
first bytes that it sees the same memory; if it cannot, frames travel as payload.
"""

from __future__ import annotations

import mmap
import os
import secrets
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER_BYTES = 64
"""Bytes before the first frame; the nonce stands there. Keeps frames aligned."""


class FrameBuffer:
    """A shared buffer of ``size`` bytes behind the header."""

    def __init__(self, size: int) -> None:
        """Create the buffer (simulator side)."""
        self.size = size
        self.nonce = secrets.token_hex(16)
        self._fd = os.memfd_create("twin-frames", os.MFD_CLOEXEC)
        os.ftruncate(self._fd, HEADER_BYTES + size)
        self._map = mmap.mmap(self._fd, HEADER_BYTES + size)
        self._map[: len(self.nonce)] = self.nonce.encode()

    @property
    def path(self) -> str:
        """Where a process of the same user on this host can open it."""
        return f"/proc/{os.getpid()}/fd/{self._fd}"

    def array(self, shape: tuple[int, ...], dtype: str = "u1", offset: int = 0) -> NDArray[Any]:
        """The part from ``offset`` [bytes] on as an array of ``shape``."""
        count = int(np.prod(shape))
        return np.frombuffer(self._map, dtype, count, HEADER_BYTES + offset).reshape(shape)

    def close(self) -> None:
        """Forget the buffer; arrays made of it stay valid until they are freed."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def open_frames(path: str, size: int, nonce: str) -> mmap.mmap | None:
    """Map the other side's buffer read-only; None if it is not reachable or not the same memory."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
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
