"""A result store whose libraries run in a process of their own.

The client of an object store takes forty megabytes, half a second of processor time to begin, and a
good part of one processor while it sends. A conductor keeps both to its own work: it writes what is
to be put into a socket, and a child does the rest. The child ends when the socket does; one that
has died is started again by the next call.

A message is its length and that of the data behind it, a list, and the data.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from schemas.files.regular_file import read_regular
from twin.base.errors import InfrastructureError, TwinError, UsageError, storage_error
from twin.base.process import (
    PARENT_VARIABLE,
    keep_to_itself,
    leave_signals_to_the_parent,
    spawn,
)
from twin.stores.objects import put_object
from twin.stores.opening import kind_of, open_store
from twin.stores.protocol import (
    SMALL_BYTES_MAX,
    DamagedObjectError,
    MissingObjectError,
    ResultStore,
    StoreError,
    StoreRefusedError,
)

CALLS_MAX = 32
"""Calls that are under way at a time; further ones wait."""
ANSWER_S_MAX = 300
"""Longest wait for the answer to a call; then the process is ended, and the call has failed [s]."""
MESSAGE_BYTES_MAX = 1 << 31
"""Largest message between the two [bytes]."""
RECEIVE_BYTES = 1 << 20
"""Most that is taken from the socket at a time [bytes]."""

_LENGTHS = struct.Struct("<IQ")
_TIME = struct.Struct("@ll")
_ERRORS: dict[str, type[Exception]] = {
    error.__name__: error
    for error in (
        *(StoreError, StoreRefusedError, MissingObjectError, DamagedObjectError),
        *(UsageError, InfrastructureError),
        FileNotFoundError,
    )
}


def open_apart(url: str) -> ResultStore:
    """The store that ``url`` names; if its libraries are large, in a process of its own.

    Raises:
        TwinError: there is none, a package is missing, or it cannot be made; one line.
    """
    return StoreApart(url) if kind_of(url).apart else open_store(url)


def put_file(store: ResultStore, name: str, path: Path, size_max: int) -> None:
    """Write an object with the content of a file; it does not come into this process if the store
    runs apart.

    Raises:
        OSError: the file cannot be read.
        TwinError: the store does not answer.
    """
    if isinstance(store, StoreApart):
        store.put_file(name, path, size_max)
    else:
        store.put(name, read_regular(path, size_max))


def put_content(store: ResultStore, data: bytes) -> str:
    """As :func:`twin.stores.objects.put_object`; a store that runs apart computes the digest."""
    return store.put_object(data) if isinstance(store, StoreApart) else put_object(store, data)


def end_process(store: ResultStore) -> None:
    """End the process of a store that runs apart; a later call starts another."""
    if isinstance(store, StoreApart):
        store.close()


class StoreApart:
    """See :class:`twin.stores.protocol.ResultStore`.

    Raises:
        TwinError: as :func:`twin.stores.opening.open_store`.
    """

    def __init__(self, url: str) -> None:
        self._given = url
        self._lock = threading.Lock()
        self._slots = threading.BoundedSemaphore(CALLS_MAX)
        self._line: _Line | None = None
        self.url = str(self._ask("url", "")[0])

    def put(self, name: str, data: bytes) -> None:
        """See the protocol."""
        self._ask("put", name, data)

    def create(self, name: str, data: bytes) -> bool:
        """See the protocol."""
        return bool(self._ask("create", name, data)[0])

    def get(self, name: str, size_max: int = SMALL_BYTES_MAX) -> bytes:
        """See the protocol."""
        return self._ask("get", name, size_max=size_max)[1]

    def names(self, prefix: str) -> list[str]:
        """See the protocol."""
        return msgspec.convert(self._ask("names", prefix)[0], list[str])

    def delete(self, name: str) -> None:
        """See the protocol."""
        self._ask("delete", name)

    def put_object(self, data: bytes) -> str:
        """Put a content, which the process names; its digest."""
        return str(self._ask("put_object", "", data)[0])

    def put_file(self, name: str, path: Path, size_max: int) -> None:
        """Write an object with the content of a file, which the process reads.

        Raises:
            FileNotFoundError: it cannot be read.
            TwinError: as :meth:`put`.
        """
        self._ask("put_file", name, os.fsencode(path.absolute()), size_max)

    @property
    def pid(self) -> int:
        """Number of the process; 0: it has ended, and the next call starts another."""
        line = self._line
        return line.child.pid if line is not None and not line.is_over else 0

    @property
    def under_way(self) -> int:
        """Calls that the process has not answered yet."""
        line = self._line
        return len(line.asked) if line is not None else 0

    def close(self) -> None:
        """End the process; a later call starts another."""
        with self._lock:
            line, self._line = self._line, None
        if line is not None:
            line.close()

    def _ask(self, what: str, name: str, data: bytes = b"", size_max: int = 0) -> tuple[Any, bytes]:
        with self._slots:
            line = self._open_line()
            try:
                return line.ask([what, name, size_max], data).result(ANSWER_S_MAX)
            except FutureTimeoutError:
                line.close()
                raise StoreError(
                    f"{self._given}: {what} {name}: no answer in {ANSWER_S_MAX:g} s; it will be "
                    "tried again"
                ) from None

    def _open_line(self) -> _Line:
        with self._lock:
            if self._line is None or self._line.is_over:
                try:
                    self._line = _Line(self._given)
                except OSError as error:
                    raise storage_error(error, f"the process of {self._given}") from None
            return self._line


class _Line:
    """One process, and what it was asked."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._socket, theirs = socket.socketpair()
        with theirs:
            try:
                # Bound to us by its socket alone: the thread that starts it may end before it.
                self.child: subprocess.Popen[bytes] = spawn(
                    [sys.executable, "-m", __name__, url, str(theirs.fileno())],
                    descriptors=[theirs.fileno()],
                )
            except OSError:
                self._socket.close()
                raise
        self.is_over = False
        """Whether it answers no more."""
        self._count = 0
        self.asked: dict[int, Future[tuple[Any, bytes]]] = {}
        self._lock, self._sending = threading.Lock(), threading.Lock()
        threading.Thread(target=self._listen, name="store answers", daemon=True).start()

    def ask(self, header: list[Any], data: bytes) -> Future[tuple[Any, bytes]]:
        """Ask; the answer comes, or fails when the process ends."""
        answer: Future[tuple[Any, bytes]] = Future()
        with self._lock:
            if self.is_over:
                answer.set_exception(self._ended())
                return answer
            self._count += 1
            number = self._count
            self.asked[number] = answer
        with self._sending:
            try:
                self._socket.setsockopt(
                    socket.SOL_SOCKET, socket.SO_SNDTIMEO, _TIME.pack(*_parts(ANSWER_S_MAX))
                )
                _send(self._socket, [number, *header], data)
            except OSError:  # it does not listen any more: all calls fail with it
                self.close()
        return answer

    def close(self) -> None:
        """End it."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self.child.kill()

    def _listen(self) -> None:
        try:
            while (message := _receive(self._socket)) is not None:
                (number, error, value), data = message
                failure = _ERRORS.get(error, StoreError)(value) if error else None
                with self._lock:  # last, for what is not asked for any more nobody answers
                    answer = self.asked.pop(number)
                if failure is not None:
                    answer.set_exception(failure)
                else:
                    answer.set_result((value, data))
        except Exception:
            pass  # whatever it is, it speaks no more, as if it had ended: nobody may wait for it
        with self._lock:
            self.is_over = True
            asked, self.asked = self.asked, {}
        self.child.kill()
        self.child.communicate()
        self._socket.close()
        for answer in asked.values():
            answer.set_exception(self._ended())

    def _ended(self) -> StoreError:
        return StoreError(
            f"{self._url}: the process of the store has ended; it will be tried again"
        )


def _parts(time_s: float) -> tuple[int, int]:
    """A time as the kernel takes it: seconds and microseconds."""
    return int(time_s), int(time_s % 1 * 1e6)


def _send(line: socket.socket, header: list[Any], data: bytes) -> None:
    encoded = msgspec.msgpack.encode(header)
    line.sendall(_LENGTHS.pack(len(encoded), len(data)) + encoded)
    if data:
        line.sendall(data)


def _receive(line: socket.socket) -> tuple[list[Any], bytes] | None:
    """A message; None: the other side has ended."""
    lengths = _read(line, _LENGTHS.size)
    if lengths is None:
        return None
    header, data = _LENGTHS.unpack(lengths)
    if header + data > MESSAGE_BYTES_MAX:
        raise ValueError("a message is too long")
    encoded, content = _read(line, header), _read(line, data)
    if encoded is None or content is None:
        return None
    return msgspec.msgpack.decode(encoded, type=list[Any]), content


def _read(line: socket.socket, size: int) -> bytes | None:
    parts = []
    while size:
        part = line.recv(min(size, RECEIVE_BYTES))
        if not part:
            return None
        parts.append(part)
        size -= len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


# --- the process ----------------------------------------------------------------------------------


def _serve(url: str, line: socket.socket) -> None:
    """Do what is asked until the other side ends."""
    store = cache(open_store)
    opening, sending = threading.Lock(), threading.Lock()

    def one(number: int, what: str, name: str, size_max: int, data: bytes) -> None:
        try:
            with opening:
                made = store(url)
            answer = (_done(made, what, name, size_max, data), "")
        except TwinError as error:
            answer = ((str(error), b""), type(error).__name__)
        except OSError as error:  # of a file that it reads
            answer = ((str(error), b""), FileNotFoundError.__name__)
        except Exception as error:  # our own mistake, or a library's
            answer = ((f"{url}: {what} {name}: {error!r}", b""), StoreError.__name__)
        (value, content), failed = answer
        with sending, contextlib.suppress(OSError):
            _send(line, [number, failed, value], content)

    pool = ThreadPoolExecutor(CALLS_MAX)
    while (message := _receive(line)) is not None:
        (number, what, name, size_max), data = message
        pool.submit(one, number, what, name, size_max, data)
        del message, data
    os._exit(0)  # calls that are under way are nobody's any more


def _done(
    store: ResultStore, what: str, name: str, size_max: int, data: bytes
) -> tuple[Any, bytes]:
    match what:
        case "url":
            return store.url, b""
        case "put":
            store.put(name, data)
            return None, b""
        case "put_object":
            return put_object(store, data), b""
        case "put_file":
            store.put(name, read_regular(Path(os.fsdecode(data)), size_max))
            return None, b""
        case "create":
            return store.create(name, data), b""
        case "get":
            return None, store.get(name, size_max)
        case "names":
            return store.names(name), b""
        case "delete":
            store.delete(name)
            return None, b""
    raise AssertionError(what)


if __name__ == "__main__":
    os.environ.pop(PARENT_VARIABLE, None)
    leave_signals_to_the_parent()
    keep_to_itself()  # its environment proves to the store who asks, as the conductor's does
    _serve(sys.argv[1], socket.socket(fileno=int(sys.argv[2])))
