"""Keeps the replica of a journal up to date, on a thread of its own.

Nothing waits in a queue: a round notes where the journal stands, reads what the store has not got
from the journal itself, a piece at a time, and puts each piece before it reads the next.

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
from dataclasses import dataclass, field, replace

from conductor.journal.chain import Chain
from conductor.journal.owner import TakenOverError
from conductor.journal.rows import CutMeanwhileError, JournalRows
from conductor.journal.written import Changes, JournalPoint
from conductor.stored.owner import StoreClaims, StoreOwner, taken_by
from conductor.stored.replica import (
    PIECE_BYTES,
    ReplicaHead,
    head_name,
    marked_head,
    merged_part,
    put_pack_of,
    put_part,
)
from conductor.stored.seals import StoreSeal
from schemas.escape import escape
from twin.base.errors import InfrastructureError, TwinError
from twin.stores.objects import object_name
from twin.stores.protocol import DamagedObjectError, MissingObjectError, ResultStore

FLUSH_S = 1.0
"""Least time between two rounds, unless replies wait for them [s]."""
BEAT_S = 2.0
"""Most time between two rounds: the head is the owner's sign of life [s]."""
RETRY_S = 1.0
"""Pause after a round that failed [s]."""
TAIL_MAX = 256
"""Most parts of the tail; then small ones that follow each other become one."""
FAULTS_MAX = 3
"""Rounds that fail by a mistake of the program, without a good one in between; then the replica
has ended."""
WAITING_BYTES_MAX = 64 << 20
"""Most that waits with calls until all is in the store [bytes]; then the oldest are never called:
whoever waits for them has lost patience, and asks again."""
CALL_BYTES = 1024
"""What a call counts at least [bytes]."""
CLOSE_S = 30.0
"""Longest wait for the last round at the end [s]."""

_log = logging.getLogger(__name__)


class ReplicaEndedError(InfrastructureError):
    """No round of a replica can be made any more: nobody could take its journal over."""


@dataclass(frozen=True, slots=True)
class _Standing:
    """What the store has of the journal: what the next head says."""

    packs: tuple[tuple[str, frozenset[str]], ...] = ()
    """Digest of each pack and the keys of its images that no later one has."""
    base: str = ""
    tail: tuple[tuple[str, int], ...] = ()
    """Digest and about the length [bytes] of each part."""
    tail_max: int = 0
    """Parts from which on small ones are merged; 0: :data:`TAIL_MAX`."""
    last: int = 0
    """Number of the last fact."""
    chain: Chain = field(default_factory=Chain)


class Replicator:
    """A :class:`conductor.journal.written.JournalMirror` in a store.

    Args:
        store: the store.
        seal: marks the heads.
        own: our claim.
        rows: of the journal.
        eager: a round begins as soon as something is committed, because replies wait for it.
    """

    def __init__(
        self,
        store: ResultStore,
        seal: StoreSeal,
        own: StoreOwner,
        rows: JournalRows,
        *,
        eager: bool = False,
    ) -> None:
        self.rounds = 0
        """Rounds that have reached the store."""
        self._store, self._seal, self._own, self._eager = store, seal, own, eager
        self._rows = rows
        self._claims = StoreClaims(store, seal)
        self._changed = threading.Condition()
        self._changes: Changes | None = None
        """What the store has not got; None: all of the journal."""
        self._given, self._kept = 1, 0
        """Transactions that were committed, and that are in the store; what was written before
        the first of them counts as one."""
        self._callbacks: deque[tuple[int, int, Callable[[], None]]] = deque()
        """Transaction that a call waits for, its size [bytes], and the call."""
        self._waiting_bytes = 0
        self._closing = self._released = False
        self._taken: str = ""
        self._failing = ""
        self._ended = ""
        """Why there are no more rounds; empty: there are."""
        # Of the thread alone.
        self._standing = _Standing()
        self._beat = 0
        self._beat_s = 0.0
        """When a head was written last, by the monotonic clock [s]."""
        self._objects: set[str] = set()
        """Digests of what was put and is not removed."""
        self._thread = threading.Thread(target=self._run, name="replica", daemon=True)

    def start(self) -> None:
        """Begin, with all of the journal."""
        self._thread.start()

    # --- called on the journal's thread ---------------------------------------------------------

    def committed(self, changes: Changes) -> None:
        """See the protocol."""
        with self._changed:
            self._given += 1
            if self._changes is not None:
                self._changes.add(changes)
            self._changed.notify_all()

    def check(self) -> None:
        """See the protocol."""
        if self._taken:
            raise TakenOverError(self._taken)

    @property
    def is_over(self) -> bool:
        """Whether another conductor owns the store now."""
        return bool(self._taken)

    def check_rounds(self) -> None:
        """Raise if no round can be made any more.

        Without them replies would wait for ever, and the head would stand still, so that a
        successor takes over while we go on.

        Raises:
            ReplicaEndedError: that is so.
        """
        if self._ended:
            raise ReplicaEndedError(self._ended)

    def when_kept(self, call: Callable[[], None], size: int = 0) -> None:
        """Call ``call`` when all that was committed so far is in the store; at once if it is.

        ``size``: of what waits with it [bytes], see :data:`WAITING_BYTES_MAX`.
        """
        left_out = []  # let go of when nothing is locked any more
        with self._changed:
            if self._kept < self._given:
                self._callbacks.append((self._given, max(size, CALL_BYTES), call))
                self._waiting_bytes += max(size, CALL_BYTES)
                while self._waiting_bytes > WAITING_BYTES_MAX:
                    left_out.append(self._next_call())
                self._changed.notify_all()
                return
        call()

    def _next_call(self) -> Callable[[], None]:
        """The oldest call, which waits no longer."""
        _, size, call = self._callbacks.popleft()
        self._waiting_bytes -= size
        return call

    def close(self, *, released: bool) -> None:
        """A last round, if the store lets us; ``released``: a successor need not wait. The journal
        must still be open."""
        with self._changed:
            self._closing, self._released = True, released
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    # --- the thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        last_s = 0.0
        faults = 0
        while not self._taken:
            closing = self._waited(last_s)
            try:
                upto = self.round(closing=closing)
            except Exception as error:
                if closing:
                    _log.error("the store has not the end of the journal: %s", error)
                    return
                faults += not isinstance(error, TwinError)
                self._failed(error, faults)
                if self._ended:
                    return
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, RETRY_S)
                continue
            faults = 0
            last_s = time.monotonic()
            self._kept_now(upto)
            if closing:
                return

    def _waited(self, last_s: float) -> bool:
        """Return when a round is due; whether it is the last one.

        ``last_s``: end of the one before, by the monotonic clock [s].
        """
        with self._changed:
            self._changed.wait_for(self._due, BEAT_S)
            if not (self._closing or self._eager):
                pause_s = last_s + FLUSH_S - time.monotonic()
                self._changed.wait_for(lambda: self._closing, max(0.0, pause_s))
            return self._closing

    def _failed(self, error: Exception, faults: int) -> None:
        """A round has failed; ``faults``: so many since the last good one by a mistake of the
        program."""
        if isinstance(error, TwinError):
            self._said(error)
        else:
            _log.error("a round of the replica has failed", exc_info=error)
            self._put_back(None)  # whatever was noted of it may be wrong: all is put anew
            if faults == FAULTS_MAX:
                why = escape(f"{type(error).__name__}: {error}")
                self._ended = (
                    f"{self._store.url}: the journal cannot be brought there: {why}; it is whole "
                    "in the state folder, so serve that again; leave --store away if it does not "
                    "help"
                )

    def _due(self) -> bool:
        return self._kept < self._given or self._closing

    def _said(self, error: TwinError) -> None:
        if not self._failing:
            _log.warning("%s; the journal here goes on, its replica waits", error)
        self._failing = str(error)

    def _kept_now(self, upto: int) -> None:
        calls = []
        if self._failing:
            _log.warning("%s answers again", self._store.url)
            self._failing = ""
        with self._changed:
            self.rounds += 1
            self._kept = upto
            while self._callbacks and self._callbacks[0][0] <= self._kept and not self._taken:
                calls.append(self._next_call())
        for call in calls:
            with contextlib.suppress(Exception):  # whoever asked is gone and will ask again
                call()

    def round(self, *, closing: bool = False) -> int:
        """Bring what the store has not got; how many transactions it has then.

        Raises:
            TwinError: the store or the journal does not answer. What was put counts for nothing,
                and the next round brings it again.
        """
        while True:
            changes, upto, point = self._begun()
            try:
                standing = self._brought(changes, point)
                break
            except CutMeanwhileError:
                self._put_back(changes)
            except (MissingObjectError, DamagedObjectError):
                self._put_back(None)  # a part that was to be merged: all is put anew
                raise
            except BaseException:
                self._put_back(changes)
                raise
        head = self._head(standing, released=closing and self._released)
        try:
            self._write_head(head)
            replaced = self._claims.exists(self._own.claim + 1)
        except BaseException:
            self._put_back(changes)
            raise
        self._standing = standing
        if replaced:
            self._taken = self._words_of_successor()
            return upto
        for digest in self._objects - head.objects:
            with contextlib.suppress(TwinError):  # the round counts; what stays takes room only
                self._store.delete(object_name(digest))
        self._objects = head.objects
        return upto

    def _begun(self) -> tuple[Changes | None, int, JournalPoint]:
        """What is to be brought, and up to where; nothing is written meanwhile."""
        with self._rows.lock, self._changed:
            changes, upto = self._changes, self._given
            workers = None if changes is None or changes.cut else changes.workers
            point = self._rows.point(workers)
            self._changes = Changes()
        return changes, upto, point

    def _put_back(self, changes: Changes | None) -> None:
        with self._changed:
            if changes is None or self._changes is None:
                self._changes = None
            else:
                changes.add(self._changes)
                self._changes = changes

    def _brought(self, changes: Changes | None, point: JournalPoint) -> _Standing:
        """Put all that lies between what the store has and ``point``."""
        made = replace(self._standing, chain=point.chain, last=point.last)
        after = self._standing.last
        replies = point.replies
        if changes is None or changes.cut:
            keys = self._rows.image_keys() if changes is None else changes.images
            kept = () if changes is None else made.packs
            made = replace(made, packs=self._packs(kept, point, keys), tail=(), tail_max=0, base="")
            if replies:
                made = replace(made, base=self._put(put_part(self._store, [], replies)))
            after, replies = 0, []
        for facts in self._rows.facts(point, after, PIECE_BYTES):
            digest = self._put(put_part(self._store, facts, ()))
            size = sum(len(fact) for _, fact, _ in facts)
            made = replace(made, tail=(*made.tail, (digest, size)))
        if replies:
            # Behind the facts, which they tell of.
            size = sum(len(reply) for _, _, reply in replies)
            part = self._put(put_part(self._store, [], replies))
            made = replace(made, tail=(*made.tail, (part, size)))
        return self._merged(made)

    def _packs(
        self, packs: tuple[tuple[str, frozenset[str]], ...], point: JournalPoint, keys: set[str]
    ) -> tuple[tuple[str, frozenset[str]], ...]:
        for images in self._rows.images(point, keys, PIECE_BYTES):
            new = frozenset(key for key, _ in images)
            left = ((digest, own - new) for digest, own in packs)
            digest = self._put(put_pack_of(self._store, images))
            packs = (*((digest, own) for digest, own in left if own), (digest, new))
        return packs

    def _merged(self, made: _Standing) -> _Standing:
        """With fewer parts of the tail, if there are many."""
        if len(made.tail) <= max(TAIL_MAX, made.tail_max):
            return made
        groups: list[list[tuple[str, int]]] = []
        for part in made.tail:
            if groups and sum(size for _, size in groups[-1]) + part[1] <= PIECE_BYTES:
                groups[-1].append(part)
            else:
                groups.append([part])
        tail = tuple(
            group[0]
            if len(group) == 1
            else (
                self._put(merged_part(self._store, [digest for digest, _ in group])),
                sum(size for _, size in group),
            )
            for group in groups
        )
        return replace(made, tail=tail, tail_max=2 * len(tail))

    def _put(self, digest: str) -> str:
        """An object was put; in between the head says that we live."""
        self._objects.add(digest)
        if self._beat and time.monotonic() - self._beat_s > BEAT_S:
            self._write_head(self._head(self._standing, released=False))
        return digest

    def _head(self, standing: _Standing, *, released: bool) -> ReplicaHead:
        self._beat += 1
        return ReplicaHead(
            claim=self._own.claim,
            beat=self._beat,
            packs=[digest for digest, _ in standing.packs],
            base=standing.base,
            tail=[digest for digest, _ in standing.tail],
            chain=standing.chain,
            released=released,
        )

    def _write_head(self, head: ReplicaHead) -> None:
        self._store.put(head_name(head.claim), marked_head(self._seal, head))
        self._beat_s = time.monotonic()

    def _words_of_successor(self) -> str:
        successor = None
        with contextlib.suppress(TwinError):
            successor = self._claims.read(self._own.claim + 1)
        return (
            f"{self._store.url}: {taken_by(successor)}; this one ends, workers go on with the other"
        )
