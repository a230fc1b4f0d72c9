"""conductor.run.gpu_turns: who may begin to use a GPU, and that nobody waits for the dead."""

from __future__ import annotations

import array
import fcntl
import os
import signal
import socket
import subprocess
import sys
import termios
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

import pytest
from waiting import wait_for

from conductor.run.gpu_turns import TURNS, Queue, turns
from twin.base.gpu.first_use import TURNS_VARIABLE, _turn


class Guest:
    """A process that would like to begin."""

    def __init__(self, at_end: ExitStack, line: str) -> None:
        self.socket = at_end.enter_context(socket.socket(socket.AF_UNIX))
        self.socket.connect(os.environ[TURNS_VARIABLE])
        self.socket.sendall(line.encode())
        wait_for(self._is_read, "the line is read")

    def _is_read(self) -> bool:
        unread = array.array("i", [0])
        fcntl.ioctl(self.socket, termios.TIOCOUTQ, unread)
        return unread[0] == 0

    def waits(self) -> bool:
        """Nothing has come, not even the end."""
        self.socket.settimeout(0)
        try:
            self.socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return True
        return False

    def get(self) -> bytes:
        """The turn; nothing: there is none any more."""
        self.socket.settimeout(60.0)
        with suppress(ConnectionResetError):
            return self.socket.recv(1)
        return b""

    def end(self) -> None:
        """It has begun, or died."""
        self.socket.close()


@pytest.fixture
def guest():
    with ExitStack() as at_end:
        yield partial(Guest, at_end)


def test_so_many_at_once_then_by_place(guest, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # its own path may be too long
    monkeypatch.setenv(TURNS_VARIABLE, "turns")
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(os.environ[TURNS_VARIABLE])
        door.listen()
        queue = Queue(door)
        first = [guest("70\n") for _ in range(TURNS)]
        assert [one.get() for one in first] == [b"\n"] * TURNS
        late = {place: guest(f"{place}\n") for place in (9, 10, 8)}
        wait_for(lambda: len(queue.waiting) == len(late), "all wait")
        order = []
        first[0].end()
        while late:
            wait_for(lambda: not all(one.waits() for one in late.values()), "the next turn")
            (place,) = (place for place, one in late.items() if not one.waits())
            order.append(place)
            one = late.pop(place)
            assert one.get() == b"\n"
            one.end()
        assert order == [8, 9, 10]
        queue.close()


def test_who_left_the_queue_holds_nobody_up(guest):
    with turns("cuda:0"):
        first = [guest("0\n") for _ in range(TURNS)]
        assert [one.get() for one in first] == [b"\n"] * TURNS
        gone, last = guest("1\n"), guest("2\n")
        gone.end()
        assert last.waits()
        first[0].end()
        assert last.get() == b"\n"


@pytest.mark.parametrize("line", ["", "\n", "first\n", "x" * 100_000])
def test_who_says_nothing_sensible_gets_no_turn_and_takes_none(guest, line):
    with turns("cuda:0"):
        strange = [guest(line) for _ in range(TURNS)]
        fine = guest("3\n")
        assert fine.get() == b"\n"
        for one in strange:
            one.end()


def test_at_the_end_nobody_waits_any_more(guest):
    with turns("cuda:0"):
        guests = [guest("0\n") for _ in range(TURNS)]
        assert [one.get() for one in guests] == [b"\n"] * TURNS
        guests.append(guest("0\n"))
    assert guests[-1].get() == b""
    assert TURNS_VARIABLE not in os.environ


def test_a_killed_run_lets_everybody_go(guest):
    code = (
        "import os, time\nfrom conductor.run.gpu_turns import turns\n"
        f"with turns('cuda:0'):\n    print(os.environ['{TURNS_VARIABLE}'], flush=True)\n"
        "    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as run:
        os.environ[TURNS_VARIABLE] = run.stdout.readline().strip()
        try:
            guests = [guest("0\n") for _ in range(TURNS)]
            assert [one.get() for one in guests] == [b"\n"] * TURNS
            guests.append(guest("0\n"))
            run.send_signal(signal.SIGKILL)
            assert guests[-1].get() == b""
            with _turn():
                pass  # whoever comes now goes on
            folder = Path(os.environ[TURNS_VARIABLE]).parent
            wait_for(lambda: not folder.exists(), "its folder is gone")
        finally:
            os.environ.pop(TURNS_VARIABLE)


def test_a_cpu_has_no_turns():
    with turns("cpu"):
        assert TURNS_VARIABLE not in os.environ


def test_the_socket_lies_in_a_private_folder_that_goes_with_the_run(monkeypatch, tmp_path):
    deep = tmp_path / ("x" * 60) / ("y" * 60)
    deep.mkdir(parents=True)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    with turns("cuda:0"):
        path = Path(os.environ[TURNS_VARIABLE])
        assert len(os.fsencode(path)) < 108
        assert path.parent.stat().st_mode & 0o777 == 0o700
    assert not path.parent.exists()


def test_more_than_so_many_are_sent_away_at_once(guest, monkeypatch):
    monkeypatch.setattr("conductor.run.gpu_turns.GUESTS_MAX", TURNS + 1)
    with turns("cuda:0"):
        guests = [guest("0\n") for _ in range(TURNS + 1)]
        assert guests[-1].waits()
        with socket.socket(socket.AF_UNIX) as beyond:
            beyond.settimeout(60.0)
            beyond.connect(os.environ[TURNS_VARIABLE])
            with suppress(ConnectionResetError):
                assert beyond.recv(1) == b""


def test_one_that_keeps_its_turn_loses_it(guest, monkeypatch):
    monkeypatch.setattr("conductor.run.gpu_turns.TURN_S", 0.2)
    with turns("cuda:0"):
        kept = [guest("0\n") for _ in range(TURNS)]
        assert [one.get() for one in kept] == [b"\n"] * TURNS
        assert guest("1\n").get() == b"\n"
