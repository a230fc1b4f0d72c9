"""The private folder of one rig: where its simulator and its stack meet on one host.

It holds the sockets of the drive session and of the shared frames. Nobody else may enter it, so
nothing in it needs a key; its path is short, because the kernel takes 108 bytes of a socket's.
"""

from __future__ import annotations

import os
import secrets
import tempfile
from pathlib import Path

from twin.base.process import spawn
from twin.fabric.endpoint import SOCKET

PATH_BYTES_MAX = 90
"""Longest path of a socket in it [bytes]; Zenoh puts a lock file of a longer name beside it."""

SEEN_IN_CONTAINERS = Path("/tmp")
"""The one folder that every container runtime shows to what runs inside."""

_DRIVE, _FRAMES = "drive", "frames"

# Ended by the end of its lifeline alone, so that it outlives a worker that is killed. It makes the
# folder itself, so that none exists before its guard can outlive a kill. A process that has not
# noticed the end may still put something into the folder while it is removed: so it loses its name
# first, and is removed again. Where another user has taken the second name, it keeps the first.
_GUARD = """
trap "" TERM INT HUP
mkdir -m 700 -- "$0" 2>&1 || exit 1
echo
read -r _
gone="$0-gone"
mv -fT -- "$0" "$gone" 2>/dev/null || gone="$0"
for _ in 1 2 3 4 5 6 7 8 9 10; do
  rm -rf -- "$gone" 2>/dev/null && exit
  sleep 0.5
done
"""


class PrivateFolder:
    """A folder of mode 0700 that goes when it is closed, or with this process however it ends."""

    def __init__(self, place: Path | None = None, prefix: str = "twin-") -> None:
        """Make the folder.

        Args:
            place: where; None: the user's runtime folder or the temporary one, whose path is short
                enough.
            prefix: beginning of its name.

        Raises:
            OSError: no folder can be made.
        """
        name = f"{prefix}{secrets.token_hex(4)}"
        self.path = (place or _place(name)) / name
        """Path of the folder; absolute."""
        self._guard = spawn(["sh", "-c", _GUARD, str(self.path)], pipe_output=True)
        assert self._guard.stdout is not None
        with self._guard.stdout as answer:
            if problem := answer.readline().decode(errors="replace").strip():
                self.close()
                raise OSError(problem)

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
    """Socket at which the simulator whose drive session is at ``endpoint`` hands out its frames."""
    return Path(endpoint.partition("/")[2]).with_name(_FRAMES)


def _place(name: str) -> Path:
    """The first folder that is ours to write to and leaves the name of a socket short enough."""
    for place in (os.environ.get("XDG_RUNTIME_DIR", ""), tempfile.gettempdir()):
        length = len(os.fsencode(f"{place}/{name}/{_FRAMES}"))
        if place.startswith("/") and length <= PATH_BYTES_MAX and os.access(place, os.W_OK):
            return Path(place)
    return SEEN_IN_CONTAINERS
