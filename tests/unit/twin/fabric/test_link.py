"""What came in on links is known before any message is complete."""

import os
import socket

import pytest

from twin.fabric import link
from twin.fabric.link import LinkWatch, received_bytes


@pytest.fixture
def connected():
    """A listening port, and both ends of a connection to it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = socket.create_connection(server.getsockname())
        accepted, _ = server.accept()
        with client, accepted:
            yield server.getsockname()[1], client, accepted


def test_the_kernel_says_what_a_connection_brought(connected):
    port, client, accepted = connected
    assert received_bytes({port}) == 0
    client.sendall(bytes(5000))
    while received_bytes({port}) < 5000:
        pass  # it is on its way
    assert received_bytes({port}) == 5000  # also what nobody has read yet
    accepted.sendall(b"answer")
    client.recv(6)
    assert received_bytes({port}) == 5000  # our end of it only
    assert received_bytes({port + 1}) == 0
    assert accepted.recv(5000, socket.MSG_WAITALL) == bytes(5000)  # the descriptor is still whole
    os.fstat(client.fileno())


def test_only_what_is_under_way_is_excess(monkeypatch):
    brought = 0
    monkeypatch.setattr(link, "received_bytes", lambda ports: brought if ports == {7} else 0)
    watch = LinkWatch(["tcp/127.0.0.1:7"])
    brought = 1000
    assert watch.excess(0) == 1000
    brought = 5000
    assert watch.excess(0) == 5000  # it grows while nothing arrives
    brought = 5200
    assert watch.excess(5100) == 100  # all but its frames was that message
    brought = 5300
    assert watch.excess(5100) == 100  # and what came before it does not count any more
    brought = 9000
    assert watch.excess(5200) == 3700  # one that was dropped, and a small one behind it
    brought = 100
    assert watch.excess(5200) == 0  # a connection was closed


def test_a_session_that_listens_nowhere_has_no_links():
    assert LinkWatch([]).excess(0) == 0
