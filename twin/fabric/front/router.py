"""A Zenoh router behind a front: it listens where nobody but the front gets.

Zenoh knows a member's role by its certificate, and the front has taken that off. So there is a
session for each role, which lets in what comes through its Unix socket as that role and is joined
to the router by TLS with a key that nobody else has. The sockets have no names once they listen:
the front gets their descriptors.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable

import msgspec

from twin.base.errors import UsageError, storage_error
from twin.base.process import end, how_it_ended, spawn
from twin.fabric.address import IN_USE
from twin.fabric.bus import Bus
from twin.fabric.endpoint import LOOPBACK, host_and_port, to_listen
from twin.fabric.front.messages import ASKING, FrontEvent, Settings
from twin.fabric.keys.authority import inner_key
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.keys.revoked import read_revoked
from twin.fabric.keys.roles import MEMBERS, Role
from twin.fabric.rig_folder import PrivateFolder
from twin.fabric.zenoh_bus import open_bus, router_count

BACKLOG = 1024
"""Connections that wait for the front to accept them."""
LOOK_S = 0.25
"""How often the list of withdrawn keys is looked at before there is a front [s]."""
RESTART_S = 0.5
"""How long to wait before a front that died is started again [s]."""

RUNTIME = "(rx: (worker_threads: 64))"
"""Zenoh's threads that receive. One that passes on a large message waits until the next session has
room, and that session needs one, too: with Zenoh's two, a member of large requests and another one
of the same role held up each other for 5 s, and then lost their links."""

CLOSE_S = 5.0
"""A front ends by itself within this time, or is killed [s]."""

_log = logging.getLogger(__name__)

Heard = Callable[[FrontEvent], None]
"""What a front tells, on a thread of its own."""


class Fronted:
    """A listening port with a front, and the router behind it."""

    def __init__(
        self,
        listen: str,
        namespace: str,
        key: MemberKey,
        heard: Heard,
        *,
        connect: str = "",
        connect_required: bool = True,
    ) -> None:
        """Listen as the holder of ``key``.

        Args:
            listen: ``tls/HOST:PORT``.
            namespace: prefix of every key.
            key: a conductor's.
            heard: hears what the front tells.
            connect: a relay's conductor; empty: the router is here.
            connect_required: False: keep trying to reach that in the background.

        Raises:
            UsageError: nobody can listen there.
            InfrastructureError: nobody answers at ``connect``.
        """
        self._heard = heard
        self._key = key
        self._relayed = bool(connect)
        self._closing = threading.Event()
        self._woken, self._waker = socket.socketpair()
        """The former is readable once it closes."""
        self._thread = threading.Thread(target=self._run, name="front", daemon=True)
        self._process: subprocess.Popen[bytes] | None = None
        self._buses: list[Bus] = []
        self._sockets: dict[str, int] = {}
        self._listener = _listener(listen)
        try:
            self.bus = self._open(namespace, connect, connect_required=connect_required)
            """The router's session; its endpoint is the front's."""
            host, port = host_and_port(listen)[0], self._listener.getsockname()[1]
            self.bus.endpoints = [f"tls/{_bracketed(host)}:{port}"]
            self._thread.start()
        except BaseException:
            self.close()
            raise

    def socket_of(self, role: Role) -> int:
        """Descriptor of the socket at which whoever opens it is let in as ``role``, past the front:
        for children of this process alone."""
        return self._sockets[role]

    def close(self) -> None:
        """Stop listening, and end every session; safe at any stage."""
        self._closing.set()
        self._waker.close()
        if self._thread.ident is not None:
            if self._process is not None:
                _let_go(self._process)
            self._thread.join(CLOSE_S)
            if self._thread.is_alive() and self._process is not None:  # somebody has stopped it
                self._process.kill()
            self._thread.join()
        self._leave()
        self._listener.close()
        self._woken.close()
        while self._sockets:
            os.close(self._sockets.popitem()[1])

    def _leave(self) -> None:
        """End the sessions one after the other.

        Zenoh 1.10 panics in a router from which several others part at once
        (eclipse-zenoh/zenoh#2624): one conductor in six wrote a stack trace as it ended.
        """
        while self._buses:
            self._buses.pop().close()
            if not self._relayed and self._buses:
                joined, until = len(self._buses) - 1, time.monotonic() + CLOSE_S
                while router_count(self._buses[0]) > joined and time.monotonic() < until:
                    time.sleep(0.001)

    def _open(self, namespace: str, connect: str, *, connect_required: bool) -> Bus:
        try:
            folder = PrivateFolder()  # gone also if we are killed here
        except OSError as error:
            raise storage_error(error, error.filename or tempfile.gettempdir()) from None
        key = self._key if connect else inner_key()
        listen = [] if connect else [to_listen(LOOPBACK, keyed=True)]
        was_set = "ZENOH_RUNTIME" in os.environ
        os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)  # read by a process's first session
        try:
            for role in MEMBERS:
                path = f"{folder.path}/{role}"
                bus = open_bus(
                    "router",
                    listen=listen,
                    connect=[connect] if connect else [],
                    namespace=namespace,
                    key=key,
                    connect_required=connect_required,
                    role_socket=(path, role),
                )
                self._buses.append(bus)
                if listen:  # the first one is what the others join
                    listen, connect = [], bus.endpoints[0]
                self._sockets[role] = os.open(path, os.O_PATH | os.O_CLOEXEC)
        finally:
            folder.close()
            if not was_set:  # children need no more threads than usual
                del os.environ["ZENOH_RUNTIME"]
        return self._buses[0]

    def _run(self) -> None:
        """Start the front when there is something for it to do, hear what it tells, and start it
        again if it dies. All on one thread: the kernel ends a child with the thread that started
        it."""
        self._await_need()
        said = ""
        while not self._closing.is_set():
            try:
                process = self._start()
            except OSError as error:  # no descriptor, process or memory is left, for a while
                if str(error) != said:
                    said = str(error)
                    _log.error("the front cannot be started: %s; it will be tried again", said)
                self._closing.wait(RESTART_S)
                continue
            said = ""
            if self._closing.is_set():  # whoever closes may not have seen it
                _let_go(process)
            assert process.stdout is not None
            for line in process.stdout:
                with contextlib.suppress(msgspec.MsgspecError):
                    self._heard(msgspec.json.decode(line, type=FrontEvent))
            end(process)
            if not self._closing.wait(RESTART_S):
                _log.error("the front %s; started again", how_it_ended(process.returncode))

    def _await_need(self) -> None:
        """Return once somebody connects, a key was withdrawn, or it closes."""
        poll = select.poll()
        for awaited in (self._listener, self._woken):
            poll.register(awaited, select.POLLIN)
        while not poll.poll(LOOK_S * 1000):
            with contextlib.suppress(OSError):  # a shared file system may be away for a while
                if read_revoked(self._key.path.parent):
                    return

    def _start(self) -> subprocess.Popen[bytes]:
        ours, theirs = socket.socketpair()
        with ours:
            with theirs:
                process = spawn(
                    [sys.executable, "-m", "twin.fabric.front.process", str(theirs.fileno())],
                    descriptors=[self._listener.fileno(), theirs.fileno()],
                    pipe_output=True,
                    log=open(2, "wb", closefd=False),  # noqa: SIM115
                )
            self._process = process
            settings = Settings(
                listener=self._listener.fileno(),
                roles=tuple(self._sockets),
                fabric=self._key.fabric,
                authority=self._key.authority.decode(),
                certificate=self._key.certificate.decode(),
                private=self._key.private.decode(),
                keys=str(self._key.path.parent),
            )
            assert process.stdin is not None
            with contextlib.suppress(OSError, ValueError):  # it died, or is to end
                if ours.recv(1) == ASKING:
                    socket.send_fds(ours, [b"\n"], list(self._sockets.values()))
                    process.stdin.write(msgspec.json.encode(settings) + b"\n")
        return process


def _let_go(front: subprocess.Popen[bytes]) -> None:
    assert front.stdin is not None
    front.stdin.close()  # its lifeline


def _listener(endpoint: str) -> socket.socket:
    host, port = host_and_port(endpoint)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise UsageError(f"{endpoint}: cannot listen: {error.strerror}") from None
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise UsageError(f"{endpoint}: {IN_USE}") from None
        raise UsageError(f"{endpoint}: cannot listen: {error.strerror}") from None
    return listener


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
