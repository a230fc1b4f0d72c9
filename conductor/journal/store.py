"""The journal: durable facts in SQLite, a hash chain. The only module that imports sqlite3.

One folder, one file, one process: the connection holds the lock of ``conductor.db`` as long as it
is open, and the system drops the lock when the process dies. Exclusive locking needs no shared
memory file, so the folder may lie on a network file system.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import msgspec

from conductor.core.facts import Durable, Fact, Image, Replied, Snapshot, WorkerLeft, is_durable
from conductor.journal.chain import (
    BEGIN,
    Chain,
    cut_head,
    fact_link,
    image_digest,
    reply_digest,
    reply_sum,
)
from conductor.journal.owner import (
    FolderClaim,
    FolderLockedError,
    FolderOwner,
    TakenOverError,
    this_process,
)
from conductor.journal.rows import JournalRows
from conductor.journal.written import Changes, JournalMirror, JournalPart
from schemas.escape import escape
from schemas.wire.codec import WireError, decode, encode
from twin.base.errors import InfrastructureError, TwinError, UsageError

VERSION = 4
"""Layout of the tables and facts. 3: cases are one mapping, without rig and variation."""

FIRST_STAGE = ("1", "2", "3")
"""Versions that release 0.1 has written, which has to finish what it has begun."""

READABLE = ("3", str(VERSION))
"""Versions whose chain and results a finished journal is checked by."""

FACT_BYTES_MAX = 1 << 30
"""Largest fact [bytes]: a campaign of the largest number of cases."""

FILE_NAME = "conductor.db"
LOG_BYTES = 32 + 1000 * (24 + 4096)
"""Size of SQLite's log when its 1,000 pages are full and it begins anew [bytes]."""
LOG_ROOM = 64
"""It gets that size at once if so many times as much is free."""
STALE_S = 45.0
"""Three times the time to live of a lease: by then the workers of a dead conductor are idle [s]."""

_TABLES = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS facts (
    id INTEGER PRIMARY KEY, unix_s REAL NOT NULL, fact BLOB NOT NULL, chain BLOB
);
CREATE TABLE IF NOT EXISTS snapshot (key TEXT PRIMARY KEY, image BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS replies (
    worker TEXT PRIMARY KEY, seq INTEGER NOT NULL, reply BLOB NOT NULL
);
"""

# Not INSERT OR REPLACE: a row in the same place leaves the pages of the index alone.
_PUT_REPLY = (
    "INSERT INTO replies VALUES (?, ?, ?) "
    "ON CONFLICT (worker) DO UPDATE SET seq = excluded.seq, reply = excluded.reply"
)
_PUT_CHAIN = (
    "INSERT INTO meta VALUES ('chain', ?) ON CONFLICT (name) DO UPDATE SET value = excluded.value"
)

__all__ = ["FolderLockedError", "Journal", "JournalError", "TakenOverError"]


class JournalError(InfrastructureError):
    """The storage refused; nothing of the failed call was written. One line."""


class Journal:
    """The journal of one state folder, opened for writing."""

    def __init__(
        self, folder: Path, stale_s: float = STALE_S, owner: FolderOwner | None = None
    ) -> None:
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
        self._images: dict[str, bytes] | None = None
        """Digests of the images of the snapshot; None: not looked at yet."""
        self._replies: dict[str, bytes] = {}
        """Digests of the replies that this process has written, by worker."""
        self.mirror: JournalMirror | None = None
        """Keeps a copy of what is written; None: there is none."""
        self._changes = Changes()
        """What the transaction has changed so far."""
        self._claim = FolderClaim(folder, owner or this_process(), stale_s)
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
                f"{self.path}: cannot be opened ({escape(str(error))}); check the folder"
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
            if self.mirror is not None:
                self.mirror.check()
            return
        with self.rows.lock:
            self._append(durable, time.time())

    def _append(self, durable: Sequence[Fact], now_s: float) -> None:
        self._changes = Changes()
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            chain = self._write(durable, now_s)
            self._write_chain(chain)
            self._claim.check()
            if self.mirror is not None:
                self.mirror.check()
            self._connection.execute("COMMIT")
            self.rows.chain = chain
        except BaseException as error:  # whatever it is, the next call begins a transaction
            self._rollback()
            if not isinstance(error, sqlite3.Error):
                raise
            raise JournalError(
                f"storage: {self.path}: {escape(str(error))}; free some space, then retry"
            ) from None
        self.rows.cuts += self._changes.cut
        if self.mirror is not None:
            self.mirror.committed(self._changes)

    @property
    def chain(self) -> Chain:
        """Where it stands: as of the last commit."""
        return self.rows.chain

    def probe(self) -> None:
        """Write something that changes nothing.

        Raises:
            JournalError: the storage still refuses.
        """
        try:
            with self.rows.lock:
                self._connection.execute(
                    "INSERT OR REPLACE INTO meta VALUES ('probed', ?)", (str(time.time()),)
                )
        except sqlite3.Error as error:
            self._rollback()
            raise JournalError(
                f"storage: {self.path}: {escape(str(error))}; free some space, then retry"
            ) from None

    def fold(self) -> Iterator[Fact]:
        """The latest snapshot, the facts after it in order, then each worker's latest reply.

        Raises:
            JournalError: the file is damaged, or its chain does not fit.
            TakenOverError: another conductor writes it now.
        """
        self._claim.check()
        if self.mirror is not None:
            self.mirror.check()
        yield from _folded(self._connection, self.path, self.chain)

    def close(self) -> None:
        """Release the lock; the file is complete at any time, also without this call."""
        self._claim.release()
        with self.rows.lock, contextlib.suppress(sqlite3.Error):
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
        version = _version(self._connection)
        if version != str(VERSION):
            raise _unknown_version(self.path, version)
        self.rows = JournalRows(self._connection, self.path)
        self.rows.chain = _read_chain(self._connection, self.path)
        self._claim_folder()
        extend_log(self.path)

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

    def _write(self, facts: Sequence[Fact], now_s: float) -> Chain:
        """Write facts behind the chain; where the journal stands then."""
        chain = self.chain
        links: list[bytes] = []
        for fact in facts:
            if isinstance(fact, Replied):
                chain = self._write_reply(fact, chain)
            elif isinstance(fact, Snapshot):
                # Also those before it are links, and deleted at once.
                chain = self._write_links(links, now_s, chain)
                links = []
                chain = self._write_snapshot(fact, now_s, chain)
            else:
                if isinstance(fact, WorkerLeft):
                    chain = self._forget_reply(fact.worker, chain)
                links.append(encode(fact))
        return self._write_links(links, now_s, chain)

    def _write_links(self, links: Sequence[bytes], now_s: float, chain: Chain) -> Chain:
        chain, heads = chain.facts(links, now_s)
        rows = zip(repeat(now_s), links, heads, strict=False)
        query = "INSERT INTO facts (unix_s, fact, chain) VALUES (?, ?, ?)"
        self._connection.executemany(query, rows)
        return chain

    def _write_snapshot(self, fact: Snapshot, now_s: float, chain: Chain) -> Chain:
        self._connection.executemany(
            "INSERT OR REPLACE INTO snapshot VALUES (?, ?)",
            ((image.key, image.data) for image in fact.images),
        )
        self._connection.execute("DELETE FROM facts")
        self._changes.images |= {image.key for image in fact.images}
        self._changes.cut = True
        if self._images is None:
            self._images = _image_digests(self._connection, self.path)
        self._images.update((image.key, image_digest(image.data)) for image in fact.images)
        return chain.snapshot(self._images, now_s)

    def _write_reply(self, fact: Replied, chain: Chain) -> Chain:
        row = (fact.worker, fact.seq, encode(fact))
        old = self._reply_digest_of(fact.worker)
        self._connection.execute(_PUT_REPLY, row)
        self._changes.workers.add(fact.worker)
        self._replies[fact.worker] = digest = reply_digest(*row)
        return chain.replied(old, digest)

    def _forget_reply(self, worker: str, chain: Chain) -> Chain:
        chain = chain.replied(self._reply_digest_of(worker), b"")
        self._replies.pop(worker, None)
        self._connection.execute("DELETE FROM replies WHERE worker = ?", (worker,))
        self._changes.workers.add(worker)
        return chain

    def _reply_digest_of(self, worker: str) -> bytes:
        """Digest of the reply that is kept for ``worker``; empty: none."""
        if worker in self._replies:
            return self._replies[worker]
        query = "SELECT worker, seq, reply FROM replies WHERE worker = ?"
        row = self._connection.execute(query, (worker,)).fetchone()
        return _reply_digest(row, self.path) if row else b""

    def _write_chain(self, chain: Chain) -> None:
        self._connection.execute(_PUT_CHAIN, (msgspec.json.encode(chain).decode(),))

    def _rollback(self) -> None:
        self._images = None  # it may hold what was not committed
        self._replies.clear()
        # SQLite rolls back by itself when the disk is full.
        if self._connection.in_transaction:
            with contextlib.suppress(sqlite3.Error):
                self._connection.execute("ROLLBACK")

    def _explain(self, error: sqlite3.Error) -> Exception:
        words = escape(str(error))  # of a damaged file SQLite quotes what stands in it
        if "locked" in words or "busy" in words:
            return FolderLockedError(f"{self.path}: in use by another conductor")
        if "readonly" in words:
            return UsageError(f"{self.path}: {words}; choose a folder that can be written")
        if "not a database" in words:
            return UsageError(f"{self.path}: {words}; choose another folder")
        return JournalError(f"storage: {self.path}: {words}")


def extend_log(path: Path) -> None:
    """Give SQLite's log the size that it comes to anyway, in zeros that SQLite takes for no frame.

    A commit that is written over them needs no new blocks, so the disk has one thing less to wait
    for. Where there is little room, or it cannot be written, the log grows as it goes.
    """
    log = path.with_name(f"{path.name}-wal")
    with contextlib.suppress(OSError):
        space = os.statvfs(path.parent)
        if space.f_bavail * space.f_frsize < LOG_ROOM * LOG_BYTES:
            return
        with open(log, "r+b", buffering=0, opener=_no_link) as file:
            size = file.seek(0, os.SEEK_END)
            file.write(bytes(max(0, LOG_BYTES - size)))


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC)


def write_journal(folder: Path, chain: Chain, parts: Iterable[JournalPart]) -> None:
    """Write a journal anew from the parts of a copy; :meth:`Journal.fold` holds it against its
    chain.

    Raises:
        UsageError: the folder has one.
        JournalError: it cannot be written.
        TwinError: what ``parts`` raises; nothing is left behind.
    """
    path = folder / FILE_NAME
    if path.exists():
        raise UsageError(f"{path}: is there already; give an empty folder")
    new = path.with_name(f".{path.name}.new")
    try:
        new.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(new, isolation_level=None)) as connection:
            connection.execute("BEGIN")
            for statement in _TABLES.split(";"):
                connection.execute(statement)
            put, many = connection.execute, connection.executemany
            put("INSERT INTO meta VALUES ('version', ?)", (str(VERSION),))
            put(_PUT_CHAIN, (msgspec.json.encode(chain).decode(),))
            for part in parts:
                many("INSERT INTO facts (unix_s, fact, chain) VALUES (?, ?, ?)", part.facts)
                many("INSERT OR REPLACE INTO snapshot VALUES (?, ?)", part.images)
                for worker, seq, reply in part.replies:
                    if reply:
                        put(_PUT_REPLY, (worker, seq, reply))
                    else:
                        put("DELETE FROM replies WHERE worker = ?", (worker,))
            put("COMMIT")
        new.replace(path)
    except (sqlite3.Error, OSError) as error:
        raise JournalError(
            f"storage: {path}: {escape(str(error))}; free some space, then retry"
        ) from None
    finally:
        new.unlink(missing_ok=True)


def read_journal(path: Path) -> tuple[Chain, Iterator[Fact]]:
    """Where the finished journal ``path`` stands, and its facts as :meth:`Journal.fold` gives them.

    Nothing is written or locked, so it must not be in use. The connection is closed when the facts
    are used up.

    Raises:
        UsageError: it is none, or of another version.
        JournalError: it is damaged.
    """
    try:
        # No other process writes it: SQLite need not look for a log or a lock.
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        connection = sqlite3.connect(uri, uri=True)
    except sqlite3.Error as error:
        raise UsageError(f"{path}: cannot be opened ({escape(str(error))})") from None
    try:
        version = _version(connection)
        if version not in READABLE:
            raise _unknown_version(path, version)
        chain = _read_chain(connection, path)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        connection.close()
        raise JournalError(f"{path}: cannot be read: {escape(str(error))}") from None
    except TwinError:
        connection.close()
        raise

    def facts() -> Iterator[Fact]:
        with contextlib.closing(connection):
            yield from _folded(connection, path, chain)

    return chain, facts()


def _folded(connection: sqlite3.Connection, path: Path, chain: Chain) -> Iterator[Fact]:
    """Snapshot, facts and replies; each is held against ``chain``, which the journal says of
    itself."""
    execute = connection.execute
    try:
        images = [_image(path, *row) for row in execute("SELECT key, image FROM snapshot")]
        head, count = _start(path, chain, {i.key: image_digest(i.data) for i in images})
        if images:
            yield Snapshot(images=images)
            del images
        for row, unix_s, data, link in execute(
            "SELECT id, unix_s, fact, chain FROM facts ORDER BY id"
        ):
            what = f"fact {row}"
            fact = _decode(path, data, what)
            if not isinstance(unix_s, float):
                raise JournalError(f"{path}: {what} is damaged: no time")
            head, count = fact_link(head, data, unix_s), count + 1
            if link != head:
                raise _broken(path, f"{what} is not the one that was written there")
            yield fact
        if (head, count) != (chain.head, chain.count):
            raise _broken(path, f"it ends with fact {count} instead of {chain.count}")
        replies = []
        for row in execute("SELECT worker, seq, reply FROM replies"):
            replies.append(_reply_digest(row, path))
            yield _decode(path, row[2], f"the reply to {row[0]}")
        if reply_sum(replies) != chain.replies:
            raise _broken(path, "a reply is not the one that was written")
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise JournalError(f"{path}: cannot be read: {escape(str(error))}") from None


def _start(path: Path, chain: Chain, images: dict[str, bytes]) -> tuple[bytes, int]:
    """Head and count behind the snapshot, from which the chain of the facts goes on."""
    if chain.cut is None:
        if images:
            raise _broken(path, "it has a snapshot that was not written there")
        return BEGIN, 0
    head = cut_head(chain.cut, images)
    return head, chain.cut.count


def _broken(path: Path, what: str) -> JournalError:
    return JournalError(
        f"{path}: the chain of facts does not fit: {escape(what, 120)}; changed by somebody; put "
        "back a copy, or choose another folder"
    )


def _version(connection: sqlite3.Connection) -> str:
    """Version of the tables and facts; a damaged one is none that is known."""
    query = "SELECT value FROM meta WHERE name = 'version'"
    with contextlib.suppress(UnicodeDecodeError):
        row = connection.execute(query).fetchone()
        return escape(str(row[0]), 40) if row else "none"
    return "unreadable"


def _unknown_version(path: Path, version: str) -> UsageError:
    if version in FIRST_STAGE and path.with_name("manifest.json").exists():  # its last file
        return UsageError(
            f"{path}: drivetwin 0.1 has run and finished it; to run its campaign again give another"
            " folder; report, compare, export, fingerprint, verify and viewer read it as it is"
        )
    if version in FIRST_STAGE:
        return UsageError(
            f"{path}: begun by drivetwin 0.1 (version {version} of the journal, this program goes "
            f"on with {VERSION}); finish it with that release, or give another folder; report, "
            "compare, export, fingerprint and viewer read what it has as it is"
        )
    return UsageError(
        f"{path}: written by version {version} of the journal, this program knows {VERSION}; "
        "choose another folder or the program that wrote it"
    )


def _read_chain(connection: sqlite3.Connection, path: Path) -> Chain:
    try:
        row = connection.execute("SELECT value FROM meta WHERE name = 'chain'").fetchone()
        # A new journal is its beginning; of one whose facts are there, their count differs.
        return msgspec.json.decode(row[0], type=Chain) if row else Chain()
    except (msgspec.MsgspecError, UnicodeDecodeError, TypeError):
        raise _broken(path, "what it says of its head cannot be read") from None


def _image_digests(connection: sqlite3.Connection, path: Path) -> dict[str, bytes]:
    rows = connection.execute("SELECT key, image FROM snapshot")
    return {image.key: image_digest(image.data) for image in (_image(path, *row) for row in rows)}


def _reply_digest(row: tuple[Any, Any, Any], path: Path) -> bytes:
    worker, seq, data = row
    if not (isinstance(worker, str) and isinstance(seq, int)):
        raise JournalError(f"{path}: a reply is damaged")
    return reply_digest(worker, seq, _as_bytes(data, path, f"the reply to {worker}"))


def _image(path: Path, key: Any, data: Any) -> Image:
    # A damaged row may hold anything, whatever its column says.
    if not isinstance(key, str) or not isinstance(data, bytes):
        raise JournalError(f"{path}: a snapshot is damaged")
    return Image(key, data)


def _as_bytes(data: Any, path: Path, what: str) -> bytes:
    if not isinstance(data, bytes):
        raise JournalError(f"{path}: {escape(what, 80)} is damaged: no bytes")
    return data


def _decode(path: Path, data: Any, what: str) -> Fact:
    try:
        fact: Fact = decode(_as_bytes(data, path, what), Durable, size_max=FACT_BYTES_MAX)
    except WireError as error:
        raise JournalError(f"{path}: {what} is damaged: {error}") from None
    return fact
