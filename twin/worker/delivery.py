"""Results of a worker that does not share the conductor's disk: through the fabric instead.

Such a worker writes its attempts to a scratch folder of its own. Before a result is committed, its
files are delivered; only then does the commit leave.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import msgspec

from schemas import SCHEMA_VERSION
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.wire import topics
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Ended, Lease, Result
from schemas.wire.delivery import (
    EXTRAS,
    FILES_BYTES_MAX,
    AttemptFiles,
    Delivered,
    SeenFolder,
    extras_sha256,
    files_sha256,
)
from twin.base.errors import InfrastructureError
from twin.fabric.bus import Bus
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.rig_folder import PrivateFolder

PREFIX = "twin-attempts-"
"""Beginning of the scratch folder's name, below ``TMPDIR``."""

TIMEOUT_S = 10.0
"""Longest wait for the answer to one file; then it is sent again [s]."""


class Delivery:
    """Results for campaign folders that the conductor does not share. Its calls may wait."""

    def __init__(self, bus: Bus, worker: str, session: bytes) -> None:
        """``worker`` and ``session``: for whom it speaks, and what proves that."""
        self._bus = bus
        self._worker = worker
        self._session = session
        self._shared: dict[str, bool] = {}
        """Campaign folder -> whether we and the conductor see the same one."""
        self._scratch: PrivateFolder | None = None
        self._lock: int | None = None
        """Held as long as we live: who finds the folder without it may remove it. It is there after
        our end only if its guard was killed with us, as schedulers kill."""
        self._files: dict[int, tuple[Lease, Path]] = {}
        """Token -> lease and attempt folder in our scratch."""
        self._delivered: set[int] = set()
        self.fenced: set[int] = set()
        """Tokens that the conductor says are not ours; their files stay here."""

    def look(self, leases: Sequence[Lease], *, stored: bool = False) -> list[str]:
        """Find out about the folders of new leases; what there is to say about it.

        ``stored``: recordings go into a result store.
        """
        lines = []
        for lease in leases:
            if lease.case.rig.simulator == "noop":
                continue
            if lease.out not in self._shared:
                self._shared[lease.out] = self._is_shared(lease)
                if not self._shared[lease.out]:
                    left = "the log of resources is not"
                    if not stored:
                        left = "recordings and the log of resources are not"
                    lines.append(
                        f"{lease.out} is not the conductor's folder here: results are delivered "
                        f"through the fabric, {left}"
                    )
            if not self._shared[lease.out]:
                attempt = lease.attempt_dir
                folder = self._root(lease) / attempt
                self._files[lease.token] = (lease, folder)
        return lines

    def localized(self, lease: Lease) -> Lease:
        """The lease as the simulator gets it: its campaign folder is one that we can write."""
        if lease.token not in self._files:
            return lease
        # A record of the drive would not be delivered: it is not made.
        variation = msgspec.structs.replace(lease.case.variation, drive="none")
        case = msgspec.structs.replace(lease.case, variation=variation)
        return msgspec.structs.replace(lease, case=case, out=str(self._root(lease)))

    def holds(self, token: int) -> bool:
        """Whether the files of this token are in our scratch, and end with us."""
        return token in self._files

    def deliver(
        self, results: Sequence[Result], ended: Sequence[Ended], on_sent: Callable[[], None]
    ) -> bool:
        """Bring the files of ``results``, and of attempts that ended without one, to the
        conductor; False: not now, ask again. What it refuses as not ours is :attr:`fenced` then.

        ``on_sent`` runs after each: many results over a slow line take a while.

        Raises:
            InfrastructureError: the conductor will never take one of them.
        """
        due = [result.token for result in results if result.attempt_dir]
        due += [end.token for end in ended if self._has_log(end)]
        for token in due:
            if token in self._files:
                lease, folder = self._files[token]
                if token in self._delivered | self.fenced:
                    continue
                if not self._send(lease, folder):
                    return False
                on_sent()
        return True

    def _has_log(self, end: Ended) -> bool:
        """Leases that went back leave what their stack printed, and those that were intervened in
        their KPIs, which are written before the log."""
        if end.token not in self._files:
            return False
        _, folder = self._files[end.token]
        return (folder / "log.txt").exists()

    def forget(self, tokens: Iterable[int]) -> None:
        """The conductor knows how they ended: the scratch copies can go."""
        for token in tokens:
            if token in self._files:
                _, folder = self._files.pop(token)
                self._delivered.discard(token)
                self.fenced.discard(token)
                shutil.rmtree(folder, ignore_errors=True)

    def close(self) -> None:
        """Remove the scratch folder."""
        if self._scratch is not None:
            self._scratch.close()
        if self._lock is not None:
            os.close(self._lock)

    def _is_shared(self, lease: Lease) -> bool:
        try:
            content = read_regular(Path(lease.out) / CONDUCTOR_FILE, RUN_FILE_BYTES_MAX)
        except OSError:
            return False
        question = SeenFolder(
            v=SCHEMA_VERSION,
            campaign=lease.case.variation.campaign,
            sha256=hashlib.sha256(content).hexdigest(),
            worker=self._worker,
            session=self._session,
        )
        # No answer counts as no: a delivery into a folder that is shared does no harm.
        answer = self._ask(encode(question))
        return answer is not None and answer.ok

    def _root(self, lease: Lease) -> Path:
        if self._scratch is None:
            _sweep()
            self._scratch = PrivateFolder(Path(tempfile.gettempdir()), PREFIX)
            self._lock = _locked(self._scratch.path)
        return self._scratch.path / lease.case.variation.campaign

    def _send(self, lease: Lease, folder: Path) -> bool:
        kpi_file = folder / "kpi.parquet"
        kpi = kpi_file.read_bytes() if kpi_file.exists() else b""
        log = (folder / "log.txt").read_bytes()
        extras = {name: (folder / name).read_bytes() for name in EXTRAS if (folder / name).exists()}
        size = len(kpi) + len(log) + sum(map(len, extras.values()))
        if size > FILES_BYTES_MAX:
            raise InfrastructureError(
                f"{lease.case.id}: results of {size} bytes, at most "
                f"{FILES_BYTES_MAX} are delivered; run this worker where it shares the "
                "conductor's file system"
            )
        files = AttemptFiles(
            v=SCHEMA_VERSION,
            campaign=lease.case.variation.campaign,
            case=lease.case.id,
            attempt=lease.attempt,
            kpi=kpi,
            log=log,
            sha256=files_sha256(kpi, log),
            extras=extras,
            extras_sha256=extras_sha256(extras),
            worker=self._worker,
            session=self._session,
        )
        answer = self._ask(encode(files))
        if answer is None or (answer.retry and not answer.ok):
            return False
        if not answer.ok and not answer.fenced:
            raise InfrastructureError(f"a result cannot be delivered: {answer.error}")
        (self._delivered if answer.ok else self.fenced).add(lease.token)
        return True

    def _ask(self, payload: bytes) -> Delivered | None:
        data = self._bus.request(topics.FILES.key, payload, TIMEOUT_S)
        if data is None:
            return None
        with contextlib.suppress(WireError):
            return decode(data, Delivered)
        return None


def _locked(folder: Path) -> int | None:
    """A descriptor that holds the folder's lock; None: somebody else does."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _sweep() -> None:
    """Remove what workers of ours left that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if folder.lstat().st_uid != os.geteuid():
                continue
            lock = _locked(folder)
            if lock is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)
