"""The hub's door: what passes, who is cut off, and that it ends."""

import contextlib
import os
import socket
import threading
from types import SimpleNamespace

import pytest
from waiting import PATIENCE_S

from viewer.live import hub as hubs
from viewer.live.gate import LAG_S, LEAST_BYTES, NATIVE, Gate, ViewerLine, laggards
from viewer.live.hub import ViewerHub, open_hub
from viewer.live.inner_port import InnerPort


class Server:
    """A hub that answers what it is sent, and is told when a line ends."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.ended = threading.Semaphore(0)
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                line, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.echo, args=(line,), daemon=True).start()

    def close(self):
        # A thread that waits in accept keeps the port open otherwise.
        with contextlib.suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()

    def echo(self, line):
        with line:
            while data := line.recv(1 << 16):
                line.sendall(data)
        self.ended.release()


@pytest.fixture
def server():
    found = Server()
    yield found
    found.close()


@pytest.fixture
def said():
    return []


@pytest.fixture
def gate(server, said):
    found = Gate(0, said.append)
    inner = InnerPort(server.port)
    found.serve(inner)
    yield found
    found.close()
    inner.end()


@pytest.fixture
def knock(gate):
    """Opens viewers that have been sent enough."""
    viewers = []

    def one(data=NATIVE + b"x" * (2 * LEAST_BYTES)):
        viewer = socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S)
        viewers.append(viewer)
        sender = threading.Thread(target=viewer.sendall, args=(data,), daemon=True)
        sender.start()
        left = len(data)
        while left:
            left -= len(viewer.recv(left))
        sender.join()
        # What came before the echo of this is counted.
        viewer.sendall(b"y")
        assert viewer.recv(1) == b"y"
        return viewer

    yield one
    for viewer in viewers:
        viewer.close()


def lines(*found):
    return [ViewerLine(None, passed_bytes, passed_s) for passed_bytes, passed_s in found]


def test_who_has_not_come_as_far_as_others():
    much = LEAST_BYTES
    assert laggards([]) == []
    assert laggards(lines((much, 5.0))) == [], "alone: nobody waits for it"
    assert laggards(lines((much, 5.0), (much, 5.0 + LAG_S))) == []
    slow, fast = lines((much, 5.0), (much, 5.1 + LAG_S))
    assert laggards([slow, fast]) == [slow]
    assert laggards(lines((much - 1, 5.0), (much, 50.0))) == [], "it shows nothing"
    assert laggards(lines((much, 5.0), (much - 1, 50.0))) == [], "nor does this"


def test_the_slowest_is_cut_off_and_the_others_go_on(gate, knock, server, said):
    slow = knock()
    [line] = gate._lines
    fast = knock()
    line.passed_s -= 2 * LAG_S
    gate.relieve()
    assert server.ended.acquire(timeout=PATIENCE_S), "the hub is rid of it"
    assert slow.recv(1) == b""
    [line] = said
    assert "cut off" in line
    fast.sendall(b"y")
    assert fast.recv(1) == b"y"
    gate.relieve()
    assert len(said) == 1


def test_either_side_may_go(gate, knock, server):
    viewer = knock()
    viewer.close()
    assert server.ended.acquire(timeout=PATIENCE_S)
    server.close()
    with socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S) as late:
        late.sendall(NATIVE)
        assert late.recv(1) == b"", "there is no hub any more"


def test_closing_lets_everybody_out(gate, knock):
    viewer = knock()
    gate.close()
    assert viewer.recv(1) == b""
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", gate.port), timeout=PATIENCE_S)


def test_a_hub_that_stands_still_for_long_is_relieved(monkeypatch):
    class Stuck:
        def flush(self, timeout_sec):
            raise RuntimeError("timeout")

    class Door:
        relieved = 0

        def relieve(self):
            self.relieved += 1

    now_s = [100.0]
    monkeypatch.setattr(hubs, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    hub = ViewerHub(Stuck(), "rerun+http://127.0.0.1:1/proxy", gate=Door())
    for after_s, relieved in ((0.0, 0), (hubs.PATIENCE_S - 0.1, 0), (hubs.PATIENCE_S, 1)):
        now_s[0] = 100.0 + after_s
        assert not hub.open()
        assert hub._gate.relieved == relieved
    assert not hub.open()
    assert hub._gate.relieved == 1, "once per patience"


def test_the_laptop_is_told_the_gates_port():
    hub = open_hub(0)
    try:
        assert hub.url == f"rerun+http://127.0.0.1:{hub.port}/proxy"
    finally:
        hub.close()


def test_so_many_viewers_and_no_more(server, gate, monkeypatch):
    monkeypatch.setattr("viewer.live.gate.LINES_MAX", 2)
    with contextlib.ExitStack() as opened:
        lines = []
        for _ in range(3):
            line = opened.enter_context(socket.create_connection(("127.0.0.1", gate.port)))
            line.settimeout(PATIENCE_S)
            lines.append(line)
            with contextlib.suppress(OSError):  # the last one may be closed already
                line.sendall(NATIVE)
                if len(lines) < 3:
                    assert line.recv(len(NATIVE)) == NATIVE
        with contextlib.suppress(ConnectionResetError):
            assert lines[2].recv(5) == b""


def test_descriptors_that_only_name_a_socket_are_none_of_its(server, tmp_path):
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(str(tmp_path / "door"))
        named = os.open(tmp_path / "door", os.O_PATH)
        try:
            inner = InnerPort(server.port)
        finally:
            os.close(named)
    line = inner.connect()
    line.sendall(b"here")
    assert line.recv(4) == b"here"
    inner.close(line)
    inner.end()
