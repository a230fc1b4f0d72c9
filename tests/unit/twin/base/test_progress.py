"""Progress: counted where somebody looks, and nothing where nobody does."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import re
import sys
import threading
from types import SimpleNamespace

import pytest

from twin.base import progress
from twin.base.progress import BYTES, bars, counter, steps


@contextlib.contextmanager
def terminal():
    """Standard error is a terminal while the block lasts; a list gets what it was sent."""
    master, slave = pty.openpty()
    shown: list[str] = []

    def read() -> None:  # all the time: a terminal takes four kilobytes, then it waits
        data = b""
        while not data.endswith(b"\0"):
            data += os.read(master, 65536)
        shown.append(re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", data.decode()))

    reader = threading.Thread(target=read)
    with pytest.MonkeyPatch.context() as patch, os.fdopen(slave, "w") as file:
        patch.setenv("TERM", "xterm")
        patch.setenv("COLUMNS", "100")
        for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
            patch.delenv(name, raising=False)
        # Here: pytest sets its own between a fixture and its test.
        patch.setattr(sys, "stderr", file)
        reader.start()
        try:
            yield shown
        finally:
            file.write("\0")  # the end of what is read
            file.flush()
            reader.join()
    os.close(master)


def test_nobody_looks():
    items = [1, 2, 3]
    assert steps("cases", items) is items
    more = counter("cases", 3)
    more(2)
    assert more is counter("others", 5)


def test_without_a_terminal_nothing_is_said(monkeypatch):
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.setenv("FORCE_COLOR", "1")
    items = [1, 2]
    with bars() as told:
        assert steps("cases", items) is items
        told("files", 1, 2)
    assert said.getvalue() == ""


def test_a_bar_ends_at_all_of_them(capsys):
    with terminal() as shown, bars():
        seen = list(steps("KPI files", ["a", "b", "c"]))
        print("a result")
    assert seen == ["a", "b", "c"]
    rows = [row for row in shown[0].splitlines() if "KPI files" in row]
    assert "0%" in rows[0]
    assert "0/3" in rows[0]
    assert "100%" in rows[-1]
    assert "3/3" in rows[-1]
    assert "/s" in rows[-1]
    assert capsys.readouterr().out == "a result\n"


def test_bytes_are_shown_with_their_unit():
    with terminal() as shown, bars():
        more = counter(BYTES, 5_000_000)
        more(2_000_000)
        more(3_000_000)
    assert "5.0 MB/5.0 MB" in shown[0]
    assert "B/s" in shown[0]


def test_what_begins_anew_gets_a_row_of_its_own():
    with terminal() as shown, bars():
        for count in (4, 0, 5):
            list(steps("rounds", range(count)))
    rows = shown[0].splitlines()
    assert [row.split()[3] for row in rows if "rounds" in row][-2:] == ["4/4", "5/5"]


def test_a_bar_is_not_drawn_more_often_than_a_terminal_shows(monkeypatch):
    now_s = iter(range(10_000))
    monkeypatch.setattr(progress, "REDRAW_S", 100)
    # Of this module alone: Rich keeps the clock that it finds when it is imported.
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(now_s)))
    with terminal() as shown, bars():
        list(steps("cases", range(1000)))
    assert "1000/1000" in shown[0]
    assert 8 <= len(set(re.findall(r"\d+/1000", shown[0]))) <= 12


def test_after_the_block_nobody_looks_any_more():
    with terminal(), pytest.raises(RuntimeError), bars():
        raise RuntimeError
    items = [1]
    assert steps("cases", items) is items
