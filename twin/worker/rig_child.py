"""A process of a rig as its worker holds it."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from typing import IO

from twin.base.process import end


@dataclass(frozen=True, slots=True)
class RigChild:
    """A simulator or the host of a stack, which may have been started before there is a rig."""

    process: subprocess.Popen[bytes]
    log: IO[bytes]
    """An unnamed file: gone with its last user, however this process ends. What matters of it, the
    last lines of a process that died, goes to the conductor."""
    protection: str = ""
    """Sandbox of a stack's host: what it is kept from."""

    def discard(self) -> None:
        """End it; it has not been told anything."""
        self.process.kill()
        end(self.process)
        self.log.close()
