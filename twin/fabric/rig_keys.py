"""The keys of one rig: its simulator lets in the stack that was started for it, and nobody else.

A certificate of the conductor's fabric says in which role its holder is, not in which rig. So the
worker makes a fabric for each rig, of two members and without an authority that anybody kept:
what is not handed its key does not get through a handshake with its simulator.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO

from twin.fabric.authority import rig_keys
from twin.fabric.files import write_atomic


class RigKeys:
    """Both keys, in memory: files without a name, gone with this process however it ends."""

    def __init__(self, rig: str) -> None:
        """Make them; this takes less than a millisecond.

        Raises:
            OSError: no file can be opened.
        """
        simulator, self._stack = rig_keys(rig)
        self._files: list[IO[bytes]] = []
        try:
            self.simulator = self._unnamed(simulator)
            """What the simulator is told, a path that works while this process lives."""
            self.stack = self._unnamed(self._stack)
            """What a stack on this host is told; the same."""
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
        """Forget them."""
        while self._files:
            self._files.pop().close()

    def _unnamed(self, data: bytes) -> Path:
        file = os.fdopen(os.memfd_create("rig key", os.MFD_CLOEXEC), "wb", buffering=0)
        self._files.append(file)
        os.fchmod(file.fileno(), 0o600)
        file.write(data)
        return Path(f"/proc/{os.getpid()}/fd/{file.fileno()}")
