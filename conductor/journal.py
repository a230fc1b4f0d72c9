"""The journal: durable facts in SQLite. The only module that imports sqlite3.

One folder, one file, one process: the connection holds the lock of ``conductor.db`` as long as it
is open, and the system drops the lock when the process dies. Exclusive locking needs no shared
memory file, so the folder may lie on a network file system.
"""

from __future__ import annotations

import contextlib
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from conductor.facts import Durable, Fact, Replied, WorkerLeft, is_durable
from schemas.wire import WireError, decode, encode
from twin.fabric.errors import InfrastructureError, UsageError

VERSION = 1
"""Layout of the tables and facts."""

FACT_BYTES_MAX = 1 << 30
"""Largest fact [bytes]: a campaign of the largest number of cases."""

FILE_NAME = "conductor.db"

_TABLES = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS facts (
    id INTEGER PRIMARY KEY, unix_s REAL NOT NULL, fact BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS replies (
    worker TEXT PRIMARY KEY, seq INTEGER NOT NULL, reply BLOB NOT NULL
);
"""


class JournalError(InfrastructureError):
    """The storage refused; nothing of the failed call was written. One line."""


class FolderLockedError(UsageError):
    """Another process has the journal open."""


class Journal:
    """The journal of one state folder, opened for writing."""

    def __init__(self, folder: Path) -> None:
        """Open or create the journal, and lock it.

        Raises:
            FolderLockedError: another conductor has it open.
            UsageError: the folder cannot be written, or holds a journal of another version.
            JournalError: storage error.
        """
        self.path = folder / FILE_NAME
        try:
            self._connection = sqlite3.connect(
                self.path, timeout=0.0, isolation_level=None, check_same_thread=False
            )
        except sqlite3.Error as error:
            raise UsageError(f"{self.path}: cannot be opened ({error}); check the folder") from None
        try:
            self._open()
        except sqlite3.Error as error:
            self._connection.close()
            raise self._explain(error) from None
        except UsageError:
            self._connection.close()
            raise

    def append(self, facts: Sequence[Fact]) -> None:
        """Write the durable ones of ``facts`` in one transaction, on disk when this returns.

        Raises:
            JournalError: nothing was written; a later call may succeed.
        """
        durable = [fact for fact in facts if is_durable(fact)]
        if not durable:
            return
        now_s = time.time()
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            for fact in durable:
                self._write(fact, now_s)
            self._connection.execute("COMMIT")
        except sqlite3.Error as error:
            self._rollback()
            raise JournalError(
                f"storage: {self.path}: {error}; free some space, then retry"
            ) from None

    def probe(self) -> None:
        """Write something that changes nothing.

        Raises:
            JournalError: the storage still refuses.
        """
        try:
            self._connection.execute(
                "INSERT OR REPLACE INTO meta VALUES ('probed', ?)", (str(time.time()),)
            )
        except sqlite3.Error as error:
            self._rollback()
            raise JournalError(
                f"storage: {self.path}: {error}; free some space, then retry"
            ) from None

    def fold(self) -> Iterator[Fact]:
        """All facts in the order they were appended, then each worker's latest reply.

        Raises:
            JournalError: the file is damaged.
        """
        try:
            for row, data in self._connection.execute("SELECT id, fact FROM facts ORDER BY id"):
                yield self._decode(data, f"fact {row}")
            for worker, data in self._connection.execute("SELECT worker, reply FROM replies"):
                yield self._decode(data, f"the reply to {worker}")
        except sqlite3.Error as error:
            raise JournalError(f"{self.path}: cannot be read: {error}") from None

    def close(self) -> None:
        """Release the lock; the file is complete at any time, also without this call."""
        with contextlib.suppress(sqlite3.Error):
            self._connection.close()

    def _open(self) -> None:
        execute = self._connection.execute
        execute("PRAGMA locking_mode=EXCLUSIVE")
        execute("PRAGMA journal_mode=WAL")
        execute("PRAGMA synchronous=FULL")
        execute("BEGIN IMMEDIATE")
        for statement in _TABLES.split(";"):
            execute(statement)
        execute("INSERT OR IGNORE INTO meta VALUES ('version', ?)", (str(VERSION),))
        execute("COMMIT")
        (version,) = execute("SELECT value FROM meta WHERE name = 'version'").fetchone()
        if version != str(VERSION):
            raise UsageError(
                f"{self.path}: written by version {version} of the journal, this program knows "
                f"{VERSION}; choose another folder or the program that wrote it"
            )

    def _write(self, fact: Fact, now_s: float) -> None:
        if isinstance(fact, Replied):
            self._connection.execute(
                "INSERT OR REPLACE INTO replies VALUES (?, ?, ?)",
                (fact.worker, fact.seq, encode(fact)),
            )
            return
        if isinstance(fact, WorkerLeft):
            self._connection.execute("DELETE FROM replies WHERE worker = ?", (fact.worker,))
        self._connection.execute(
            "INSERT INTO facts (unix_s, fact) VALUES (?, ?)", (now_s, encode(fact))
        )

    def _decode(self, data: bytes, what: str) -> Fact:
        try:
            fact: Fact = decode(data, Durable, size_max=FACT_BYTES_MAX)
        except WireError as error:
            raise JournalError(f"{self.path}: {what} is damaged: {error}") from None
        return fact

    def _rollback(self) -> None:
        # SQLite rolls back by itself when the disk is full.
        if self._connection.in_transaction:
            with contextlib.suppress(sqlite3.Error):
                self._connection.execute("ROLLBACK")

    def _explain(self, error: sqlite3.Error) -> Exception:
        if "locked" in str(error) or "busy" in str(error):
            return FolderLockedError(f"{self.path}: in use by another conductor")
        if "readonly" in str(error):
            return UsageError(f"{self.path}: {error}; choose a folder that can be written")
        if "not a database" in str(error):
            return UsageError(f"{self.path}: {error}; choose another folder")
        return JournalError(f"storage: {self.path}: {error}")
