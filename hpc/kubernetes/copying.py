"""Brings the run folder out of its claim: a ``tar`` in a pod, unpacked here.

While the conductor's pod runs it does this beside it; afterwards a pod of its own reads the claim,
and goes. Who may write the claim, or run pods in the namespace, decides what arrives: names are
kept below the target, links, devices and what only this machine may say are left out, and sizes are
bounded.
"""

from __future__ import annotations

import io
import posixpath
import tarfile
import time
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from hpc.kubernetes.api import POLL_S, Namespace, NotThereError, component_of
from hpc.kubernetes.object_store import STORE
from hpc.kubernetes.objects import IMAGE, PULL_SECRET, RUN, Object, reader_of
from hpc.pull import LEFT_THERE
from hpc.submit import JOB_FILE
from schemas.escape import escape
from schemas.kinds.batch_system import KUBERNETES
from twin.base.errors import InfrastructureError, UsageError, storage_error

READER_WAIT_S = 300.0
"""Longest wait for the pod that reads a claim [s]."""
READER_S = 12 * 3600
"""How long that pod lives if nobody deletes it [s]."""
SILENT_S = 120.0
"""Longest wait for the next bytes of a copy [s]."""
FILES_MAX = 5_000_000
"""Most files of a run folder."""
PULL_BYTES_MAX = 4 << 40
"""Most bytes of a run folder."""
STDERR_CHARS_MAX = 10_000
"""Most of a failed copy's last words that is kept [characters]."""

NAME_CHARS_MAX = 200
"""Most of a name that is shown where it is refused [characters]."""

_OURS = (JOB_FILE, KUBERNETES.script, *(pattern.lstrip("/") for pattern in LEFT_THERE))
"""Names in the run folder that are never taken from a claim: they say which job, which conductor
and which keys are to be believed."""
_CHANGED = 1
"""Exit code of ``tar`` when a file changed while it was read."""


def copy_run(namespace: Namespace, run: str, target: Path) -> None:
    """Copy the run folder of a claim into ``target``; files that are there are replaced.

    Raises:
        UsageError: there is no claim, or what arrives is not to be believed.
        InfrastructureError: the copy broke off; the same again begins anew.
    """
    running = [
        pod
        for pod in namespace.pods(run)
        if component_of(pod) == "conductor" and pod.status.phase == "Running"
    ]
    if running:
        _unpack(namespace, running[-1].metadata.name, "conductor", target)
        return
    reader = _reader(namespace, run)
    name = reader["metadata"]["name"]
    namespace.delete("Pod", name, wait=True)  # of a copy that was killed
    namespace.create(reader)
    try:
        _await(namespace, name)
        _unpack(namespace, name, "reader", target)
    finally:
        namespace.delete("Pod", name)


def _reader(namespace: Namespace, run: str) -> Object:
    try:
        claim = namespace.read("PersistentVolumeClaim", run)
    except NotThereError as error:
        if url := _store_of(namespace, run):
            raise UsageError(
                f"{run}: its pod has gone, and its results are in {escape(url, NAME_CHARS_MAX)}: "
                "`conductor report URL --out FOLDER` reads them"
            ) from None
        raise UsageError(
            f"{error}; without its claim the results of {run} are gone, or were never there, or "
            "are in the object store that its job.yaml names"
        ) from None
    said = claim.metadata.annotations or {}
    if IMAGE not in said:
        raise UsageError(f"claim {run}: says no image to read it with; `hpc` did not make it")
    return reader_of(run, said[IMAGE], said.get(PULL_SECRET, ""), READER_S)


def _store_of(namespace: Namespace, run: str) -> str:
    """Where a run has its results if not on a claim; empty: nothing says so."""
    try:
        job = namespace.read("Job", f"{run}-conductor")
    except NotThereError:
        return ""
    return str((job.metadata.annotations or {}).get(STORE, ""))


def _await(namespace: Namespace, name: str) -> None:
    until_s = time.monotonic() + READER_WAIT_S
    while (pod := namespace.read("Pod", name)).status.phase != "Running":
        if pod.status.phase in ("Failed", "Succeeded") or time.monotonic() > until_s:
            raise InfrastructureError(
                f"pod {name} did not start ({pod.status.phase}); kubectl --namespace "
                f"{namespace.name} describe pod {name} says why"
            )
        time.sleep(POLL_S)


def _unpack(namespace: Namespace, pod: str, container: str, target: Path) -> None:
    excluded = [f"--exclude=./{name}" for name in _OURS]
    session = namespace.exec(pod, container, ["tar", "-C", RUN, "-cf", "-", *excluded, "."])
    source = _Bytes(session)
    stream = io.BufferedReader(source)
    try:
        with tarfile.open(fileobj=stream, mode="r|") as archive:
            archive.extractall(target, members=_believed(archive), filter="data")
        while stream.read(1 << 16):
            pass
        code = source.exit_code()
        # Files of a conductor that works change; what a reader copies does not.
        if code not in (0, _CHANGED if container == "conductor" else 0):
            raise EOFError(f"tar ended with {code}")
    except tarfile.FilterError as error:
        raise UsageError(
            f"the copy out of pod {pod} has a name that leads out of {target} "
            f"({escape(error.tarinfo.name, NAME_CHARS_MAX)}); this is no run folder of ours, look "
            "at it in its pod"
        ) from None
    except (tarfile.TarError, EOFError) as error:
        lines = (source.errors.strip() or str(error)).splitlines() or ["it says nothing"]
        raise InfrastructureError(
            f"the copy out of pod {pod} broke off: {escape(lines[-1], NAME_CHARS_MAX)}; the same "
            "command begins it anew"
        ) from None
    except OSError as error:
        raise storage_error(error, str(target)) from None
    finally:
        session.close()


def _believed(archive: tarfile.TarFile) -> Iterator[tarfile.TarInfo]:
    """Members that are files and folders, while they are within bounds."""
    files = size = 0
    for member in archive:
        if not (member.isfile() or member.isdir()) or _is_ours(member.name):
            continue
        files += 1
        size += member.size
        if files > FILES_MAX or size > PULL_BYTES_MAX:
            raise UsageError(
                f"the run folder has more than {FILES_MAX} files or {PULL_BYTES_MAX} bytes; this "
                "is no run folder of ours, look at it in its pod"
            )
        yield member


def _is_ours(name: str) -> bool:
    """Whether a member is one that this machine alone may write, or lies in such a folder."""
    # Disks of some machines do not tell upper from lower case.
    top = posixpath.normpath(name.lstrip("/")).partition("/")[0].casefold()
    return any(fnmatchcase(top, pattern) for pattern in _OURS)


class _Bytes(io.RawIOBase):
    """Standard output of a command in a pod."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self._left = b""
        self.errors = ""

    def readable(self) -> bool:
        """Whether the copy can be read."""
        return True

    def readinto(self, buffer: Any) -> int:
        """The next bytes; 0 at the end.

        Raises:
            EOFError: the connection broke off, or nothing came for a long time.
        """
        from websocket import WebSocketException

        try:
            self._await()
        except (WebSocketException, OSError) as error:
            raise EOFError(f"the connection is lost ({type(error).__name__})") from None
        count = min(len(buffer), len(self._left))
        buffer[:count], self._left = self._left[:count], self._left[count:]
        return count

    def exit_code(self) -> int:
        """What the command ended with, when all has been read.

        Raises:
            EOFError: the connection ended before the command.
        """
        import yaml

        try:
            return int(self._session.returncode)
        # The client reads a status that never came, or one of the node and not of the command.
        except (TypeError, KeyError, IndexError, ValueError, yaml.YAMLError):
            raise EOFError("the connection ended before tar did") from None

    def _await(self) -> None:
        until_s = time.monotonic() + SILENT_S
        while not self._left:
            if self._session.peek_stderr():
                said = self._session.read_stderr().decode("utf-8", "replace")
                self.errors = (self.errors + said)[-STDERR_CHARS_MAX:]
            if self._session.peek_stdout():
                self._left = self._session.read_stdout()
            elif not self._session.is_open():
                return
            elif time.monotonic() > until_s:
                raise EOFError(f"nothing came for {SILENT_S:.0f} s")
            else:
                self._session.update(timeout=1)
