"""The process in front of a Zenoh router: it owns the public port, so nobody else meets Zenoh.

It accepts with a limit on handshakes, finishes mutual TLS within a deadline, looks at the
certificate (role, end, whether it was withdrawn), and only then passes bytes on: to the Unix socket
of that role, which no file names and only its descriptor opens. What it refuses or ends it tells on
standard output, a line of JSON each.

A process of its own, because TLS in Python would take turns with the conductor's thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import resource
import socket
import ssl
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import msgspec

from twin.base.process import bind_to_parent, keep_to_itself, leave_signals_to_the_parent
from twin.fabric.front.messages import ASKING, FrontEvent, Settings
from twin.fabric.front.rules import (
    FIRST_WORD_S,
    HANDSHAKE_S,
    Account,
    Batches,
    HandshakeSlots,
    quota_of,
)
from twin.fabric.handshake import in_memory
from twin.fabric.keys.revoked import read_revoked
from twin.fabric.keys.roles import Role, split_name

LOOK_S = 0.25
"""How often the list of withdrawn keys and the ends of keys are looked at [s]."""
_CHUNK = memoryview(bytearray(1 << 18))
"""Bytes read last, of whichever connection: they are copied before anything else is read."""
HELD_BYTES_MAX = 1 << 20
"""Most that waits for one side; meanwhile nothing is read from the other [bytes]."""
TOLD_MAX = 1_000
"""Most lines that wait to be told; further ones are counted."""


class _UnwelcomeError(Exception):
    """A connection gets no further; the reason, in words."""


class Front:
    """One listening port."""

    def __init__(self, settings: Settings, sockets: dict[str, int]) -> None:
        """``sockets``: role -> descriptor of the Unix socket behind."""
        self._settings = settings
        self._behind = sockets
        self._listener = socket.socket(fileno=settings.listener)
        self._listener.setblocking(False)
        self._context = _context(settings)
        self._slots = HandshakeSlots()
        self._accounts: dict[int, Account] = {}
        self._sessions: set[Session] = set()
        self._revoked: frozenset[int] = frozenset()
        self._tasks: set[asyncio.Task[None]] = set()
        self._told: deque[FrontEvent] = deque()
        self._lost = 0

    async def serve(self) -> None:
        """Serve members until the lifeline is cut."""
        self._look()
        loop = asyncio.get_running_loop()
        over = asyncio.Event()

        def lifeline() -> None:
            if not os.read(0, 4096):
                over.set()

        loop.add_reader(0, lifeline)
        os.set_blocking(1, False)
        tasks = [loop.create_task(self._accept()), loop.create_task(self._keep_looking())]
        await over.wait()
        for task in tasks:
            task.cancel()
        for session in list(self._sessions):
            session.cut("the conductor has ended")
            self.closed(session)

    async def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, address = await loop.sock_accept(self._listener)
            except OSError:  # too many open files: whoever waits longest makes room
                await asyncio.sleep(0.05)
                continue
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            task = loop.create_task(self._admit(connection, str(address[0])))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
            oldest = self._slots.take(task, str(address[0]))
            if isinstance(oldest, asyncio.Task):
                oldest.cancel()
            await asyncio.sleep(0)  # others have their turn, however many wait here

    async def _admit(self, connection: socket.socket, peer: str) -> None:
        """Shake hands, look at the certificate, and let it through or not."""
        session = Session(self, peer)
        try:
            try:
                await asyncio.get_running_loop().connect_accepted_socket(
                    lambda: session,
                    connection,
                    ssl=self._context,
                    ssl_handshake_timeout=HANDSHAKE_S,
                    ssl_shutdown_timeout=1.0,
                )
            except (OSError, EOFError) as error:  # ssl.SSLError is an OSError
                raise _UnwelcomeError(_reason(error)) from None
            self._check(session)
        except _UnwelcomeError as error:
            session.close()
            self.say(session.event("refused", str(error)))
        except asyncio.CancelledError:
            self.say(session.event("refused", "too many handshakes were under way; the oldest"))
        else:
            session.begin()
        finally:
            self._slots.free(asyncio.current_task())

    def _check(self, session: Session) -> None:
        """Raise _UnwelcomeError unless the certificate is one to let in."""
        session.take_certificate()
        if session.fabric != self._settings.fabric or session.role not in self._behind:
            raise _UnwelcomeError("its key is of another fabric or rig")
        if session.end_s <= time.time():
            raise _UnwelcomeError("its key has expired")
        if session.serial in self._revoked:
            raise _UnwelcomeError("its key was withdrawn")
        quota = quota_of(Role(session.role))
        account = self._accounts.setdefault(session.serial, Account(quota))
        if account.connections >= quota.connections:
            raise _UnwelcomeError(f"its key has {quota.connections} connections already")
        account.connections += 1
        session.account = account
        self._sessions.add(session)

    def socket_of(self, role: str) -> str:
        """Path of the Unix socket of ``role``: through a descriptor, there is no other."""
        return f"/proc/self/fd/{self._behind[role]}"

    def closed(self, session: Session) -> None:
        """Forget a session that is over."""
        if session not in self._sessions:
            return
        self._sessions.discard(session)
        session.account.connections -= 1
        if session.spoke:
            self.say(session.event("closed", session.reason))

    async def _keep_looking(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            self._look()
            self._tell()

    def _look(self) -> None:
        """Cut what may not go on."""
        known = self._revoked
        with contextlib.suppress(OSError):  # a shared file system may be away for a while
            self._revoked = read_revoked(Path(self._settings.keys))
        now_s = time.time()
        for serial in self._revoked - known:
            withdrawn = [session for session in self._sessions if session.serial == serial]
            for session in withdrawn:
                session.cut("its key was withdrawn")
            role = withdrawn[0].role if withdrawn else ""
            self.say(FrontEvent("cut", "", role, f"{serial:x}", "withdrawn", len(withdrawn)))
        for session in [session for session in self._sessions if session.end_s <= now_s]:
            session.cut("its key has expired")

    def say(self, event: FrontEvent) -> None:
        """Report an event: at once if whoever listens keeps up."""
        if len(self._told) >= TOLD_MAX:
            self._lost += 1
            return
        self._told.append(event)
        self._tell()

    def _tell(self) -> None:
        if self._lost and len(self._told) < TOLD_MAX:
            self._told.append(FrontEvent("refused", reason="and more", count=self._lost))
            self._lost = 0
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            while self._told:
                # Shorter than what a pipe takes in one piece.
                os.write(1, msgspec.json.encode(self._told[0]) + b"\n")
                self._told.popleft()


class Session(asyncio.BufferedProtocol):
    """A member's side of a connection: what it sends goes to the router's socket for its role."""

    def __init__(self, front: Front, peer: str) -> None:
        self.peer = peer
        self.fabric = self.role = self.reason = ""
        self.serial = 0
        self.end_s = 0.0
        self.spoke = False
        self.account: Account
        self._front = front
        self._outer: asyncio.Transport | None = None
        self._inner: Inner | None = None
        self._batches = Batches()
        self._slowed = False
        self._full = False

    def event(self, what: str, reason: str = "") -> FrontEvent:
        """The event ``what`` of this session."""
        key = f"{self.serial:x}" if self.serial else ""
        return FrontEvent(what, self.peer, self.role, key, reason)

    def take_certificate(self) -> None:
        """Read what the handshake has proved."""
        assert self._outer is not None
        certificate: dict[str, Any] = self._outer.get_extra_info("peercert") or {}
        name = dict(pair for part in certificate.get("subject", ()) for pair in part)
        with contextlib.suppress(ValueError):
            self.fabric, self.role = split_name(name.get("commonName", ""))
        self.serial = int(certificate.get("serialNumber", "0"), 16)
        self.end_s = (
            ssl.cert_time_to_seconds(certificate["notAfter"]) if "notAfter" in certificate else 0.0
        )

    def begin(self) -> None:
        """Let the member in; Zenoh hears of it at its first word."""
        assert self._outer is not None
        asyncio.get_running_loop().call_later(FIRST_WORD_S, self._be_heard)
        self._outer.resume_reading()

    def _be_heard(self) -> None:
        if not self.spoke:
            self.cut("it said nothing")

    def cut(self, reason: str) -> None:
        """End it now."""
        self.reason = reason
        if self._outer is not None:
            self._outer.abort()

    def close(self) -> None:
        """End it politely; it never got in."""
        if self._outer is not None:
            self._outer.close()

    # --- the member's side ----------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._outer = transport
        transport.set_write_buffer_limits(high=HELD_BYTES_MAX)
        transport.pause_reading()

    def connection_lost(self, _error: Exception | None) -> None:
        if self._inner is not None:
            self._inner.close()
        self._front.closed(self)

    def get_buffer(self, _hint: int) -> memoryview:
        return _CHUNK

    def buffer_updated(self, count: int) -> None:
        data = bytes(_CHUNK[:count])
        if not self.spoke:
            self.spoke = True
            self._front.say(self.event("opened"))
            self._inner = Inner(self)
            self._inner.open(self._front.socket_of(self.role))
        assert self._inner is not None
        self._inner.write(data)
        wait_s = self.account.take(self._batches.count(data), count, time.monotonic())
        if wait_s > 0.0:
            if not self._slowed:
                self._front.say(self.event("slowed", "over its quota"))
            self._slowed = True
            asyncio.get_running_loop().call_later(wait_s, self._go_on)
        self.flow()

    def eof_received(self) -> bool:
        return False

    def pause_writing(self) -> None:
        if self._inner is not None:
            self._inner.pause()

    def resume_writing(self) -> None:
        if self._inner is not None:
            self._inner.resume()

    def _go_on(self) -> None:
        self._slowed = False
        self.flow()

    # --- Zenoh's side ---------------------------------------------------------------------------

    def fill(self, *, full: bool) -> None:
        """Stop reading because too much waits for Zenoh, or go on."""
        self._full = full
        self.flow()

    def flow(self) -> None:
        """Read from the member, or do not, as the state asks."""
        if self._outer is None or self._outer.is_closing():
            return
        if self._full or self._slowed:
            self._outer.pause_reading()
        elif not self._outer.is_reading():
            self._outer.resume_reading()

    def send(self, data: bytes) -> None:
        """Pass on to the member what Zenoh says."""
        if self._outer is not None:
            self._outer.write(data)

    def end(self) -> None:
        """Zenoh has hung up."""
        if self._outer is not None:
            self._outer.close()


class Inner(asyncio.BufferedProtocol):
    """The side of Zenoh."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._transport: asyncio.Transport | None = None
        self._early: list[bytes] = []
        self._closed = False
        self._task: asyncio.Task[None] | None = None

    def open(self, path: str) -> None:
        """Connect; what comes meanwhile waits, and nothing more is read."""
        self._session.fill(full=True)
        self._task = asyncio.get_running_loop().create_task(self._connect(path))

    async def _connect(self, path: str) -> None:
        try:
            await asyncio.get_running_loop().create_unix_connection(lambda: self, path)
        except OSError:
            self._session.end()

    def write(self, data: bytes) -> None:
        """Pass bytes on to Zenoh."""
        if self._transport is None:
            self._early.append(data)
        else:
            self._transport.write(data)

    def close(self) -> None:
        """Close the way to Zenoh: the member is gone."""
        self._closed = True
        if self._transport is not None:
            self._transport.close()

    def pause(self) -> None:
        """Stop reading from Zenoh: the member does not keep up."""
        if self._transport is not None:
            self._transport.pause_reading()

    def resume(self) -> None:
        """Read from Zenoh again: the member keeps up."""
        if self._transport is not None:
            self._transport.resume_reading()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.set_write_buffer_limits(high=HELD_BYTES_MAX)
        self._transport = transport
        for data in self._early:
            transport.write(data)
        self._early.clear()
        self._session.fill(full=False)
        if self._closed:
            transport.close()

    def connection_lost(self, _error: Exception | None) -> None:
        self._session.end()

    def get_buffer(self, _hint: int) -> memoryview:
        return _CHUNK

    def buffer_updated(self, count: int) -> None:
        self._session.send(bytes(_CHUNK[:count]))

    def eof_received(self) -> bool:
        return False

    def pause_writing(self) -> None:
        self._session.fill(full=True)

    def resume_writing(self) -> None:
        self._session.fill(full=False)


def _context(settings: Settings) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_verify_locations(cadata=settings.authority)
    context.num_tickets = 0  # a session that is resumed would skip what changed since
    with in_memory((settings.certificate + settings.private).encode()) as path:
        context.load_cert_chain(path)
    return context


_NOT_YET_VALID, _EXPIRED = 9, 10

_REASONS = {
    "PEER_DID_NOT_RETURN_A_CERTIFICATE": "it showed no key",
    "TLSV1_ALERT_UNKNOWN_CA": "its key is of another fabric or rig",
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": "it says that the key here has expired; compare the clocks",
}
"""OpenSSL's name of a mistake -> what it means; of others: it does not speak TLS as we do."""


def _reason(error: BaseException) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        if error.verify_code == _EXPIRED:
            return "its key has expired"
        if error.verify_code == _NOT_YET_VALID:
            return "its key is not valid yet; compare the clocks"
        return "its key is of another fabric or rig"
    if isinstance(error, ssl.SSLError):
        return _REASONS.get(error.reason or "", "it does not speak TLS")
    if "handshake" in str(error):  # asyncio's words, when the time is over
        return f"no handshake within {HANDSHAKE_S:g} s"
    return "it hung up during the handshake"


def main() -> None:
    """Serve what standard input says until it ends.

    Its key and its sockets are nothing for a stack of the same user, so it asks for them, by the
    socket that its argument names, when nobody can see them here.
    """
    bind_to_parent()
    leave_signals_to_the_parent()
    keep_to_itself()
    handover = socket.socket(fileno=int(sys.argv[1]))
    handover.sendall(ASKING)
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    logging.disable()  # asyncio has a line for every stranger
    line = sys.stdin.buffer.readline()
    if line:
        settings = msgspec.json.decode(line, type=Settings)
        with handover:
            count = len(settings.roles)
            _, sockets, _, _ = socket.recv_fds(handover, 1, count, socket.MSG_CMSG_CLOEXEC)
        asyncio.run(Front(settings, dict(zip(settings.roles, sockets, strict=True))).serve())


if __name__ == "__main__":
    main()
