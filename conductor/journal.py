"""The journal: durable facts in SQLite. The only module that imports sqlite3.

One folder, one file, one process: the connection holds the lock of ``conductor.db`` as long as it
is open, and the system drops the lock when the process dies. Exclusive locking needs no shared
memory file, so the folder may lie on a network file system.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from conductor.facts import Durable, Fact, Image, Replied, Snapshot, WorkerLeft, is_durable
from conductor.owner import Claim, FolderLockedError, Owner, TakenOverError, this_process
from schemas.wire import WireError, decode, encode
from schemas.words import plain
from twin.fabric.errors import InfrastructureError, UsageError

VERSION = 2
"""Layout of the tables and facts. 1: no snapshots. Older ones are brought forward when opened."""

FACT_BYTES_MAX = 1 << 30
"""Largest fact [bytes]: a campaign of the largest number of cases."""

FILE_NAME = "conductor.db"
STALE_S = 45.0
"""Three times the time to live of a lease: by then the workers of a dead conductor are idle [s]."""

_TABLES = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS facts (
    id INTEGER PRIMARY KEY, unix_s REAL NOT NULL, fact BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS snapshot (key TEXT PRIMARY KEY, image BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS replies (
    worker TEXT PRIMARY KEY, seq INTEGER NOT NULL, reply BLOB NOT NULL
);
"""


__all__ = ["FolderLockedError", "Journal", "JournalError", "TakenOverError"]


class JournalError(InfrastructureError):
    """The storage refused; nothing of the failed call was written. One line."""


class Journal:
    """The journal of one state folder, opened for writing."""

    def __init__(self, folder: Path, stale_s: float = STALE_S, owner: Owner | None = None) -> None:
        """Open or create the journal, and lock it.

        Args:
            folder: state folder.
            stale_s: silence after which the conductor of another host is taken for dead [s].
            owner: who opens it; this process if left out.

        Raises:
            FolderLockedError: another conductor has it open.
            UsageError: the folder cannot be written, or holds a journal of another version.
            JournalError: storage error.
        """
        self.path = folder / FILE_NAME
        self._claim = Claim(folder, owner or this_process(), stale_s)
        obstacle = self._claim.obstacle()
        if obstacle:
            raise FolderLockedError(f"{self.path}: in use by another conductor {obstacle}")
        try:
            self._connect()
        except FolderLockedError:
            if not self._claim.of_another_host():
                raise
            # The lock of a host that died; its conductor was silent for too long.
            self._claim.take()
            self._leave_locked_file()
            self._connect()

    def _connect(self) -> None:
        try:
            self._connection = sqlite3.connect(
                self.path, timeout=0.0, isolation_level=None, check_same_thread=False
            )
        except sqlite3.Error as error:
            raise UsageError(
                f"{self.path}: cannot be opened ({plain(str(error))}); check the folder"
            ) from None
        try:
            self._open()
        except sqlite3.Error as error:
            self._connection.close()
            raise self._explain(error) from None
        except UnicodeDecodeError:  # SQLite quotes the damaged bytes in its error
            self._connection.close()
            raise UsageError(
                f"{self.path}: damaged; put back a copy, or choose another folder"
            ) from None
        except UsageError:
            self._connection.close()
            raise

    def append(self, facts: Sequence[Fact]) -> None:
        """Write the durable ones of ``facts`` in one transaction, on disk when this returns.

        Raises:
            JournalError: nothing was written; a later call may succeed.
            TakenOverError: nothing was written, and nothing ever will be.
            Exception: a fact cannot be stored; nothing was written.
        """
        durable = [fact for fact in facts if is_durable(fact)]
        if not durable:
            if self._claim.due():
                self._claim.check()
            return
        now_s = time.time()
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            for fact in durable:
                self._write(fact, now_s)
            self._claim.check()
            self._connection.execute("COMMIT")
        except BaseException as error:  # whatever it is, the next call begins a transaction
            self._rollback()
            if not isinstance(error, sqlite3.Error):
                raise
            raise JournalError(
                f"storage: {self.path}: {plain(str(error))}; free some space, then retry"
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
                f"storage: {self.path}: {plain(str(error))}; free some space, then retry"
            ) from None

    def fold(self) -> Iterator[Fact]:
        """The latest snapshot, the facts after it in order, then each worker's latest reply.

        Raises:
            JournalError: the file is damaged.
            TakenOverError: another conductor writes it now.
        """
        self._claim.check()
        execute = self._connection.execute
        try:
            images = [self._image(*row) for row in execute("SELECT key, image FROM snapshot")]
            if images:
                yield Snapshot(images=images)
                del images
            for row, data in execute("SELECT id, fact FROM facts ORDER BY id"):
                yield self._decode(data, f"fact {row}")
            for worker, data in execute("SELECT worker, reply FROM replies"):
                yield self._decode(data, f"the reply to {worker}")
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise JournalError(f"{self.path}: cannot be read: {plain(str(error))}") from None

    def close(self) -> None:
        """Release the lock; the file is complete at any time, also without this call."""
        self._claim.release()
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
        version = self._version()
        if version == "1":
            # Facts of version 1 lack fields that have defaults; the new table is there by now.
            execute("UPDATE meta SET value = ? WHERE name = 'version'", (str(VERSION),))
        elif version != str(VERSION):
            raise UsageError(
                f"{self.path}: written by version {version} of the journal, this program knows "
                f"{VERSION}; choose another folder or the program that wrote it"
            )

        self._claim_folder()

    def _version(self) -> str:
        """Of the tables and facts; a damaged one is none that is known."""
        query = "SELECT value FROM meta WHERE name = 'version'"
        with contextlib.suppress(UnicodeDecodeError):
            row = self._connection.execute(query).fetchone()
            return plain(str(row[0]), 40) if row else "none"
        return "unreadable"

    def _claim_folder(self) -> None:
        try:
            self._claim.take()
        except OSError as error:
            raise UsageError(f"{self.path}: {error.strerror}; choose another folder") from None
        self._connection.execute(
            "INSERT OR REPLACE INTO meta VALUES ('owner', ?)",
            (msgspec.json.encode(self._claim.me).decode(),),
        )

    def _leave_locked_file(self) -> None:
        """Go on with a copy: whoever still holds the old file's lock writes where nobody reads.

        A crash in between leaves the new file beside the old log, which are the same bytes.
        """
        for suffix in ("", "-wal"):
            path = self.path.with_name(self.path.name + suffix)
            copy = path.with_name(f".{path.name}.{self._claim.me.id}.tmp")
            if path.exists():
                shutil.copyfile(path, copy)
                copy.replace(path)

    def _write(self, fact: Fact, now_s: float) -> None:
        if isinstance(fact, Replied):
            self._connection.execute(
                "INSERT OR REPLACE INTO replies VALUES (?, ?, ?)",
                (fact.worker, fact.seq, encode(fact)),
            )
            return
        if isinstance(fact, Snapshot):
            self._connection.executemany(
                "INSERT OR REPLACE INTO snapshot VALUES (?, ?)",
                ((image.key, image.data) for image in fact.images),
            )
            self._connection.execute("DELETE FROM facts")
            return
        if isinstance(fact, WorkerLeft):
            self._connection.execute("DELETE FROM replies WHERE worker = ?", (fact.worker,))
        self._connection.execute(
            "INSERT INTO facts (unix_s, fact) VALUES (?, ?)", (now_s, encode(fact))
        )

    def _image(self, key: Any, data: Any) -> Image:
        # A damaged row may hold anything, whatever its column says.
        if not isinstance(key, str) or not isinstance(data, bytes):
            raise JournalError(f"{self.path}: a snapshot is damaged")
        return Image(key, data)

    def _decode(self, data: Any, what: str) -> Fact:
        if not isinstance(data, bytes):
            raise JournalError(f"{self.path}: {plain(what, 80)} is damaged: no bytes")
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
        words = plain(str(error))  # of a damaged file SQLite quotes what stands in it
        if "locked" in words or "busy" in words:
            return FolderLockedError(f"{self.path}: in use by another conductor")
        if "readonly" in words:
            return UsageError(f"{self.path}: {words}; choose a folder that can be written")
        if "not a database" in words:
            return UsageError(f"{self.path}: {words}; choose another folder")
        return JournalError(f"storage: {self.path}: {words}")
