"""What a successor does with a store: find the journal, take results, bring files back."""

from __future__ import annotations

import logging
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from conductor.core.facts import Committed
from conductor.core.state import CampaignState, State
from conductor.journal.store import FILE_NAME as JOURNAL_NAME
from conductor.journal.store import write_journal
from conductor.journal.written import JournalPart
from conductor.records.attempts import attempt_folder
from conductor.stored.replica import ReplicaHead, read_head, read_replica
from conductor.stored.seals import StoreSeal
from schemas.files.judging import RECORD_FILE, attempt_digest
from schemas.wire.control import Result, Sealed
from twin.base.errors import InfrastructureError, TwinError, storage_error
from twin.base.files import write_atomic
from twin.stores.objects import FILES, get_attempt, get_object, get_pack, mark_of, pack_of
from twin.stores.protocol import (
    DamagedObjectError,
    MissingObjectError,
    ResultStore,
    StoreError,
    StoreRefusedError,
)

READERS = 16
"""Objects that are read at a time."""
FOUND_MAX = 1_000_000
"""Most results that are taken from a store, as many as a conductor has cases."""
AHEAD_FOLDER = ".ahead"
"""In a state folder: a journal that is fetched before it is known to be the last one."""
HEAD_TRIES = 5
"""How often a replica is read whose owner replaces it meanwhile."""

AGAIN_S = 2.0
"""Pause before files that did not come are asked for again; each further one is
twice as long [s]."""
AGAIN_MAX_S = 60.0
"""Longest such pause [s]."""

_log = logging.getLogger(__name__)


def bring_journal(store: ResultStore, seal: StoreSeal, claim: int, folder: Path) -> bool:
    """Write the journal of the latest claim up to ``claim`` whose owner has kept one into
    ``folder``; False: none has.

    Raises:
        TwinError: it cannot be believed, read or written.
    """
    for number in range(claim, 0, -1):
        for tries_left in reversed(range(HEAD_TRIES)):
            head = read_head(store, seal, number)
            if head is None:
                break
            try:
                write_journal(folder, head.chain, read_replica(store, head))
                return True
            except MissingObjectError:  # an owner that still lives has written another head
                if not tries_left:
                    raise
    return False


class JournalAhead:
    """The journal of an owner, fetched on a thread while it is watched: if its head stands still,
    it is all there when the watch ends.

    Args:
        store: the store.
        head: as it is now.
        folder: state folder; a folder in it is used, which :meth:`close` removes.
    """

    def __init__(self, store: ResultStore, head: ReplicaHead, folder: Path) -> None:
        self._store, self._head, self._folder = store, head, folder
        self._ahead = folder / AHEAD_FOLDER
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._fetch, name="journal ahead", daemon=True)
        shutil.rmtree(self._ahead, ignore_errors=True)
        self._thread.start()

    def take(self, head: ReplicaHead | None) -> bool:
        """Put the journal into its place, if ``head`` is still the one that was fetched; whether
        it was.

        Raises:
            JournalError: it cannot be put there.
        """
        if head == self._head:
            self._thread.join()
        taken = head == self._head and (self._ahead / JOURNAL_NAME).exists()
        if taken:
            try:
                (self._ahead / JOURNAL_NAME).rename(self._folder / JOURNAL_NAME)
            except OSError as error:
                raise storage_error(error, str(self._folder)) from None
        return taken

    def close(self) -> None:
        """Fetch nothing more, and leave nothing behind."""
        self._closed.set()
        self._thread.join()
        shutil.rmtree(self._ahead, ignore_errors=True)

    def _fetch(self) -> None:
        try:
            self._ahead.mkdir(parents=True)
            write_journal(self._ahead, self._head.chain, self._parts())
        except (TwinError, OSError) as error:
            _log.debug("%s; it is fetched again", error)

    def _parts(self) -> Iterator[JournalPart]:
        for part in read_replica(self._store, self._head):
            if self._closed.is_set():
                raise StoreError(f"{self._store.url}: nobody waits for its journal any more")
            yield part


def found_results(store: ResultStore, state: State) -> list[Sealed]:
    """Sealed results of requests that the journal does not know to be answered.

    A listing may be stale, and an object damaged: then its cases run again.

    Raises:
        TwinError: the store does not answer.
    """
    due = []
    for name in store.names("results/"):
        pack = pack_of(name)
        worker = state.workers.get(pack[0]) if pack else None
        if pack is None or worker is None:
            continue
        if worker.replied is None or worker.replied.seq < pack[1]:
            due.append(name)
    found: list[Sealed] = []
    with ThreadPoolExecutor(READERS) as pool:
        for results in pool.map(lambda name: _results(store, name), due):
            found += results[: FOUND_MAX - len(found)]
    return found


def _results(store: ResultStore, name: str) -> list[Sealed]:
    try:
        return get_pack(store, name)
    except (MissingObjectError, DamagedObjectError) as error:
        _log.warning("%s; its cases run again", error)
        return []


def lacking(campaigns: Iterable[CampaignState]) -> list[tuple[Path, Committed]]:
    """Committed attempts whose KPI file is not in their campaign folder."""
    due = []
    for campaign in campaigns:
        if campaign.campaign.simulator == "noop":
            continue
        out = Path(campaign.out)
        for case in campaign.ordered:
            end = case.end if case.ended else None
            if not isinstance(end, Committed) or not end.result.attempt_dir:
                continue
            if not (out / end.result.attempt_dir / "log.txt").exists():
                due.append((out, end))
    return due


def bring_back(store: ResultStore, out: Path, result: Result) -> None:
    """Write the files of a committed attempt into its campaign folder.

    Raises:
        DamagedObjectError: they are not the ones that were committed.
        TwinError: they are not there, the store does not answer, or the disk lets us down.
    """
    stored = get_attempt(store, result.campaign, result.case, mark_of(result))
    data = {
        name: get_object(store, stored.files[name].sha256) for name in FILES if name in stored.files
    }
    digest = attempt_digest(result.kpi_sha256, data.get("log.txt", b""), data.get(RECORD_FILE, b""))
    if result.manifest_sha256 and digest != result.manifest_sha256:
        raise DamagedObjectError(
            f"{store.url}: files of case {result.case} are not the ones that were committed"
        )
    folder = attempt_folder(out, result.attempt_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # The log comes last: with it an attempt is whole.
        for name in sorted(data, key="log.txt".__eq__):
            write_atomic(folder / name, data[name], sync=False)
    except OSError as error:
        raise InfrastructureError(f"{folder}: {error.strerror or error}") from None


def bring_back_all(
    store: ResultStore,
    due: list[tuple[Path, Committed]],
    stopped: threading.Event,
    last: threading.Event,
    told: Callable[[Committed], None],
    pause_s: float = AGAIN_S,
) -> None:
    """Bring back many; those for which the store does not answer, again and again.

    Args:
        store: the store.
        due: campaign folder and commit of each attempt.
        stopped: set: no further one.
        last: set: what does not come now never will.
        told: hears of each whose files have come, or never will: its judge says that.
        pause_s: before the ones that are left are tried again; each further one is twice as long
            [s].
    """

    def one(item: tuple[Path, Committed]) -> TwinError | None:
        out, fact = item
        if stopped.is_set():
            return None
        try:
            bring_back(store, out, fact.result)
        except TwinError as error:
            return error
        except Exception as error:  # of one attempt; the others come
            return InfrastructureError(f"its files did not come: {type(error).__name__}: {error}")
        told(fact)
        return None

    with ThreadPoolExecutor(READERS) as pool:
        while due and not stopped.is_set():
            ending = last.is_set()
            again = []
            for item, error in zip(due, pool.map(one, due), strict=True):
                if error is None:
                    continue
                _log.error("case %s: %s", item[1].result.case, error)
                if ending or not _may_come(error):
                    told(item[1])
                else:
                    again.append(item)
            due = again
            if due:
                last.wait(pause_s)
                pause_s = min(2 * pause_s, AGAIN_MAX_S)


def _may_come(error: TwinError) -> bool:
    """Whether another try may succeed: the store did not answer."""
    final = (MissingObjectError, DamagedObjectError, StoreRefusedError)
    return isinstance(error, StoreError) and not isinstance(error, final)
