"""The private folder of one rig: where its simulator and its stack meet on one host.

It holds the sockets of the drive session and of the shared frames. Nobody else may enter it, so
nothing in it needs a key; its path is short, because the kernel takes 108 bytes of a socket's.
"""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from pathlib import Path

from twin.base.process import spawn
from twin.fabric.endpoint import SOCKET

PATH_BYTES_MAX = 90
"""Longest path of a socket in it [bytes]; Zenoh puts a lock file of a longer name beside it."""

SEEN_IN_CONTAINERS = Path("/tmp")
"""The one folder that every container runtime shows to what runs inside."""

_DRIVE, _FRAMES = "drive", "frames"

# Ended by the end of its lifeline alone, so that it outlives a worker that is killed.
_GUARD = 'trap "" TERM INT HUP; read -r _; exec rm -rf -- "$0"'


class PrivateFolder:
    """A folder of mode 0700 that goes when it is closed, or with this process however it ends."""

    def __init__(self, place: Path | None = None) -> None:
        """Make it. Only from the main thread.

        Args:
            place: where; None: the user's runtime folder or the temporary one, whose path is short
                enough.

        Raises:
            OSError: no folder can be made.
        """
        name = f"twin-{secrets.token_hex(4)}"
        self.path = (place or _place(name)) / name
        """Of the folder; absolute."""
        try:
            self.path.mkdir(mode=0o700)
            self._guard = spawn(["sh", "-c", _GUARD, str(self.path)])
        except OSError:
            shutil.rmtree(self.path, ignore_errors=True)
            raise

    def close(self) -> None:
        """Remove it, with all that is in it; its processes have ended."""
        assert self._guard.stdin is not None
        self._guard.stdin.close()
        self._guard.wait()


class RigFolder(PrivateFolder):
    """The private folder of a rig."""

    @property
    def drive(self) -> str:
        """Endpoint of the drive session."""
        return f"{SOCKET}/{self.path / _DRIVE}"


def frames_socket(endpoint: str) -> Path:
    """Where the simulator whose drive session is at ``endpoint`` hands out its frames."""
    return Path(endpoint.partition("/")[2]).with_name(_FRAMES)


def _place(name: str) -> Path:
    """The first folder that is ours to write to and leaves the name of a socket short enough."""
    for place in (os.environ.get("XDG_RUNTIME_DIR", ""), tempfile.gettempdir()):
        length = len(os.fsencode(f"{place}/{name}/{_FRAMES}"))
        if place.startswith("/") and length <= PATH_BYTES_MAX and os.access(place, os.W_OK):
            return Path(place)
    return SEEN_IN_CONTAINERS
