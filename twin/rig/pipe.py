"""Messages between the worker and its simulator process, over the child's standard streams."""

from __future__ import annotations

import contextlib
import os
import queue
import struct
import threading
from collections.abc import Callable, Iterator
from typing import BinaryIO

from msgspec import Struct

from schemas.sections.view_mode import ViewMode
from schemas.wire.codec import MESSAGE_BYTES_MAX, WireError, decode, encode
from schemas.wire.control import Lease, Result, Touch
from schemas.wire.interventions import RecordedAction

_LENGTH = struct.Struct("<I")
BUILD_BEAT_S, BUILD_MAX_S = 1.0, 900
"""A simulator that builds its engine says so this often, and no longer than this [s]."""


class BuildRig(Struct, frozen=True, tag_field="kind", tag="build"):
    """The first message: build the engine for the rig of this lease's case."""

    lease: Lease
    rig: str
    listen: str
    """Where the drive session listens."""
    namespace: str
    """Of the drive session."""
    slots: int
    device: str
    """``cpu`` or ``cuda:N``."""
    view: ViewMode
    view_namespace: str
    view_connect: str
    """The conductor's router; plain TCP beyond loopback only if somebody typed ``--insecure``."""
    key: str = ""
    """Path of the worker's key file, for viewers; empty: none."""
    rig_key: bytes = b""
    """The simulator's own key, for the drive session; empty: none."""
    output: int = -1
    """Descriptor of the log of the stack's process; -1: it is on another host, or in this
    process."""


class Assign(Struct, frozen=True, tag_field="kind", tag="assign"):
    """Run this lease in a free slot."""

    lease: Lease
    replay: list[RecordedAction] = []
    """What the journal of an earlier attempt says was done to it."""


class Abandon(Struct, frozen=True, tag_field="kind", tag="abandon"):
    """Stop working on a token; its result is no longer wanted."""

    token: int


class Fail(Struct, frozen=True, tag_field="kind", tag="fail"):
    """The stack cannot go on, and this case ends as ``failed`` with the reason."""

    token: int
    reason: str


class Close(Struct, frozen=True, tag_field="kind", tag="close"):
    """Stop working and hand the recorder what it has not got yet; the process is ended soon."""


class Drain(Struct, frozen=True, tag_field="kind", tag="drain"):
    """The rig is about to be ended: write the attempts of cases that are over, and say so."""


class Drained(Struct, frozen=True, tag_field="kind", tag="drained"):
    """Nothing is left to be written, or it took too long."""


class Listening(Struct, frozen=True, tag_field="kind", tag="listening"):
    """The drive session is open."""

    endpoint: str
    view: str = ""
    """Where a recorder connects; empty: nothing is to be recorded."""


class RefusedPeer(Struct, frozen=True, tag_field="kind", tag="refused"):
    """Somebody was not let into the rig; a sentence for the worker's log."""

    line: str


class Building(Struct, frozen=True, tag_field="kind", tag="building"):
    """The engine is being built: kernels that nobody has compiled here yet take minutes."""


class Built(Struct, frozen=True, tag_field="kind", tag="built"):
    """Engine built and stack connected."""

    transport: str
    """How large arrays reach the stack, see :data:`twin.fabric.drive.Transport`."""
    notes: list[str] = []
    """What is left out of the scene's mesh files, one line each."""


class Progress(Struct, frozen=True, tag_field="kind", tag="progress"):
    """Case ticks of the tokens being worked on; proves that the loop moves."""

    tokens: list[int]
    ticks: list[int]
    waiting: list[int] = []
    """Tokens among them that stand still because somebody asked for it."""
    ended: list[int] = []
    """Tokens of cases that are over and whose attempt folders are being written."""


class Intervened(Struct, frozen=True, tag_field="kind", tag="touched"):
    """Somebody has intervened in a case."""

    token: int
    note: Touch


class Faulted(Struct, frozen=True, tag_field="kind", tag="faulted"):
    """The stack cannot go on, which is its own doing; no case takes another step."""

    reason: str


class CaseDone(Struct, frozen=True, tag_field="kind", tag="done"):
    """A case ended; its attempt folder is complete."""

    result: Result


class IntervenedDone(Struct, frozen=True, tag_field="kind", tag="steered"):
    """A case ended that an intervention had changed; its attempt folder is complete, and is no
    result."""

    result: Result
    changes: int


class Broken(Struct, frozen=True, tag_field="kind", tag="broken"):
    """The rig cannot go on."""

    reason: str
    detail: str


Downward = BuildRig | Assign | Abandon | Fail | Close | Drain
Upward = (
    Listening
    | RefusedPeer
    | Building
    | Built
    | Progress
    | Intervened
    | Faulted
    | CaseDone
    | IntervenedDone
    | Drained
    | Broken
)


def pack(message: Struct) -> bytes:
    """Length-prefixed bytes of one message."""
    data = encode(message)
    return _LENGTH.pack(len(data)) + data


class Unpacker:
    """Cuts a byte stream into messages of ``type_``."""

    def __init__(self, type_: object) -> None:
        self._type = type_
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Struct]:
        """Messages completed by ``data``."""
        self._buffer += data
        messages: list[Struct] = []
        while len(self._buffer) >= _LENGTH.size:
            (size,) = _LENGTH.unpack_from(self._buffer)
            if size > MESSAGE_BYTES_MAX:
                raise WireError(f"message of {size} bytes, at most {MESSAGE_BYTES_MAX} are read")
            if len(self._buffer) < _LENGTH.size + size:
                break
            body = bytes(self._buffer[_LENGTH.size : _LENGTH.size + size])
            del self._buffer[: _LENGTH.size + size]
            messages.append(decode(body, self._type))
        return messages


class Upstream:
    """Where a simulator writes to its worker, from any thread."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._lock = threading.Lock()

    def send(self, message: Struct) -> None:
        """Write one message, whole."""
        data = memoryview(pack(message))
        with self._lock:
            while data:  # an unbuffered pipe may take less than all of it
                data = data[self._stream.write(data) :]

    @contextlib.contextmanager
    def building(self) -> Iterator[None]:
        """Say :class:`Building` again and again while the block runs."""
        built = threading.Event()

        def say() -> None:
            for _ in range(round(BUILD_MAX_S / BUILD_BEAT_S)):
                if built.wait(BUILD_BEAT_S):
                    return
                self.send(Building())

        beats = threading.Thread(target=say, name="building", daemon=True)
        beats.start()
        try:
            yield
        finally:
            built.set()
            beats.join()


class Orders:
    """Orders of the worker, read on a thread; end-of-file means the worker is gone."""

    def __init__(self, stream: int) -> None:
        self._drain: Callable[[], None] = lambda: None
        self._drains = threading.Event()
        self.failing = ""
        """Not empty: the stack has ended by itself, so nobody should wait for it; the reason."""
        self._inbox: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._stream = stream
        threading.Thread(target=self._read, name="orders", daemon=True).start()

    def on_drain(self, drain: Callable[[], None]) -> None:
        """``drain``: what :class:`Drain` asks for; at once, since the loop may wait for a stack."""
        self._drain = drain
        self._drains.set()

    def _read(self) -> None:
        unpacker = Unpacker(Downward)
        while data := os.read(self._stream, 65536):
            for message in unpacker.feed(data):
                if isinstance(message, Drain):
                    self._drains.wait()
                    self._drain()
                else:
                    if isinstance(message, Fail):
                        self.failing = message.reason
                    self._inbox.put(message)
        os._exit(0)

    def next(self, timeout_s: float | None) -> object | None:
        """The next order; None after ``timeout_s`` (None: wait for ever)."""
        try:
            if timeout_s == 0:
                return self._inbox.get_nowait()
            return self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            return None
