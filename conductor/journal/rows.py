"""Rows of a journal that is being written, read a few at a time by whoever keeps a copy of it.

A copy needs no queue of what was written: the journal has it. Facts are never changed, only dropped
by a snapshot; so a reader notes where the journal stands, reads up to there in its own time, and
begins anew if a snapshot came in between.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from conductor.journal.chain import Chain
from conductor.journal.written import JournalPoint, Reply, Row
from schemas.escape import escape
from twin.base.errors import InfrastructureError


class CutMeanwhileError(InfrastructureError):
    """A snapshot has dropped what was to be read."""


class JournalRows:
    """Reads what is committed; from any thread.

    Args:
        connection: of the journal.
        path: its file.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.lock = threading.RLock()
        """Held while a transaction is written: nobody reads half of one."""
        self.chain = Chain()
        """Where the journal stands: as of the last commit."""
        self.cuts = 0
        """Snapshots that were taken."""
        self._connection, self._path = connection, path

    def point(self, workers: set[str] | None) -> JournalPoint:
        """Where the journal stands, and replies to these workers; None: all there are.

        Raises:
            InfrastructureError: the storage refuses.
        """
        with self._reading() as execute:
            (last,) = execute("SELECT COALESCE(MAX(id), 0) FROM facts").fetchone()
            query = "SELECT worker, seq, reply FROM replies"
            if workers is None:
                replies: list[Reply] = execute(f"{query} ORDER BY worker").fetchall()
            else:
                replies = []
                for worker in sorted(workers):
                    row = execute(f"{query} WHERE worker = ?", (worker,)).fetchone()
                    replies.append(row or (worker, 0, b""))
            return JournalPoint(self.chain, self.cuts, last, replies)

    def image_keys(self) -> set[str]:
        """Keys of all images."""
        with self._reading() as execute:
            return {key for (key,) in execute("SELECT key FROM snapshot")}

    def images(
        self, point: JournalPoint, keys: set[str], size_max: int
    ) -> Iterator[list[tuple[str, bytes]]]:
        """Images as of ``point``, in lists of at most ``size_max`` bytes or one image.

        Raises:
            CutMeanwhileError: they are others by now.
            InfrastructureError: the storage refuses.
        """
        some: list[tuple[str, bytes]] = []
        size = 0
        for key in sorted(keys):
            with self._reading(point) as execute:
                row = execute("SELECT image FROM snapshot WHERE key = ?", (key,)).fetchone()
            if row is None:
                continue
            if some and size + len(row[0]) > size_max:
                yield some
                some, size = [], 0
            some.append((key, row[0]))
            size += len(row[0])
        if some:
            yield some

    def facts(self, point: JournalPoint, after: int, size_max: int) -> Iterator[list[Row]]:
        """Facts behind number ``after`` up to ``point``, in lists of at most ``size_max`` bytes or
        one fact.

        Raises:
            CutMeanwhileError: they are gone.
            InfrastructureError: the storage refuses.
        """
        query = (
            "SELECT id, unix_s, fact, chain, LENGTH(fact) FROM facts WHERE id > ? AND id <= ? "
            "ORDER BY id"
        )
        while after < point.last:
            some: list[Row] = []
            size = 0
            with self._reading(point) as execute:
                for number, unix_s, fact, link, length in execute(query, (after, point.last)):
                    if some and size + length > size_max:
                        break
                    some.append((unix_s, fact, link))
                    size += length
                    after = number
            if not some:
                return
            yield some

    @contextlib.contextmanager
    def _reading(
        self, point: JournalPoint | None = None
    ) -> Iterator[Callable[..., sqlite3.Cursor]]:
        with self.lock:
            if point is not None and point.cuts != self.cuts:
                raise CutMeanwhileError("a snapshot was taken")
            cursor = None
            try:
                cursor = self._connection.cursor()
                yield cursor.execute
            except sqlite3.Error as error:
                raise InfrastructureError(f"storage: {self._path}: {escape(str(error))}") from None
            finally:
                if cursor is not None:
                    with contextlib.suppress(sqlite3.Error):
                        cursor.close()
