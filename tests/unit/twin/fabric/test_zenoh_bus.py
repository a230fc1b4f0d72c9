"""The Zenoh bus on loopback: real sessions, real ports."""

import gc
import socket
import subprocess
import sys
import threading
import weakref

import psutil
import pytest
from waiting import PATIENCE_S, wait_for

from twin.base.errors import InfrastructureError, UsageError
from twin.fabric import zenoh_bus
from twin.fabric.endpoint import host_and_port
from twin.fabric.zenoh_bus import open_bus

LOOPBACK = ["tcp/127.0.0.1:0"]


def test_request_reply_and_real_port():
    router = open_bus("router", listen=LOOPBACK)
    try:
        router.serve("conductor/rpc", lambda payload, respond: respond(payload + b"!"))
        client = open_bus("client", connect=router.endpoints)
        assert client.request("conductor/rpc", b"hi", PATIENCE_S) == b"hi!"
        assert client.request("nobody/home", b"hi", 0.2) is None
        client.close()
        assert client.request("conductor/rpc", b"hi", 0.2) is None
    finally:
        router.close()


def test_all_who_serve_one_key_are_gathered():
    router = open_bus("router", listen=LOOPBACK)
    try:
        for name in (b"one", b"two"):
            answerer = open_bus("client", connect=router.endpoints)
            answerer.serve("view/a/case/control", lambda _, respond, name=name: respond(name))
        asker = open_bus("client", connect=router.endpoints)
        for key in ("view/a/case/control", "view/*/case/control"):
            # The router hears of the two in no order with who asks.
            wait_for(
                lambda key=key: sorted(asker.gather(key, b"", PATIENCE_S)) == [b"one", b"two"],
                "an answer of each",
            )
    finally:
        router.close()


def heard_at():
    """Sockets of this process at which anybody may be heard."""
    connections = psutil.Process().net_connections("inet")
    return {
        (c.fd, c.type, c.laddr)
        for c in connections
        if c.status == psutil.CONN_LISTEN or (c.type == socket.SOCK_DGRAM and not c.raddr)
    }


def test_nothing_listens_beyond_loopback():
    others = heard_at()  # that other tests keep in this process
    router = open_bus("router", listen=LOOPBACK)
    try:
        assert {address.ip for _, _, address in heard_at() - others} == {"127.0.0.1"}
    finally:
        router.close()


def test_namespaces_do_not_hear_each_other():
    router = open_bus("router", listen=LOOPBACK, namespace="one")
    try:
        router.serve("conductor/rpc", lambda payload, respond: respond(b"one"))
        stranger = open_bus("client", connect=router.endpoints, namespace="two")
        friend = open_bus("client", connect=router.endpoints, namespace="one")
        assert friend.request("conductor/rpc", b"", PATIENCE_S) == b"one"
        assert stranger.request("conductor/rpc", b"", 0.3) is None
        stranger.close()
        friend.close()
    finally:
        router.close()


def test_who_connects_and_says_nothing_is_sent_away(monkeypatch):
    monkeypatch.setattr(zenoh_bus, "ACCEPT_S", 0.3)
    router = open_bus("router", listen=LOOPBACK)
    try:
        # Zenoh's own patience is 10 s, and closing a session waits for it.
        with socket.create_connection(host_and_port(router.endpoints[0]), 7) as silent:
            assert silent.recv(1) == b""
    finally:
        router.close()


def test_liveliness_tells_of_the_end_of_a_session():
    router = open_bus("router", listen=LOOPBACK)
    try:
        came, went = threading.Event(), threading.Event()
        router.watch("worker/*", lambda key, alive: (came if alive else went).set())
        client = open_bus("client", connect=router.endpoints)
        client.announce("worker/w1")
        assert came.wait(PATIENCE_S)
        client.close()
        assert went.wait(PATIENCE_S)
    finally:
        router.close()


def test_port_in_use_is_one_line():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=f"{port}: address already in use") as error:
            open_bus("router", listen=[f"tcp/127.0.0.1:{port}"])
    assert len(str(error.value).splitlines()) == 1


def test_nobody_answers_is_one_line():
    with pytest.raises(InfrastructureError, match="nobody answers") as error:
        open_bus("client", connect=["tcp/127.0.0.1:1"], connect_timeout_s=0.2)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    "endpoint", ["", "localhost:7447", "tcp/host", "tcp/host:x", "http/h:1", "tcp/h:65536"]
)
def test_bad_endpoints_are_named(endpoint):
    with pytest.raises(UsageError, match="endpoint"):
        open_bus("router", listen=[endpoint])


def test_a_closed_session_is_forgotten():
    bus = open_bus("router", listen=["tcp/127.0.0.1:0"])
    left = weakref.ref(bus)
    bus.close()
    del bus
    gc.collect()
    assert left() is None


def test_a_session_left_open_does_not_stop_the_interpreter_from_ending():
    program = (
        "from twin.fabric.zenoh_bus import open_bus\n"
        "bus = open_bus('router', listen=['tcp/127.0.0.1:0'])\n"
        "bus.subscribe('a', print)\n"
        "raise SystemExit(7)\n"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=PATIENCE_S).returncode == 7
