"""The keys of one rig: its simulator lets in the stack that was started for it, and nobody else.

A certificate of the conductor's fabric says in which role its holder is, not in which rig. So the
worker makes a fabric for each rig, of two members and without an authority that anybody kept:
what is not handed its key does not get through a handshake with its simulator.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from twin.base.files import write_atomic
from twin.fabric.keys.authority import rig_keys


class RigKeys:
    """Both keys, in memory: files without a name, gone with this process however it ends."""

    def __init__(self, rig: str) -> None:
        """Make both keys; this takes less than a millisecond.

        Raises:
            OSError: no file can be opened.
        """
        self.simulator_key, self._stack = rig_keys(rig)
        """Key of a simulator that may not look at our files."""
        self._files: list[IO[bytes]] = []
        try:
            self.simulator = self._unnamed(self.simulator_key)
            """Path of that key; it works while this process lives and lets others look."""
            self.stack = self._unnamed(self._stack)
            """Path of the key of a stack on this host, likewise."""
        except OSError:
            self.close()
            raise

    def hand_over(self, path: Path) -> None:
        """Write the stack's key to a file of mode 0600, for a stack on another host.

        Raises:
            OSError: it cannot be written.
        """
        write_atomic(path, self._stack, mode=0o600)

    def close(self) -> None:
        """Forget both keys."""
        while self._files:
            self._files.pop().close()

    def _unnamed(self, data: bytes) -> Path:
        self._files.append(_unnamed(data))
        return _path(self._files[-1])


@contextlib.contextmanager
def key_in_memory(data: bytes) -> Iterator[Path]:
    """A path at which this process finds a key that it was told."""
    with _unnamed(data) as file:
        yield _path(file)


def _unnamed(data: bytes) -> IO[bytes]:
    file = os.fdopen(os.memfd_create("rig key", os.MFD_CLOEXEC), "wb", buffering=0)
    os.fchmod(file.fileno(), 0o600)
    file.write(data)
    return file


def _path(file: IO[bytes]) -> Path:
    return Path(f"/proc/{os.getpid()}/fd/{file.fileno()}")
