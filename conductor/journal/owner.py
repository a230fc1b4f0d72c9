"""Owner of a state folder, beyond the lock: hosts die with their locks, and some locks do not work.

A small file beside the journal says who serves the folder, and its time of change is the owner's
heartbeat. A conductor of another host may take the folder over once the heartbeat is old, or at
once if it is the restart of the same scheduler job; the old one finds another name in the file
before its next commit, and stops.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import time
from collections.abc import Mapping
from pathlib import Path

import msgspec

from schemas.files.json_text import JsonError, decode_json
from schemas.kinds.batch_system import batch_systems
from twin.base.errors import InfrastructureError, UsageError
from twin.base.files import write_atomic

FILE_NAME = "conductor.owner"
BEAT_S = 1.0
"""How often the heartbeat is renewed and the owner's name is read again at least [s]."""

OWNER_BYTES_MAX = 1 << 14
"""Most that is read of the file [bytes]; names of hosts and jobs have a few hundred."""
WATCH_S = 3.0
"""How long a heartbeat that looks old is watched: clocks of two hosts may differ by minutes [s]."""


class FolderLockedError(UsageError):
    """The journal is open in another process."""


class TakenOverError(InfrastructureError):
    """The folder is served by another conductor now; nothing of the failed call was written."""


class FolderOwner(msgspec.Struct, frozen=True):
    """Content of the file."""

    id: str
    """Id of one process, never reused."""
    host: str
    pid: int
    job: str = ""
    """Scheduler and job id; empty: no scheduler."""
    restarts: int = 0
    """How often the scheduler has started the job again."""


def this_process(environment: Mapping[str, str] = os.environ) -> FolderOwner:
    """The owner that this process would be."""
    job, restarts = "", "0"
    for system in batch_systems().declared:
        if number := environment.get(system.job_variable, ""):
            job = f"{system.name} {number}"
            restarts = environment.get(system.restarts_variable, "0")
            break
    return FolderOwner(
        id=secrets.token_hex(8),
        host=socket.gethostname(),
        pid=os.getpid(),
        job=job,
        restarts=int(restarts) if restarts.isdecimal() else 0,
    )


def obstacle(found: FolderOwner, me: FolderOwner, silent_s: float, stale_s: float) -> str:
    """Why ``me`` must leave the folder to ``found``, or an empty string.

    On one host the lock of the journal decides: it dies with its process.
    """
    if found.host == me.host or silent_s > stale_s:
        return ""
    if found.job and found.job == me.job and me.restarts > found.restarts:
        return ""
    return (
        f"(pid {found.pid} on {found.host}), last heard {max(silent_s, 0.0):.0f} s ago; it can be "
        f"taken over {stale_s:.0f} s after its last sign of life"
    )


class FolderClaim:
    """The folder's owner file: first read, then made ours, then watched."""

    def __init__(self, folder: Path, me: FolderOwner, stale_s: float) -> None:
        self.me = me
        self._path = folder / FILE_NAME
        self._stale_s = stale_s
        self._beat_s = 0.0
        self._mine = False
        self._found: tuple[bytes, FolderOwner] | None = None
        """What was read last; in every transaction it is the same."""

    def obstacle(self) -> str:
        """Why the folder must be left to another; see :func:`obstacle`."""
        owner, changed_s = self.read()
        if owner is None:
            return ""
        reason = obstacle(owner, self.me, time.time() - changed_s, self._stale_s)
        if reason or obstacle(owner, self.me, 0.0, self._stale_s) == "":
            return reason
        # Only its age speaks for a takeover, and that is measured with two clocks.
        until_s = time.monotonic() + WATCH_S
        while time.monotonic() < until_s:
            if self.read() != (owner, changed_s):
                return obstacle(owner, self.me, 0.0, self._stale_s)
            time.sleep(WATCH_S / 30)
        return ""

    def of_another_host(self) -> bool:
        """Whether the file names an owner elsewhere, whose lock says nothing about its life."""
        owner, _ = self.read()
        return owner is not None and owner.host != self.me.host

    def take(self) -> None:
        """Make the folder ours.

        Raises:
            OSError: the file cannot be written.
        """
        write_atomic(self._path, msgspec.json.encode(self.me) + b"\n")
        self._mine = True

    def check(self) -> None:
        """Renew the heartbeat.

        Raises:
            TakenOverError: the folder is not ours any more.
        """
        owner, _ = self.read()
        if owner is not None and owner.id != self.me.id:
            raise TakenOverError(
                f"{self._path.parent}: taken over by the conductor (pid {owner.pid} on "
                f"{owner.host}); this one ends, workers go on with the other"
            )
        now_s = time.time()
        if abs(now_s - self._beat_s) >= BEAT_S:
            self._beat_s = now_s
            with contextlib.suppress(OSError):
                os.utime(self._path, (now_s, now_s))

    def due(self) -> bool:
        """Whether an idle owner should check."""
        return abs(time.time() - self._beat_s) >= BEAT_S

    def release(self) -> None:
        """A clean end."""
        owner, _ = self.read()
        if self._mine and owner is not None and owner.id == self.me.id:
            with contextlib.suppress(OSError):
                self._path.unlink()

    def read(self) -> tuple[FolderOwner | None, float]:
        """The owner and when the file changed [unix s]; None: there is none to be read."""
        try:
            # Opening makes network file systems look again. Without a file object: this is done
            # in every transaction.
            descriptor = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                changed_s = os.fstat(descriptor).st_mtime
                data = os.read(descriptor, OWNER_BYTES_MAX)
            finally:
                os.close(descriptor)
            if self._found is None or self._found[0] != data:
                self._found = (data, decode_json(data, FolderOwner))
            return self._found[1], changed_s
        except (OSError, JsonError):
            return None, 0.0
