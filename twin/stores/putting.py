"""Results of a worker in the conductor's result store, before they are committed.

Files of an attempt are put first, then their list, then the sealed results of the request, then the
request goes to the conductor. So whatever a journal calls committed has its files in the store; and
if the journal's end is lost with its conductor, the successor finds the results.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Lease, Next, Result, Sealed
from twin.base.errors import UsageError, storage_error
from twin.stores.objects import get_attempt, mark_of, put_attempt, put_pack
from twin.stores.opening import open_store
from twin.stores.protocol import DamagedObjectError, MissingObjectError, ResultStore

T = TypeVar("T")

Seal = Callable[[bytes, bytes], bytes]
"""Secret of a session and data -> the seal on it."""


class Storing:
    """The store of one worker; its calls may wait."""

    def __init__(self, seal: Seal) -> None:
        self._seal = seal
        self._store: ResultStore | None = None
        self._attempts: dict[int, tuple[Path, int]] = {}
        """Token -> campaign folder as it is here, and number of the attempt."""
        self._stored: set[int] = set()
        """Tokens whose files are in the store."""
        self._packed: int = 0
        """Latest request whose results are there."""

    def join(self, url: str) -> None:
        """The conductor has named its store; empty: it has none.

        Raises:
            UsageError: it cannot be opened here.
        """
        if not url:
            self._store = None
        elif self._store is None or self._store.url != url:
            try:
                self._store = open_store(url)
            except UsageError as error:
                raise UsageError(f"the conductor's store: {error}") from None

    @property
    def store(self) -> ResultStore | None:
        """The conductor's store; None: it has none."""
        return self._store

    def look(self, lease: Lease) -> None:
        """A lease came; its results will lie where it says."""
        self._attempts[lease.token] = (Path(lease.out), lease.attempt)

    def put(self, request: Next, on_put: Callable[[], None]) -> None:
        """Put what ``request`` commits.

        ``on_put`` runs after each attempt: many over a slow line take a while.

        Raises:
            StoreError: it has to wait.
            TwinError: a file of an attempt cannot be read, or the store refuses for good.
        """
        if self._store is None:
            return
        for result in request.results:
            self._put_files(self._store, result)
            on_put()
        if request.results and request.seq > self._packed:
            own = [self._sealed(request, result) for result in request.results]
            put_pack(self._store, request.worker, request.seq, own)
            self._packed = request.seq

    def with_files(self, inherited: list[Sealed]) -> list[Sealed]:
        """Results of earlier workers whose files are in the store; cases of others run again.

        Raises:
            StoreError: the store does not answer.
        """
        store = self._store
        if store is None:
            return inherited
        return [sealed for sealed in inherited if _has_files(store, sealed)]

    def forget(self, tokens: Iterable[int]) -> None:
        """The conductor knows how they ended."""
        for token in tokens:
            self._attempts.pop(token, None)
            self._stored.discard(token)

    def _sealed(self, request: Next, result: Result) -> Sealed:
        data = encode(result)
        return Sealed(result.token, request.worker, data, self._seal(request.session, data))

    def _put_files(self, store: ResultStore, result: Result) -> None:
        if result.token not in self._attempts or result.token in self._stored:
            return
        if not result.attempt_dir:
            return
        out, attempt = self._attempts[result.token]
        folder = out / result.attempt_dir
        try:
            put_attempt(store, folder, result, attempt)
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        self._stored.add(result.token)


def meanwhile(work: Callable[[], T], beat: Callable[[], None], period_s: float) -> T:
    """Result of ``work``, which runs on a thread; ``beat`` runs here every ``period_s`` until then.

    A store of which nothing comes back holds one operation up for longer than a lease lasts.
    """
    outcome: Future[T] = Future()
    over = threading.Event()

    def run() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:
            outcome.set_exception(error)
        over.set()

    threading.Thread(target=run, name="store", daemon=True).start()
    while not over.wait(period_s):
        beat()
    return outcome.result()


def _has_files(store: ResultStore, sealed: Sealed) -> bool:
    try:
        result: Result = decode(sealed.result, Result)
        if result.attempt_dir:
            get_attempt(store, result.campaign, result.case, mark_of(result))
    except (MissingObjectError, DamagedObjectError):
        return False
    except WireError:
        pass  # the conductor says what it is worth
    return True
