"""Two conductors, one folder: who is refused, who takes over, and who has to stop."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import pytest
from conductor_bench import CONFIG, S, hello, submit

from conductor.core.facts import CaseEnded, Fact
from conductor.journal.owner import FILE_NAME, FolderOwner, obstacle, this_process
from conductor.journal.store import FolderLockedError, Journal, TakenOverError
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas.wire.codec import encode

HERE = FolderOwner(id="a", host="here", pid=1)
THERE = FolderOwner(id="b", host="there", pid=2)


@pytest.fixture(autouse=True)
def _short_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("conductor.journal.owner.WATCH_S", 0.3)


def _some(number: int) -> Fact:
    return CaseEnded(campaign="alpha", case=str(number), outcome="cancelled", reason="")


def test_the_file_is_called_as_ever() -> None:
    """Conductors of other versions look for it."""
    assert FILE_NAME == "conductor.owner"


@pytest.mark.parametrize(("silent_s", "refused"), [(-5.0, True), (45.0, True), (45.1, False)])
def test_silence_is_waited_for(silent_s: float, refused: bool) -> None:
    assert bool(obstacle(THERE, HERE, silent_s, 45.0)) == refused


def test_on_one_host_the_lock_decides() -> None:
    assert obstacle(msgspec.structs.replace(THERE, host="here"), HERE, 0.0, 45.0) == ""


@pytest.mark.parametrize(
    ("job", "restarts", "refused"),
    [("slurm 7", 1, False), ("slurm 7", 0, True), ("slurm 8", 1, True), ("", 1, True)],
)
def test_a_restart_of_the_same_job_need_not_wait(job: str, restarts: int, refused: bool) -> None:
    found = msgspec.structs.replace(THERE, job="slurm 7" if job else "")
    me = msgspec.structs.replace(HERE, job=job, restarts=restarts)
    assert bool(obstacle(found, me, 0.0, 45.0)) == refused


def test_the_scheduler_is_asked() -> None:
    me = this_process({"SLURM_JOB_ID": "7", "SLURM_RESTART_COUNT": "2"})
    assert (me.job, me.restarts) == ("slurm 7", 2)
    assert this_process({"PBS_JOBID": "9.head"}).job == "pbs 9.head"
    assert (this_process({}).job, this_process({}).restarts) == ("", 0)


def _open(folder: Path, owner: FolderOwner) -> Journal:
    return Journal(folder, owner=owner)


def _owner(folder: Path) -> FolderOwner:
    return msgspec.json.decode((folder / FILE_NAME).read_bytes(), type=FolderOwner)


def _age(folder: Path, seconds: float) -> None:
    then_s = time.time() - seconds
    os.utime(folder / FILE_NAME, (then_s, then_s))


def test_a_living_owner_of_another_host_is_named(tmp_path: Path) -> None:
    first = _open(tmp_path, THERE)
    with pytest.raises(FolderLockedError, match=r"\(pid 2 on there\), last heard \d+ s ago"):
        _open(tmp_path, HERE)
    first.close()
    _open(tmp_path, HERE).close()
    assert not (tmp_path / FILE_NAME).exists()


def test_a_clock_five_minutes_ahead_takes_nothing_over(tmp_path: Path) -> None:
    """To a host whose clock is ahead every heartbeat looks old, but it goes on beating."""
    first = _open(tmp_path, THERE)
    _age(tmp_path, 300.0)  # or its first heartbeat would look young, and nobody would watch
    done = threading.Event()

    def beat() -> None:
        number = 0
        while not done.wait(0.02):
            number += 1
            _age(tmp_path, 300.0 - 0.1 * number)

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        with pytest.raises(FolderLockedError, match="in use by another conductor"):
            _open(tmp_path, HERE)
    finally:
        done.set()
        thread.join()
    first.append([_some(1)])
    first.close()


def test_the_lock_of_a_dead_host_is_taken_over_and_a_ghost_stops(tmp_path: Path) -> None:
    ghost = _open(tmp_path, THERE)
    ghost.append([_some(1)])
    _age(tmp_path, 46.0)
    successor = _open(tmp_path, HERE)
    successor.append([_some(2)])
    for _ in range(2):
        with pytest.raises(TakenOverError, match=r"taken over by the conductor \(pid 1 on here"):
            ghost.append([_some(3)])
    with pytest.raises(TakenOverError):
        list(ghost.fold())
    ghost.close()
    successor.append([_some(4)])
    assert list(successor.fold()) == [_some(1), _some(2), _some(4)]
    successor.close()
    with contextlib.closing(sqlite3.connect(tmp_path / "conductor.db")) as connection:
        (owner,) = connection.execute("SELECT value FROM meta WHERE name = 'owner'").fetchone()
    assert msgspec.json.decode(owner, type=FolderOwner) == HERE


def test_a_ghost_answers_nobody(tmp_path: Path) -> None:
    ghost = ConductorEngine(_open(tmp_path, THERE), CONFIG, 0)
    ghost.turn([IncomingRequest(encode(submit()), S)])
    _age(tmp_path, 46.0)
    successor = ConductorEngine(_open(tmp_path, HERE), CONFIG, 0)
    assert successor.state.epoch == ghost.state.epoch + 1
    with pytest.raises(TakenOverError):
        ghost.turn([IncomingRequest(encode(hello()), S)])
    with pytest.raises(TakenOverError):
        ghost.turn(
            [IncomingRequest(encode(hello("w2")), S), IncomingRequest(encode(hello("w3")), S)]
        )
    assert not successor.state.workers


def test_an_idle_ghost_notices_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ghost = ConductorEngine(_open(tmp_path, THERE), CONFIG, 0)
    _age(tmp_path, 46.0)
    successor = _open(tmp_path, HERE)
    monkeypatch.setattr("conductor.journal.owner.BEAT_S", 0.0)  # as long as that ago
    with pytest.raises(TakenOverError):
        ghost.tick(S)
    successor.close()


def test_the_heartbeat_is_renewed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = _open(tmp_path, HERE)
    _age(tmp_path, 100.0)
    monkeypatch.setattr("conductor.journal.owner.BEAT_S", 0.0)
    journal.append([])
    assert time.time() - (tmp_path / FILE_NAME).stat().st_mtime < 50
    journal.close()


def test_a_crash_on_the_same_host_is_no_obstacle(tmp_path: Path) -> None:
    program = (
        "import os, signal\n"
        "from pathlib import Path\n"
        "from conductor.journal.store import Journal\n"
        "from conductor.journal.owner import FolderOwner\n"
        f"Journal(Path({str(tmp_path)!r}), owner=FolderOwner('a', 'here', 1))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", program]).returncode == -signal.SIGKILL
    assert (tmp_path / FILE_NAME).exists(), "it left no word"
    successor = _open(tmp_path, msgspec.structs.replace(HERE, id="c"))
    assert _owner(tmp_path).id == "c"
    successor.close()


def test_an_unreadable_file_is_no_owner(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("{")
    journal = _open(tmp_path, HERE)
    assert _owner(tmp_path) == HERE
    journal.close()
