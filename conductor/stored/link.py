"""A conductor's side of a result store: claim, takeover, replica, files of campaigns."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from conductor.core.facts import Committed
from conductor.core.state import State
from conductor.journal.owner import this_process
from conductor.journal.rows import JournalRows
from conductor.journal.store import FILE_NAME as JOURNAL_NAME
from conductor.stored.owner import (
    STALE_S,
    StoreClaims,
    StoreOwner,
    await_silence,
    restarted,
    taken_by,
)
from conductor.stored.replica import HEAD_BYTES_MAX, head_name, read_head
from conductor.stored.replicator import Replicator
from conductor.stored.run_files import RunFiles
from conductor.stored.seals import StoreSeal
from conductor.stored.successor import (
    JournalAhead,
    bring_back_all,
    bring_journal,
    found_results,
    lacking,
)
from schemas.wire.control import Sealed
from schemas.words import counted
from twin.base.errors import UsageError
from twin.fabric.keys.key_file import MemberKey
from twin.stores.apart import end_process, open_apart
from twin.stores.folder_id import folder_id
from twin.stores.opening import checked_url, has_winners
from twin.stores.protocol import MissingObjectError, ResultStore

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class StoreOptions:
    """Where results and journal are kept beside the state folder."""

    url: str
    durable: bool = False
    """Whether replies wait until their facts are in the store."""
    stale_s: float = STALE_S
    """How long an owner is watched before it counts as dead [s]."""

    def __post_init__(self) -> None:
        checked_url(self.url)


class StoreLink:
    """The store of one conductor.

    Args:
        options: which store, and what waits for it.
        folder: state folder.
        key: the conductor's key; None: plain TCP.
    """

    def __init__(self, options: StoreOptions, folder: Path, key: MemberKey | None) -> None:
        self.options = options
        self.taken_over_s: float | None = None
        """How long a takeover took until the journal was here, the watch included; None: there was
        none [s]."""
        self._folder = folder
        self._store: ResultStore = open_apart(options.url)
        self._seal = StoreSeal(self._store, key)
        self._claims = StoreClaims(self._store, self._seal)
        self._own: StoreOwner | None = None
        self._replicator: Replicator | None = None
        self._files: RunFiles | None = None
        self._stopped = threading.Event()
        self._last = threading.Event()
        self._bringing: threading.Thread | None = None

    # --- startup, in this order -----------------------------------------------------------------

    def before_journal(self) -> None:
        """Look who owns the store; if the folder has no journal, take over the one in the store.

        Raises:
            UsageError: another conductor lives on it, the folder is another one's, or the store
                cannot say who was first.
            TwinError: the store does not answer.
        """
        if not has_winners(self._store):
            raise UsageError(
                f"{self._store.url}: two who create the same object both succeed, so it cannot say "
                "who owns a journal; use a store with conditional writes (S3, Google Cloud "
                "Storage) or a folder"
            )
        number, found = self._claims.latest()
        here = (self._folder / JOURNAL_NAME).exists()
        if found is None or (here and found.lease == folder_id(self._folder, "--state")):
            return
        if here:
            raise UsageError(
                f"{self._folder}: {self._store.url} was {taken_by(found)} since this folder was "
                "served; give an empty --state folder to take it over, or another --store"
            )
        self._take_over(number, found)

    def claim(self, state: State) -> int:
        """Make the claim of a conductor that goes on with its own folder; the least epoch.

        Raises:
            TwinError: another was faster, or the store does not answer.
        """
        if self._own is None:
            number, found = self._claims.latest()
            epoch = max(state.epoch, found.epoch if found else 0) + 1
            lease = folder_id(self._folder, "--state")
            self._own = self._claims.claim(number + 1, epoch, this_process(), lease)
        return self._own.epoch

    def begin(self, rows: JournalRows) -> Replicator:
        """Begin the replica of the journal with these rows; its mirror."""
        assert self._own is not None
        self._replicator = Replicator(
            self._store, self._seal, self._own, rows, eager=self.options.durable
        )
        self._replicator.start()
        return self._replicator

    def found(self, state: State) -> list[Sealed]:
        """Results in the store that a journal does not know, after a takeover.

        Raises:
            TwinError: the store does not answer.
        """
        return [] if self.taken_over_s is None else found_results(self._store, state)

    def bring_back(
        self, state: State, told: Callable[[Committed], None], campaigns: Callable[[], list[Path]]
    ) -> None:
        """Begin to fetch files of committed attempts that are not in their folders, and to keep
        the files of campaigns in the store. Files that do not come are asked for again, until
        :meth:`finish_bringing`.

        ``told`` hears of each attempt whose files have come or never will, on a thread;
        ``campaigns``: their folders.
        """
        self._files = RunFiles(self._store, campaigns, self.owns)
        self._files.start()
        due = lacking(state.campaigns.values())
        if not due:
            return
        _log.warning("%s: fetching files of %s", self._store.url, counted(len(due), "case"))

        self._bringing = threading.Thread(
            target=bring_back_all,
            args=(self._store, due, self._stopped, self._last, told),
            name="bring back",
            daemon=True,
        )
        self._bringing.start()

    # --- while it serves ------------------------------------------------------------------------

    @property
    def is_bringing(self) -> bool:
        """Whether files of committed attempts are still on their way here."""
        return self._bringing is not None and self._bringing.is_alive()

    def check(self) -> None:
        """Raise if the journal is not brought into the store any more.

        Raises:
            ReplicaEndedError: that is so.
        """
        if self._replicator is not None:
            self._replicator.check_rounds()

    def when_kept(self, call: Callable[[], None], size: int = 0) -> None:
        """Call ``call`` when replies may leave: at once, unless they wait for the store; ``size``:
        of the reply [bytes]."""
        if self.options.durable and self._replicator is not None:
            self._replicator.when_kept(call, size)
        else:
            call()

    @property
    def rounds(self) -> int:
        """Rounds of the replica that have reached the store."""
        return 0 if self._replicator is None else self._replicator.rounds

    # --- the end --------------------------------------------------------------------------------

    def finish_bringing(self, *, stop: bool) -> None:
        """Wait for the files that are on their way; ``stop``: for those alone."""
        if stop:
            self._stopped.set()
        self._last.set()
        if self._bringing is not None:
            self._bringing.join()

    def close(self, *, released: bool) -> None:
        """Write the end of the journal; ``released``: a successor need not watch us."""
        if self._files is not None:
            self._files.close()
        if self._replicator is not None:
            self._replicator.close(released=released)

    def keep_runs(self, folders: list[Path]) -> None:
        """Put the small files of runs as they are after the end, with their signatures, if the
        store is still ours; the last that is asked of it."""
        try:
            RunFiles(self._store, lambda: folders, self.owns).put_changed()
        except Exception as error:  # they are in the folder; whatever ended us is what counts
            _log.error("the store has not the last files of a run: %s", error)
        finally:
            end_process(self._store)

    def owns(self) -> bool:
        """Whether the newest claim is ours: we have begun, and nobody has taken over.

        Raises:
            TwinError: the store does not answer.
        """
        if self._own is None or self._replicator is None or self._replicator.is_over:
            return False
        return not self._claims.exists(self._own.claim + 1)

    # --- takeover -------------------------------------------------------------------------------

    def _take_over(self, number: int, found: StoreOwner) -> None:
        began_s = time.monotonic()
        head = read_head(self._store, self._seal, found.claim)
        ended = (head is not None and head.released) or restarted(found.owner, this_process())
        ahead = None
        if head is not None and not ended:
            ahead = JournalAhead(self._store, head, self._folder)
        try:
            if not ended:
                await_silence(
                    lambda: self._seen(found.claim),
                    f"{self._store.url}: in use by another conductor (pid {found.owner.pid} on "
                    f"{found.owner.host}); stop it, or give another --store",
                    self.options.stale_s,
                    time.monotonic,
                )
            self._own = self._claims.claim(
                number + 1, found.epoch + 1, this_process(), folder_id(self._folder, "--state")
            )
            if ahead is None or not ahead.take(read_head(self._store, self._seal, found.claim)):
                bring_journal(self._store, self._seal, found.claim, self._folder)
        finally:
            if ahead is not None:
                ahead.close()
        self.taken_over_s = time.monotonic() - began_s
        _log.warning("%s: %s", self._store.url, taken_by(self._own))

    def _seen(self, claim: int) -> bytes:
        try:
            return self._store.get(head_name(claim), HEAD_BYTES_MAX)
        except MissingObjectError:
            return b""
