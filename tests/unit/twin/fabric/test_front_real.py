"""A front before a real router: garbage keeps no member out, and keys end when they should."""

from __future__ import annotations

import functools
import os
import resource
import socket
import ssl
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from waiting import PATIENCE_S, wait_for

from schemas.wire import topics
from twin.base.errors import TwinError
from twin.fabric.bus import Bus
from twin.fabric.endpoint import SOCKET, host_and_port
from twin.fabric.front.messages import FrontEvent
from twin.fabric.front.router import Fronted
from twin.fabric.front.rules import SHAKING_PER_ADDRESS_MAX
from twin.fabric.handshake import in_memory
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.key_file import MemberKey, UnfitKeyError, load_key, read_certificate
from twin.fabric.keys.revoked import revoke
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

STATUS = topics.RPC_STATUS.key


class Door:
    """A front, and what it has told."""

    def __init__(self, keys: Path) -> None:
        self.keys = keys
        self.told: list[FrontEvent] = []
        self.others = fronts()
        before = ports_of_this_process()
        key = load_key(keys, Role.conductor)
        self.fronted = Fronted("tls/127.0.0.1:0", "twin", key, self.told.append)
        self.fronted.bus.serve(STATUS, lambda payload, respond: respond(payload))
        (self.endpoint,) = self.fronted.bus.endpoints
        self.ports = ports_of_this_process() - before
        """Those that this process listens at for the fabric."""

    def told_of(self, what: str, reason: str) -> list[FrontEvent]:
        return [event for event in self.told if (event.what, event.reason) == (what, reason)]

    def joined(self, key: MemberKey, patience_s: float = PATIENCE_S) -> Bus:
        bus = open_bus("client", connect=[self.endpoint], key=key, connect_timeout_s=patience_s)
        try:
            answers = functools.partial(bus.request, STATUS, b"here", 1.0)
            wait_for(lambda: answers() == b"here", "an answer to a member", patience_s)
        except AssertionError:
            bus.close()
            raise
        return bus


@pytest.fixture
def door(tmp_path: Path) -> Iterator[Door]:
    found = Door(make_keys(tmp_path / "keys"))
    yield found
    found.fronted.close()


def stranger(endpoint: str, first: bytes = b"") -> socket.socket:
    connection = socket.create_connection(host_and_port(endpoint))
    connection.sendall(first)
    return connection


def shake_hands(endpoint: str, authority: bytes, key: MemberKey | None) -> None:
    """A handshake to its end, with the certificate of ``key`` or without; whatever comes of it."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.load_verify_locations(cadata=authority.decode())
    if key is not None:
        with in_memory(key.certificate + key.private) as path:
            context.load_cert_chain(path)
    with stranger(endpoint) as connection:
        try:
            with context.wrap_socket(connection) as session:
                session.recv(1)
        except OSError:
            return


def test_members_join_among_garbage(door: Door, tmp_path: Path) -> None:
    """More silent connections than there are slots, and each kind of handshake that fails."""
    worker = load_key(door.keys, Role.worker)
    foreign = load_key(make_keys(tmp_path / "foreign"), Role.worker)
    silent = [stranger(door.endpoint) for _ in range(SHAKING_PER_ADDRESS_MAX + 20)]
    for _ in range(10):
        stranger(door.endpoint, b"GET / HTTP/1.1\r\n\r\n").close()
        shake_hands(door.endpoint, worker.authority, None)
        shake_hands(door.endpoint, worker.authority, foreign)
    bus = door.joined(worker)
    bus.close()
    wait_for(lambda: door.told_of("closed", ""), "the front to tell it")
    assert all(each.fileno() >= 0 for each in silent), "they are still there"
    for each in silent:
        each.close()
    reasons = Counter(event.reason for event in door.told if event.what == "refused")
    assert reasons["it showed no key"] == 10
    assert reasons["its key is of another fabric or rig"] == 10
    assert reasons["it does not speak TLS"] == 10
    assert reasons["too many handshakes were under way; the oldest"] >= 20
    opened = [event for event in door.told if event.what == "opened"]
    serial = f"{read_certificate(door.keys / 'worker.key').serial_number:x}"
    assert [(each.role, each.key, each.peer) for each in opened] == [
        ("worker", serial, "127.0.0.1")
    ], "garbage never reached Zenoh"


def test_nobody_reaches_the_router_past_the_front(door: Door) -> None:
    """Its own port takes a key that this process alone has; a member's is of no use there."""
    worker = load_key(door.keys, Role.worker)
    listening = {port for port in door.ports if not door.endpoint.endswith(f":{port}")}
    assert listening
    for port in listening:
        with pytest.raises(TwinError, match="another fabric"):
            open_bus("client", connect=[f"tls/127.0.0.1:{port}"], key=worker, connect_timeout_s=1.0)


def ports_of_this_process() -> set[int]:
    import psutil

    found = psutil.Process().net_connections("tcp")
    return {each.laddr.port for each in found if each.status == psutil.CONN_LISTEN}


def test_a_withdrawn_key_is_cut_and_refused(door: Door) -> None:
    worker, viewer = (load_key(door.keys, role) for role in (Role.worker, Role.viewer))
    serial = read_certificate(worker.path).serial_number
    inside, neighbour = door.joined(worker), door.joined(viewer)
    revoke(door.keys, serial)
    wait_for(lambda: door.told_of("cut", "withdrawn"), "the front to tell it")
    (event,) = door.told_of("cut", "withdrawn")
    assert (event.key, event.role, event.count) == (f"{serial:x}", "worker", 1)
    wait_for(lambda: door.told_of("refused", "its key was withdrawn"), "another try")
    assert inside.request(STATUS, b"here", 0.2) is None
    assert neighbour.request(STATUS, b"here", PATIENCE_S) == b"here", "others notice nothing"
    assert len(door.told_of("closed", "its key was withdrawn")) == 1
    with pytest.raises(UnfitKeyError, match=r"worker\.key was withdrawn, has expired or has too"):
        open_bus("client", connect=[door.endpoint], key=worker, connect_timeout_s=0.5)
    inside.close()
    neighbour.close()


@pytest.mark.slow
def test_a_session_ends_with_its_key(door: Door, tmp_path: Path) -> None:
    bus = joined_briefly(door, tmp_path / "short.key")
    wait_for(lambda: door.told_of("closed", "its key has expired"), "the front to tell it")
    wait_for(lambda: door.told_of("refused", "its key has expired"), "another try")
    assert bus.request(STATUS, b"here", 0.2) is None
    bus.close()


def joined_briefly(door: Door, path: Path) -> Bus:
    """A session with a key that lasts a few seconds, or more where they do not suffice to join."""
    for seconds in (4, 16, 64, 256):
        path.write_bytes(load_authority(door.keys).issue(Role.viewer, seconds / 86400))
        path.chmod(0o600)
        try:
            return door.joined(load_key(path, Role.viewer), seconds)
        except (TwinError, AssertionError):
            continue
    raise AssertionError("nobody can join")


def test_a_front_that_dies_is_replaced(door: Door) -> None:
    bus = door.joined(load_key(door.keys, Role.viewer))
    the_front(door.others).kill()
    wait_for(lambda: bus.request(STATUS, b"here", 1.0) == b"here", "an answer at the same address")
    bus.close()


def test_a_front_begins_when_files_can_be_opened_again(
    door: Door, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever connects while its process may open no more files is let in later."""
    usual = resource.getrlimit(resource.RLIMIT_NOFILE)
    with socket.socket() as connection:
        connection.setblocking(False)
        lowest = os.dup(connection.fileno())  # the next one that is free
        os.close(lowest)
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, usual[1]))
        try:
            with suppress(BlockingIOError):
                connection.connect(host_and_port(door.endpoint))
            wait_for(lambda: "Too many open files" in caplog.text, "a front that cannot begin")
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, usual)
    door.joined(load_key(door.keys, Role.worker)).close()
    assert caplog.text.count("the front cannot be started") == 1


def fronts() -> list[psutil.Process]:
    """Of this process, which runs other tests as well."""
    found = []
    for each in psutil.Process().children():
        with suppress(psutil.Error):  # it ends
            if "twin.fabric.front.process" in each.cmdline():
                found.append(each)
    return found


def the_front(others: list[psutil.Process]) -> psutil.Process:
    """The one that is none of ``others``, as soon as it is there."""
    return wait_for(lambda: next((e for e in fronts() if e not in others), None), "a front")


def test_who_closes_while_it_begins_does_not_wait_for_ever(tmp_path: Path) -> None:
    key = load_key(make_keys(tmp_path / "keys"), Role.conductor)
    others = fronts()
    fronted = Fronted("tls/127.0.0.1:0", "twin", key, lambda _: None)
    with stranger(fronted.bus.endpoints[0]):
        fronted.close()
    assert set(fronts()) <= set(others)


def test_a_front_begins_when_somebody_connects(tmp_path: Path) -> None:
    """A child of the conductor comes past it, by a socket that has no name, and is let do what a
    worker may; nobody else makes a front of it."""
    others = fronts()
    door = Door(make_keys(tmp_path / "keys"))
    try:
        heard = threading.Event()
        door.fronted.bus.serve(topics.RPC_ADMIN.key, lambda *_: heard.set())
        path = f"/proc/self/fd/{door.fronted.socket_of(Role.worker)}"
        child = open_bus("client", connect=[f"{SOCKET}/{path}"])
        wait_for(lambda: child.request(STATUS, b"here", 1.0) == b"here", "an answer")
        assert child.request(topics.RPC_ADMIN.key, b"stop", 0.5) is None
        assert not heard.is_set()
        assert set(fronts()) <= set(others)
        with stranger(door.endpoint):
            the_front(others)
        child.close()
    finally:
        door.fronted.close()


def test_its_sockets_had_names_where_only_their_user_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Containers are shown the temporary folder, which may also have too long a name."""
    long = tmp_path / ("x" * 100)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    key = load_key(make_keys(tmp_path / "keys"), Role.conductor)
    with tempfile.TemporaryDirectory(dir="/tmp") as runtime:
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        fronted = Fronted("tls/127.0.0.1:0", "twin", key, lambda _: None)
        try:
            name = Path(f"/proc/self/fd/{fronted.socket_of(Role.worker)}").readlink()
            assert name.parents[1] == Path(runtime)
            assert str(name).endswith("/worker (deleted)")
            assert os.listdir(runtime) == []
        finally:
            fronted.close()


def test_a_front_begins_when_a_key_is_withdrawn(door: Door) -> None:
    serial = read_certificate(door.keys / "viewer.key").serial_number
    revoke(door.keys, serial)
    wait_for(lambda: door.told_of("cut", "withdrawn"), "the front to tell it")
    (event,) = door.told_of("cut", "withdrawn")
    assert (event.key, event.count) == (f"{serial:x}", 0)


@pytest.mark.slow
def test_a_front_that_is_stopped_holds_up_nobody(tmp_path: Path) -> None:
    key = load_key(make_keys(tmp_path / "keys"), Role.conductor)
    others = fronts()
    fronted = Fronted("tls/127.0.0.1:0", "twin", key, lambda _: None)
    with stranger(fronted.bus.endpoints[0]):
        front = the_front(others)
        front.suspend()
        fronted.close()
    assert not front.is_running()


def test_what_a_role_may_do_stays_what_it_is(door: Door) -> None:
    """The front takes the certificate off, so the role has to come through by the door."""
    heard = threading.Event()
    door.fronted.bus.serve(topics.RPC_ADMIN.key, lambda *_: heard.set())
    viewer = door.joined(load_key(door.keys, Role.viewer))
    posing = load_key(door.keys, Role.viewer)
    object.__setattr__(posing, "role", Role.admin)  # a program that minds no rule of ours
    rogue = door.joined(posing)
    assert rogue.request(topics.RPC_ADMIN.key, b"stop", 0.5) is None
    assert not heard.is_set()
    admin = door.joined(load_key(door.keys, Role.admin))
    admin.request(topics.RPC_ADMIN.key, b"stop", 0.5)
    assert heard.is_set()
    for bus in (viewer, rogue, admin):
        bus.close()


def test_a_relay_has_a_front_too(door: Door) -> None:
    """Roles come through both, and so do the ends of sessions that somebody watches."""
    seen: list[tuple[str, bool]] = []
    door.fronted.bus.watch(
        topics.WORKER_ALIVE.key.format(worker="*"), lambda key, alive: seen.append((key, alive))
    )
    told: list[FrontEvent] = []
    key = load_key(door.keys, Role.conductor)
    relay = Fronted("tls/127.0.0.1:0", "twin", key, told.append, connect=door.endpoint)
    try:
        (at,) = relay.bus.endpoints
        worker = open_bus("client", connect=[at], key=load_key(door.keys, Role.worker))
        wait_for(lambda: worker.request(STATUS, b"far", 1.0) == b"far", "an answer")
        alive = topics.WORKER_ALIVE.key.format(worker="w1")
        worker.announce(alive)
        wait_for(lambda: (alive, True) in seen, "the worker")
        heard = threading.Event()
        door.fronted.bus.serve(topics.RPC_ADMIN.key, lambda *_: heard.set())
        posing = load_key(door.keys, Role.worker)
        object.__setattr__(posing, "role", Role.admin)
        rogue = open_bus("client", connect=[at], key=posing)
        assert rogue.request(topics.RPC_ADMIN.key, b"stop", 0.5) is None
        assert not heard.is_set()
        rogue.close()
        worker.close()
        wait_for(lambda: (alive, False) in seen, "its end")
        assert {event.role for event in told if event.what == "opened"} == {"worker"}
    finally:
        relay.close()
