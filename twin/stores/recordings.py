"""Recordings of committed attempts, on their way into the conductor's result store.

They go behind everything else, on a thread: no result waits for one, and none is worth a verdict.
A recorder finishes its file a little after the attempt has ended. Then the file is put, named by
its digest, and the conductor hears of it.
"""

from __future__ import annotations

import hashlib
import os
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from schemas import SCHEMA_VERSION
from schemas.files.recording import (
    RECORDING_BYTES_MAX,
    RECORDING_FILE,
    RecordingObject,
    note_in,
    size_in,
)
from schemas.files.regular_file import open_below
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease, Recorded, Reply, Result
from schemas.words import counted
from twin.base.errors import TwinError
from twin.stores.objects import put_object
from twin.stores.protocol import ResultStore, StoreError

WAITING_MAX = 256
"""Most recordings of a worker that wait for the store; of further ones the oldest is left out."""
WAITING_BYTES_MAX = 1 << 30
"""Most bytes of them on the worker's disk: four of the largest, and a tenth of what a pod may
write; of further ones the oldest is left out [bytes]."""
NOTE_S = 60.0
"""Longest wait for a recorder to finish the file of an attempt that is committed [s]."""
LAST_S = 4.0
"""How long a worker that leaves waits for its last recordings [s]: less than a conductor that was
told to stop waits for it, and with the end of its rig less than the time before its walltime."""
LOOK_S = 0.2
"""How often a recording that is not finished is looked at [s]."""
AGAIN_MAX_S = 30.0
"""Longest pause before a store or conductor that did not answer is asked again [s]."""

Ask = Callable[[Recorded], Reply | None]
"""Asks the conductor; None: no answer."""


class _LostRecordingError(Exception):
    """A recording will never be in the store; why, in a line."""


@dataclass(slots=True)
class _Waiting:
    """A committed attempt whose recording is not in the store yet."""

    lease: Lease
    until_s: float
    """When its recorder is given up [s]."""
    stored: RecordingObject | None = None
    """What was put; the conductor has not heard of it."""


class RecordingUploads:
    """Recordings of one worker. Its methods are called from one thread.

    Args:
        worker: for whom it speaks.
        session: what proves that.
        view: view of its simulators; None: what the campaign says.
        ask: asks the conductor, on a thread.
        log: takes a line.
    """

    def __init__(
        self,
        worker: str,
        session: bytes,
        view: ViewMode | None,
        ask: Ask,
        log: Callable[[str], None],
    ) -> None:
        self._worker, self._session, self._view = worker, session, view
        self._ask, self._log = ask, log
        self._store: ResultStore | None = None
        self._leases: dict[int, Lease] = {}
        """Token -> lease of an attempt that is recorded, and runs."""
        self._waiting: dict[int, _Waiting] = {}
        self._over: list[int] = []
        """Tokens whose files nobody needs any more."""
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._thread: threading.Thread | None = None
        self._leaving = False
        self._words = ""
        """Why recordings wait just now; empty: they do not."""

    def join(self, store: ResultStore | None) -> None:
        """The store of the conductor; None: it has none."""
        self._store = store

    def look(self, lease: Lease) -> None:
        """A lease came; its files will lie where it says."""
        rig = lease.case.rig
        view = self._view or ViewMode(rig.view)
        if self._store is not None and view.records and rig.keep != "none":
            self._leases[lease.token] = lease

    def settle(
        self, over: Collection[int], results: Collection[Result], fenced: Collection[int]
    ) -> list[int]:
        """The conductor knows how attempts ended.

        Args:
            over: their tokens.
            results: the results among them.
            fenced: tokens whose results do not count.

        Returns:
            Tokens whose files nobody needs any more; of others they are kept until their recordings
            are in the store.
        """
        committed = {result.token for result in results if result.attempt_dir} - {*fenced}
        with self._lock:
            for token in over:
                lease = self._leases.pop(token, None)
                if lease is not None and token in committed:
                    self._waiting[token] = _Waiting(lease, time.monotonic() + NOTE_S)
                else:
                    self._over.append(token)
            self._bound()
            free, self._over = self._over, []
            if self._waiting and self._thread is None:
                self._thread = threading.Thread(target=self._run, name="recordings", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return free

    def finish(self, limit_s: float = LAST_S) -> None:
        """The worker leaves, and its rig has ended: wait for what is on its way, or give it up."""
        with self._lock:
            self._leaving = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self._waiting, limit_s)
            if self._waiting:
                number = counted(len(self._waiting), "recording")
                why = self._words or "the worker leaves"
                self._log(f"{number} not in the store: {why}")
                self._waiting.clear()

    def _run(self) -> None:
        pause_s = LOOK_S
        while True:
            with self._lock:
                self._changed.wait_for(lambda: self._waiting)
                self._bound()  # recorders have written on meanwhile
                items = list(self._waiting.values())
            answered = all(map(self._advance, items))
            pause_s = LOOK_S if answered else min(2 * pause_s, AGAIN_MAX_S)
            with self._lock:
                # What has just come is looked at soon, also while a store is away.
                self._changed.wait(LOOK_S if self._leaving else pause_s)

    def _advance(self, item: _Waiting) -> bool:
        """Do what can be done for one recording; False: whoever was asked did not answer."""
        token = item.lease.token
        try:
            if not (self._put(item) and self._tell(item)):
                return True
        except StoreError as error:
            self._say(f"{error}; recordings wait")
            with self._lock:  # it may be this one alone: others come first
                if token in self._waiting:
                    self._waiting[token] = self._waiting.pop(token)
            return False
        except (TwinError, OSError, _LostRecordingError) as error:
            with self._lock:
                self._drop(token, str(error))
            return True
        except Exception as error:  # our own mistake, or a library's: the next one has its turn
            with self._lock:
                self._drop(token, repr(error))
            return True
        self._say("")
        self._remove(token)
        return True

    def _say(self, words: str) -> None:
        """Say why recordings wait, or that they do no more, once."""
        if bool(words) != bool(self._words):
            self._log(words or "the store takes recordings again")
        self._words = words

    def _put(self, item: _Waiting) -> bool:
        """Put it, if its file is finished; whether it is in the store now.

        Raises:
            StoreError: the store did not answer.
            _LostRecordingError: it cannot be put.
        """
        if item.stored is not None:
            return True
        lease, store = item.lease, self._store
        folder = _folder(lease)
        note = note_in(folder)
        if note is None:
            if time.monotonic() > item.until_s or (
                self._leaving and not (folder / RECORDING_FILE).exists()
            ):
                raise _LostRecordingError("its recorder has not finished it")
            return False
        if not note.kept:
            self._remove(lease.token)
            return False
        if store is None:
            raise _LostRecordingError("the conductor has no store any more")
        data = _read(folder)
        if hashlib.sha256(data).hexdigest() != note.sha256:
            raise _LostRecordingError("its file has changed since it was finished")
        item.stored = RecordingObject(put_object(store, data), len(data), note.complete)
        return True

    def _tell(self, item: _Waiting) -> bool:
        """Tell the conductor of what was put; whether it has heard.

        Raises:
            StoreError: it did not answer.
            _LostRecordingError: it refuses.
        """
        lease = item.lease
        assert item.stored is not None
        reply = self._ask(
            Recorded(
                v=SCHEMA_VERSION,
                worker=self._worker,
                campaign=lease.case.variation.campaign,
                case=lease.case.id,
                token=lease.token,
                recording=item.stored,
                session=self._session,
            )
        )
        # One that has lost its latest facts, or cannot write, hears of it later.
        if reply is None or reply.retry_after_s or "hello" in reply.error:
            raise StoreError("the conductor does not answer")
        if reply.error:
            raise _LostRecordingError(f"the conductor says: {reply.error}")
        return True

    def _bound(self) -> None:
        """Leave out what can never be put, then the oldest while too many wait, or too many bytes;
        last of all what is in the store, and only waits for the conductor to hear of it."""
        sizes = {token: size_in(_folder(item.lease)) for token, item in self._waiting.items()}
        for token, size in sizes.items():
            if size > RECORDING_BYTES_MAX and self._waiting[token].stored is None:
                self._drop(token, _size_words(size))
        # By age: those that failed have gone behind the others.
        oldest = sorted(
            self._waiting.items(), key=lambda entry: (entry[1].stored is not None, entry[1].until_s)
        )
        bytes_left = sum(sizes[token] for token in self._waiting)
        for token, _ in oldest:
            if len(self._waiting) > WAITING_MAX:
                self._drop(token, f"more than {WAITING_MAX} wait for the store")
            elif bytes_left > WAITING_BYTES_MAX:
                self._drop(token, f"more than {WAITING_BYTES_MAX} bytes wait for the store")
            else:
                return
            bytes_left -= sizes[token]

    def _drop(self, token: int, why: str) -> None:
        item = self._waiting.pop(token, None)
        if item is not None:
            self._over.append(token)
            self._log(f"{item.lease.case.id}: its recording is not in the store: {why}")
        self._changed.notify_all()

    def _remove(self, token: int) -> None:
        with self._lock:
            if self._waiting.pop(token, None) is not None:
                self._over.append(token)
            self._changed.notify_all()


def _folder(lease: Lease) -> Path:
    return Path(lease.out) / lease.attempt_dir


def _size_words(size: int) -> str:
    return f"it has {size} bytes, allowed: 1 to {RECORDING_BYTES_MAX}"


def _read(folder: Path) -> bytes:
    """The recording; a link that somebody has put in its place is not followed."""
    with open_below(folder, RECORDING_FILE) as file:
        size = os.fstat(file.fileno()).st_size
        if not 0 < size <= RECORDING_BYTES_MAX:
            raise _LostRecordingError(_size_words(size))
        return file.read(size)
