"""What strangers get of the hub and of `viewer web`: other users, and pages of other sites."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr
from waiting import PATIENCE_S

from twin.fabric.loopback import is_ours
from viewer.browser.front import BrowserFront, ShownSite
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
from viewer.live.gate import HEAD_BYTES_MAX, NATIVE, Gate
from viewer.live.hub import open_hub
from viewer.live.inner_port import InnerPort

NOBODY = 65534
root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else")

TALK = """
import os, socket, sys
uid, port, data = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3].encode()
if uid:
    os.setgroups([])
    os.setgid(uid)
    os.setuid(uid)
line = socket.socket()
line.settimeout({patience})
try:
    line.connect(("127.0.0.1", port))
    line.sendall(data)
    {then}
    while piece := line.recv(1 << 16):
        sys.stdout.write(piece.decode("latin-1"))
except TimeoutError:
    sys.stdout.write("TIMEOUT")
except ConnectionResetError:
    pass
"""


def talk(uid: int, port: int, data: str, *, patience: float = 30, then: str = "") -> str:
    """What a process of ``uid`` is answered."""
    program = TALK.format(patience=patience, then=then)
    words = [sys.executable, "-c", program, str(uid), str(port), data]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=120).stdout


class Echo:
    """Stands where the hub stands."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self.listener.getsockname()[1]
        self.heard: list[bytes] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                line, _ = self.listener.accept()
            except OSError:
                return
            with line:
                self.heard.append(line.recv(1 << 16))
                line.sendall(b"HTTP/1.1 200 OK\r\n\r\nlet in")


@pytest.fixture
def hub() -> Iterator[Echo]:
    echo = Echo()
    yield echo
    with contextlib.suppress(OSError):
        echo.listener.shutdown(socket.SHUT_RDWR)
    echo.listener.close()


@pytest.fixture
def gate(hub: Echo) -> Iterator[Gate]:
    inner = InnerPort(hub.port)
    found = Gate(0, lambda _: None)
    found.serve(inner)
    yield found
    found.close()
    inner.end()


def ask(*lines: str) -> str:
    return "\r\n".join(["POST / HTTP/1.1", *lines, "", ""])


@pytest.mark.parametrize(
    "request_",
    [
        NATIVE.decode(),
        ask("Host: localhost:9876"),
        ask("host:127.0.0.1"),
        ask("Host: [::1]:1", "Origin: http://localhost:9090"),
    ],
)
def test_own_viewers_and_pages_are_let_in(gate: Gate, hub: Echo, request_: str) -> None:
    assert "let in" in talk(0, gate.port, request_)
    assert hub.heard == [request_.encode()]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (ask("Host: evil.example:9876"), "ask for localhost"),
        (ask("Host: localhost.evil.example"), "ask for localhost"),
        (ask("Host: localhost", "Host: evil.example"), "ask for localhost"),
        (ask(), "ask for localhost"),
        (ask("Host: localhost:evil"), "ask for localhost"),
        (ask("Host: localhost", "Origin: http://evil.example"), "another site"),
        (ask("Host: localhost", "Origin: null"), "another site"),
        ("x" * (HEAD_BYTES_MAX + 1), "no request"),
    ],
)
def test_pages_of_other_sites_are_not(gate: Gate, hub: Echo, request_: str, words: str) -> None:
    answer = talk(0, gate.port, request_)
    assert answer.startswith("HTTP/1.1 403 ")
    assert words in answer
    assert hub.heard == []


@root
def test_another_user_is_not(gate: Gate, hub: Echo) -> None:
    answer = talk(NOBODY, gate.port, NATIVE.decode())
    assert answer.startswith("HTTP/1.1 403 ")
    assert "another user" in answer
    assert hub.heard == []


@root
def test_nor_past_the_gate(hub: Echo, gate: Gate) -> None:
    """Straight to the hub's own port, while a line of ours is open."""
    with socket.create_connection(("127.0.0.1", gate.port)) as ours:
        ours.sendall(NATIVE)
        assert ours.recv(1 << 10)
        assert talk(NOBODY, hub.port, "hello", patience=1.5) == "TIMEOUT"
        assert talk(0, hub.port, "hello", patience=1.5) == "TIMEOUT"
    assert hub.heard == [NATIVE]


@root
def test_the_hub_of_rerun_takes_nothing_from_another_user() -> None:
    others = _listening_ports(os.getpid())  # servers that other tests keep in this process
    real = open_hub(0)
    try:
        assert "403" in talk(NOBODY, real.port, NATIVE.decode())
        listening = _listening_ports(os.getpid()) - others - {real.port}
        assert listening, "Rerun's own port"
        for port in listening:
            assert talk(NOBODY, port, NATIVE.decode(), patience=1.5) == "TIMEOUT"
    finally:
        real.close()


def _listening_ports(pid: int) -> set[int]:
    own = set()
    for path in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):  # another thread has closed it
            own.add(str(path.readlink()))
    rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return {
        int(row[1].split(":")[1], 16)
        for row in rows
        if row[3] == "0A" and f"socket:[{row[9]}]" in own
    }


def test_who_came_before_the_filter_is_shown_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as early:
            accepted, _ = listener.accept()
            inner = InnerPort(port)
            assert accepted.recv(1) == b""
            late = inner.connect()
            again, _ = listener.accept()
            late.sendall(b"x")
            assert again.recv(1) == b"x"
            for line in (accepted, again):
                line.close()
            inner.close(late)
            inner.end()
            assert early.fileno() > 0


def test_a_port_of_nobody_cannot_be_closed() -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(200):
        with pytest.raises(OSError, match="nobody listens"):
            InnerPort(1)
    # Servers of other tests end in their own time, and open and close some of theirs meanwhile.
    assert len(os.listdir("/proc/self/fd")) < before + 100


@root
def test_who_hangs_up_at_once_counts_as_a_stranger() -> None:
    """What is left of a connection belongs to user id 0 in the kernel's table."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        talk(NOBODY, port, "x", then="sys.exit()")
        line, _ = listener.accept()
        with line:
            assert not is_ours(line)


def test_a_connection_of_ours_is_ours() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()),
    ):
        line, _ = listener.accept()
        with line:
            assert is_ours(line)


@pytest.fixture
def front(tmp_path: Path) -> Iterator[BrowserFront]:
    with BrowserFront(0, ShownSite({}, ConsoleSite(find_runs(a_run(tmp_path))))) as found:
        threading.Thread(target=found.serve_forever, daemon=True).start()
        yield found
        found.shutdown()


def a_run(folder: Path) -> Path:
    """Recordings that are a file, links of all kinds, and somebody else's file."""
    (folder / "secret").write_text("SECRET")
    (folder / "secret").chmod(0o600)
    run = folder / "run"
    for case in ("good", "link", "foreign", "device"):
        (run / "cases" / case / "attempt-1").mkdir(parents=True)
    (run / "cases/good/attempt-1/recording.rrd").write_text("RECORDED")
    (run / "cases/link/attempt-1/recording.rrd").symlink_to(folder / "secret")
    (run / "cases/device/attempt-1/recording.rrd").symlink_to("/dev/zero")
    (run / "cases/foreign/attempt-1/recording.rrd").write_text("SECRET")
    if os.geteuid() == 0:
        os.chown(run / "cases/foreign/attempt-1/recording.rrd", NOBODY, NOBODY)
    (folder / "elsewhere/attempt-1").mkdir(parents=True)
    (folder / "elsewhere/attempt-1/recording.rrd").write_text("SECRET")
    (run / "cases/folder-link").symlink_to(folder / "elsewhere")
    (run / "cases/attempt-link").mkdir()
    (run / "cases/attempt-link/attempt-1").symlink_to(folder / "elsewhere/attempt-1")
    return run


def get(front: BrowserFront, case: str, path: str = "recording/{}.rrd") -> str:
    head = f"GET /{path.format(case)} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    return talk(0, front.server_address[1], head)


def test_a_recording_that_is_a_file_is_served(front: BrowserFront) -> None:
    assert get(front, "good").endswith("RECORDED")


@pytest.mark.parametrize("case", ["link", "device", "folder-link", "attempt-link"])
def test_a_link_is_no_recording(front: BrowserFront, case: str) -> None:
    answer = get(front, case)
    assert answer.startswith("HTTP/1.1 404 ")
    assert "SECRET" not in answer
    assert "was not recorded" in answer
    # Nor is its picture made, nor anything read that lies beside it.
    for path in ("moment.webp", "case.json", "series.json", "film/0.webp"):
        assert "SECRET" not in get(front, case, f"data/runs/run/cases/{{}}/{path}")


@root
def test_nor_is_what_somebody_else_put_there(front: BrowserFront) -> None:
    assert "was not recorded" in get(front, "foreign")


@root
def test_pages_are_for_the_user_who_serves_them(front: BrowserFront) -> None:
    request_ = "GET /recording/good.rrd HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    answer = talk(NOBODY, front.server_address[1], request_)
    assert answer.startswith("HTTP/1.1 403 ")
    assert "another user" in answer
    assert "RECORDED" not in answer
    assert get(front, "good").endswith("RECORDED"), "its own user is served as before"


def test_recordings_of_ours_reach_the_hub_through_its_door() -> None:
    real = open_hub(0)
    stream = rr.RecordingStream("test", recording_id="one")
    try:
        stream.set_sinks(rr.GrpcSink(real.url))
        stream.log("x", rr.TextLog("hello"))
        stream.flush(timeout_sec=PATIENCE_S)  # raises if it does not arrive
        assert real.open()
    finally:
        stream.disconnect()
        real.close()
