"""Keeps the replica of a journal up to date, on a thread of its own.

The order of a round: objects, head, then the look for a successor's claim. A successor makes its
claim first and reads the head then. So either it reads what the round has written, or the round
finds its claim and counts for nothing: a reply that waited for the round is never sent for
facts that the successor has not got.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable

from conductor.journal.chain import Chain
from conductor.journal.owner import TakenOverError
from conductor.journal.written import Written
from conductor.stored.owner import StoreClaims, StoreOwner, taken_by
from conductor.stored.replica import (
    ReplicaHead,
    head_name,
    marked_head,
    merged_part,
    put_pack_of,
    put_part,
)
from conductor.stored.seals import StoreSeal
from twin.base.errors import TwinError
from twin.stores.objects import object_name
from twin.stores.protocol import ResultStore

FLUSH_S = 1.0
"""Least time between two rounds, unless replies wait for them [s]."""
BEAT_S = 2.0
"""Most time between two rounds: the head is the owner's sign of life [s]."""
RETRY_S = 1.0
"""Pause after a round that failed [s]."""
WAITING_BYTES_MAX = 64 << 20
"""Most that waits for a store that is away [bytes]; beyond it the replica begins anew."""
TAIL_MAX = 256
"""Most parts of the tail; then they become one."""
CLOSE_S = 30.0
"""Longest wait for the last round at the end [s]."""

_log = logging.getLogger(__name__)


class Replicator:
    """A :class:`conductor.journal.written.JournalMirror` in a store.

    Args:
        store: the store.
        seal: marks the heads.
        own: our claim.
        eager: a round begins as soon as something waits, because replies wait for it.
    """

    def __init__(
        self, store: ResultStore, seal: StoreSeal, own: StoreOwner, *, eager: bool = False
    ) -> None:
        self.rounds = 0
        """Rounds that have reached the store."""
        self._store, self._seal, self._own, self._eager = store, seal, own, eager
        self._claims = StoreClaims(store, seal)
        self._changed = threading.Condition()
        self._waiting: list[Written] = []
        self._bytes = 0
        self._thrown_away = 0
        """How often what waited was thrown away."""
        self._given, self._kept = 1, 0
        """Transactions that were handed over, and that are in the store; what was written before
        the first of them counts as one."""
        self._callbacks: deque[tuple[int, Callable[[], None]]] = deque()
        self._wants_all = True
        self._overflowed = False
        self._closing = self._released = False
        self._taken: str = ""
        self._failing = ""
        # Of the thread alone: what the head says.
        self._packs: list[tuple[str, set[str]]] = []
        self._replies: dict[str, tuple[int, bytes]] = {}
        self._base = ""
        self._tail: list[str] = []
        self._chain = Chain()
        self._beat = 0
        self._old: set[str] = set()
        self._thread = threading.Thread(target=self._run, name="replica", daemon=True)

    def start(self) -> None:
        """Begin; the journal hands over all it has next."""
        self._thread.start()

    # --- called on the journal's thread ---------------------------------------------------------

    def committed(self, written: Written) -> None:
        """See the protocol."""
        with self._changed:
            self._given += 1
            if written.whole:
                self._waiting, self._bytes = [], 0
                self._thrown_away += 1
                self._wants_all = self._overflowed = False
            if self._overflowed or self._wants_all:
                return
            self._waiting.append(written)
            self._bytes += _counted(written)
            if self._bytes > WAITING_BYTES_MAX:
                self._waiting, self._bytes, self._overflowed = [], 0, True
                self._thrown_away += 1
            self._changed.notify_all()

    def wants_all(self) -> bool:
        """See the protocol."""
        return self._wants_all

    def check(self) -> None:
        """See the protocol."""
        if self._taken:
            raise TakenOverError(self._taken)

    @property
    def is_over(self) -> bool:
        """Whether another conductor owns the store now."""
        return bool(self._taken)

    def when_kept(self, call: Callable[[], None]) -> None:
        """Call ``call`` when all that was handed over so far is in the store; at once if it is."""
        with self._changed:
            if self._kept < self._given:
                self._callbacks.append((self._given, call))
                self._changed.notify_all()
                return
        call()

    def close(self, *, released: bool) -> None:
        """A last round, if the store lets us; ``released``: a successor need not wait."""
        with self._changed:
            self._closing, self._released = True, released
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    # --- the thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        last_s = 0.0
        with self._changed:
            # Without all of the journal a head would stand for none.
            self._changed.wait_for(lambda: self._waiting or self._closing)
            if not self._waiting:
                return
        while not self._taken:
            with self._changed:
                self._changed.wait_for(self._due, BEAT_S)
                if not (self._closing or self._eager):
                    pause_s = last_s + FLUSH_S - time.monotonic()
                    self._changed.wait_for(lambda: self._closing, max(0.0, pause_s))
                batch, upto, closing = self._waiting[:], self._given, self._closing
                overflowed, mark = self._overflowed, self._thrown_away
            try:
                self._round(batch, closing)
            except TwinError as error:
                if closing:
                    _log.error("the store has not the end of the journal: %s", error)
                    return
                self._said(str(error))
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, RETRY_S)
                continue
            last_s = time.monotonic()
            self._kept_now(len(batch) if mark == self._thrown_away else 0, upto, overflowed)
            if closing:
                return

    def _due(self) -> bool:
        return bool(self._waiting or self._closing)

    def _said(self, error: str) -> None:
        if not self._failing:
            _log.warning("%s; the journal here goes on, its replica waits", error)
        self._failing = error

    def _kept_now(self, count: int, upto: int, overflowed: bool) -> None:
        calls = []
        if self._failing:
            _log.warning("%s answers again", self._store.url)
            self._failing = ""
        with self._changed:
            self.rounds += 1
            del self._waiting[:count]
            self._bytes = sum(map(_counted, self._waiting))
            if overflowed:
                self._wants_all = True  # the store is there again: all of it, at the next turn
            elif not (self._overflowed or self._wants_all):
                self._kept = upto
            while self._callbacks and self._callbacks[0][0] <= self._kept and not self._taken:
                calls.append(self._callbacks.popleft()[1])
        for call in calls:
            with contextlib.suppress(Exception):  # whoever asked is gone and will ask again
                call()

    def _round(self, batch: list[Written], closing: bool) -> None:
        before = (self._packs, self._replies, self._base, self._tail, self._chain)
        try:
            self._packs, self._replies = list(self._packs), dict(self._replies)
            self._tail = list(self._tail)
            self._put(batch)
            head = self._head(released=closing and self._released)
            self._store.put(head_name(head.claim), marked_head(self._seal, head))
            replaced = self._claims.exists(self._own.claim + 1)
        except BaseException:
            # The batch comes again, and must not stand in the next head twice.
            self._packs, self._replies, self._base, self._tail, self._chain = before
            raise
        if replaced:
            self._taken = self._words_of_successor()
            return
        for digest in self._old - head.objects:
            with contextlib.suppress(TwinError):  # the round counts; what stays takes room only
                self._store.delete(object_name(digest))
        self._old = head.objects

    def _head(self, *, released: bool) -> ReplicaHead:
        self._beat += 1
        return ReplicaHead(
            claim=self._own.claim,
            beat=self._beat,
            packs=[digest for digest, _ in self._packs],
            base=self._base,
            tail=self._tail,
            chain=self._chain,
            released=released,
        )

    def _put(self, batch: list[Written]) -> None:
        """Put what a batch adds; several transactions become one part."""
        merged = Written()
        for written in batch:
            if written.whole:
                merged, self._packs, self._replies = Written(), [], {}
            if written.cut:
                merged.cut, merged.facts = True, []
            merged.facts += written.facts
            merged.images += written.images
            merged.replies.update(written.replies)
            self._chain = written.chain
        if not batch:
            return
        if merged.images:
            keys = {key for key, _ in merged.images}
            kept = [(digest, own - keys) for digest, own in self._packs]
            self._packs = [(digest, own) for digest, own in kept if own]
            images = list(dict(merged.images).items())
            self._packs.append((put_pack_of(self._store, images), keys))
        for worker, reply in merged.replies.items():
            if reply is None:
                self._replies.pop(worker, None)
            else:
                self._replies[worker] = reply
        if merged.cut:
            self._tail = []
            self._base = put_part(self._store, [], dict(self._replies)) if self._replies else ""
            merged.replies = {}
        if merged.facts or merged.replies:
            self._tail.append(put_part(self._store, merged.facts, merged.replies))
        if len(self._tail) > TAIL_MAX:
            self._tail = [merged_part(self._store, self._tail)]

    def _words_of_successor(self) -> str:
        successor = None
        with contextlib.suppress(TwinError):
            successor = self._claims.read(self._own.claim + 1)
        return (
            f"{self._store.url}: {taken_by(successor)}; this one ends, workers go on with the other"
        )


def _counted(written: Written) -> int:
    """Bytes of what waits; all of a journal does not count, or one of its size would never fit."""
    return 0 if written.whole else written.size
