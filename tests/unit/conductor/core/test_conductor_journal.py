"""The journal on a real disk: order, groups, locks, kill -9, and no space left."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from conductor_bench import Bench, hello, result, submit

from conductor.core.decisions import start
from conductor.core.facts import CaseEnded, Draining, EpochRaised, Fact, Replied, Seen
from conductor.core.fold import fold
from conductor.core.state import State
from conductor.journal import store
from conductor.journal.owner import FILE_NAME as OWNER_FILE
from conductor.journal.owner import FolderOwner
from conductor.journal.store import FolderLockedError, Journal, JournalError, TakenOverError
from twin.base.errors import UsageError

_APPENDER = """
import sys
from pathlib import Path
from conductor.core.facts import CaseEnded
from conductor.journal.store import Journal

journal = Journal(Path(sys.argv[1]))
print("open", flush=True)
for group in range(100_000):
    journal.append([
        CaseEnded(campaign="alpha", case=f"{group}/{i}", outcome="cancelled", reason="")
        for i in range(4)
    ])
    print(group, flush=True)
"""


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[Journal]:
    journal = Journal(folder)
    try:
        yield journal
    finally:
        journal.close()


def _some(number: int, text: str = "") -> Fact:
    return CaseEnded(campaign="alpha", case=str(number), outcome="cancelled", reason=text)


def test_a_request_dirties_a_page_per_table_and_none_of_an_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "LOG_BYTES", 0)  # so that what is written makes it longer
    bench = Bench()
    bench.ask(submit(cases=30))
    workers = ("w1", "w2", "w3")
    for worker in workers:
        bench.ask(hello(worker))
    log = tmp_path / "conductor.db-wal"
    pages = []
    with opened(tmp_path) as journal:
        journal.append(bench.journal)
        for _ in range(3):
            for worker in workers:
                before, begin = log.stat().st_size, len(bench.journal)
                bench.next(worker)
                journal.append(bench.journal[begin:])
                pages.append((log.stat().st_size - before) / (4096 + 24))
        replies = [fact.worker for fact in journal.fold() if isinstance(fact, Replied)]
    assert sorted(replies) == sorted(workers)
    # Facts, replies, and where the chain stands; now and then the facts need a new page.
    assert sorted(pages[3:])[3] == 3, pages


def test_what_is_appended_is_folded_in_order(tmp_path: Path) -> None:
    with opened(tmp_path) as journal:
        journal.append([_some(1), Seen(worker="w", now_ns=1, until_ns=2), _some(2)])
        journal.append([Draining()])
        journal.append([_some(3)])
    with opened(tmp_path) as journal:
        assert list(journal.fold()) == [_some(1), _some(2), _some(3)]


def test_a_conductors_life_survives_the_disk(tmp_path: Path) -> None:
    bench = Bench()
    requests = [submit(), hello()]
    with opened(tmp_path) as journal:
        journal.append(bench.journal)
        for request in requests:
            mark = len(bench.journal)
            bench.ask(request)
            journal.append(bench.journal[mark:])
        mark = len(bench.journal)
        leases = bench.lease(k=3)
        bench.next(k=1, results=[result(leases[0])], held=[leases[1].token])
        journal.append(bench.journal[mark:])
        assert fold(journal.fold()) == bench.state
        mark = len(bench.journal)
        bench.bye()
        journal.append(bench.journal[mark:])
        assert fold(journal.fold()) == bench.state


def test_one_process_per_folder(tmp_path: Path) -> None:
    with opened(tmp_path), pytest.raises(FolderLockedError, match="in use by another conductor"):
        Journal(tmp_path)
    with opened(tmp_path):
        pass


def test_another_version_is_refused(tmp_path: Path) -> None:
    with opened(tmp_path):
        pass
    with contextlib.closing(sqlite3.connect(tmp_path / "conductor.db")) as connection:
        connection.execute("UPDATE meta SET value = '99' WHERE name = 'version'")
        connection.commit()
    with pytest.raises(UsageError, match="written by version 99"):
        Journal(tmp_path)


def test_what_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / "conductor.db").write_text("not a database, but long enough to be looked at" * 9)
    with pytest.raises(UsageError, match="not a database"):
        Journal(tmp_path)
    with pytest.raises(UsageError, match="cannot be opened"):
        Journal(tmp_path / "missing")


def test_a_damaged_fact_names_itself(tmp_path: Path) -> None:
    with opened(tmp_path) as journal:
        journal.append([_some(1)])
    with contextlib.closing(sqlite3.connect(tmp_path / "conductor.db")) as connection:
        connection.execute("UPDATE facts SET fact = x'c1'")
        connection.commit()
    with opened(tmp_path) as journal, pytest.raises(JournalError, match="fact 1 is damaged"):
        list(journal.fold())


@pytest.mark.parametrize("groups", [1, 2, 7, 40])
def test_kill_nine_loses_nothing_acknowledged_and_splits_no_group(
    tmp_path: Path, groups: int
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _APPENDER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "open\n"
    with pytest.raises(FolderLockedError):
        Journal(tmp_path)
    acknowledged = [int(process.stdout.readline()) for _ in range(groups)]
    process.send_signal(signal.SIGKILL)
    acknowledged += [int(line) for line in process.stdout.read().splitlines()]
    process.stdout.close()
    process.wait()
    with opened(tmp_path) as journal:
        cases = [fact.case for fact in journal.fold() if isinstance(fact, CaseEnded)]
    assert len(cases) % 4 == 0
    assert len(cases) // 4 in (len(acknowledged), len(acknowledged) + 1)
    assert cases == [f"{group}/{i}" for group in range(len(cases) // 4) for i in range(4)]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    if os.geteuid() != 0:
        pytest.skip("mounting a small tmpfs needs root")
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a small tmpfs cannot be mounted here: {done.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_rolls_back_and_recovers(small_disk: Path) -> None:
    filler = small_disk / "filler"
    with opened(small_disk) as journal:
        journal.append([_some(1)])
        with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(b"x" * 4096)
        group = [_some(number, "y" * 5000) for number in range(2, 30)]
        with pytest.raises(JournalError) as caught:
            journal.append(group)
        assert "full" in str(caught.value) or "I/O" in str(caught.value)
        assert "\n" not in str(caught.value)
        assert list(journal.fold()) == [_some(1)]
        filler.unlink()
        journal.probe()
        journal.append(group)
        assert list(journal.fold()) == [_some(1), *group]
    with opened(small_disk) as journal:
        assert list(journal.fold()) == [_some(1), *group]


def test_the_epoch_grows_with_every_start(tmp_path: Path) -> None:
    for epoch in (1, 2, 3):
        with opened(tmp_path) as journal:
            state = fold(journal.fold())
            journal.append(start(state))
            assert state.epoch == epoch
    assert start(State()) == [EpochRaised(epoch=1)]


def _watched(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Journal, sqlite3.Connection]:
    """A journal and the connection that it opened."""
    opened_here: list[sqlite3.Connection] = []
    connect = sqlite3.connect

    def connecting(*arguments: Any, **options: Any) -> sqlite3.Connection:
        opened_here.append(connect(*arguments, **options))
        return opened_here[-1]

    monkeypatch.setattr(sqlite3, "connect", connecting)
    journal = Journal(folder)
    (connection,) = opened_here
    return journal, connection


def test_a_commit_is_on_the_disk_when_it_is_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FULL (2): with NORMAL a commit of a log that is written ahead outlives no power failure."""
    journal, connection = _watched(tmp_path, monkeypatch)
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
    journal.close()


def test_the_owner_is_asked_for_when_all_is_written_and_nothing_committed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A successor may take over while facts are written: none of them must come to count."""
    journal, connection = _watched(tmp_path, monkeypatch)
    journal.append([_some(1)])
    thief = FolderOwner(id="thief", host="there", pid=2)

    def take_over(statement: str) -> None:
        if statement.startswith("INSERT INTO facts"):
            (tmp_path / OWNER_FILE).write_bytes(msgspec.json.encode(thief))

    connection.set_trace_callback(take_over)
    with pytest.raises(TakenOverError, match=r"pid 2 on there"):
        journal.append([_some(2)])
    connection.set_trace_callback(None)
    assert connection.execute("SELECT count(*) FROM facts").fetchone() == (1,)
    journal.close()


def test_the_log_has_its_size_from_the_start_and_what_is_behind_its_frames_is_nothing(
    tmp_path: Path,
) -> None:
    """Also for whoever opens it after a kill."""
    state, killed = tmp_path / "state", tmp_path / "killed"
    state.mkdir()
    killed.mkdir()
    log = state / "conductor.db-wal"
    with opened(state) as journal:
        assert log.stat().st_size == store.LOG_BYTES
        for number in range(5):
            journal.append([_some(number)])
        assert log.stat().st_size == store.LOG_BYTES
        for name in ("conductor.db", "conductor.db-wal"):
            (killed / name).write_bytes((state / name).read_bytes())
    assert not log.exists()
    with opened(killed) as journal:
        assert list(journal.fold()) == [_some(number) for number in range(5)]
        assert (killed / log.name).stat().st_size == store.LOG_BYTES
        for number in range(5, 800):  # beyond the end of the log, which begins anew
            journal.append([_some(number)])
    with opened(killed) as journal:
        assert list(journal.fold()) == [_some(number) for number in range(800)]


@pytest.mark.parametrize("lacking", ["room", "file"])
def test_without_room_the_log_grows_as_it_goes(
    lacking: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if lacking == "room":
        monkeypatch.setattr(store, "LOG_ROOM", 1 << 60)
    else:
        monkeypatch.setattr(store, "_no_link", _nothing_there)
    with opened(tmp_path) as journal:
        journal.append([_some(1)])
        assert 0 < (tmp_path / "conductor.db-wal").stat().st_size < store.LOG_BYTES
        assert list(journal.fold()) == [_some(1)]


def _nothing_there(path: str, _flags: int) -> int:
    raise OSError(28, "No space left on device", path)


def test_no_zeros_are_written_through_a_link(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.write_bytes(b"kept")
    (tmp_path / "conductor.db-wal").symlink_to(theirs)
    store.extend_log(tmp_path / "conductor.db")
    assert theirs.read_bytes() == b"kept"
