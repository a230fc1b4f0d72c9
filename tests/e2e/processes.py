"""Real processes of a test: started with a mark, found again by it, and never left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import psutil
from waiting import PATIENCE_S, wait_for

from twin.fabric.keys.own_keys import fabric_folder, fabric_name

MARK = "LC_TWIN_TEST_MARK"
"""Variables of this beginning pass into the sandboxes of stacks."""


END_S = 3 * PATIENCE_S
"""Longest time a child may take to its end; less than a whole test may [s]."""


class Child(subprocess.Popen[str]):
    """One that says where it stands if it does not end."""

    def communicate(
        self,
        input: str | None = None,  # noqa: A002
        timeout: float | None = None,
    ) -> tuple[str, str]:
        try:
            return super().communicate(input, timeout or END_S)
        except subprocess.TimeoutExpired:
            self.send_signal(signal.SIGABRT)
            out, err = super().communicate()
            raise AssertionError(f"{self.args} did not end\n{out}\n{err}") from None


class Marked:
    """Everything started through it, and what that started, carries one mark."""

    def __init__(self) -> None:
        self.mark = uuid.uuid4().hex
        self.temporary = Path(tempfile.mkdtemp(prefix="marked-"))
        """Their folder for temporary files; nothing may stay in it."""
        self.children: list[Child] = []

    def start(
        self,
        *arguments: str,
        prefix: tuple[str, ...] = (),
        folder: Path | None = None,
        log: IO[str] | None = None,
    ) -> Child:
        """Start ``python -m ARGUMENTS`` in the background, in ``folder``.

        What it says goes to ``log``, or into pipes: for children that say little, or are read.
        """
        child = Child(
            [*prefix, sys.executable, "-m", *arguments],
            stdout=log or subprocess.PIPE,
            stderr=log or subprocess.PIPE,
            text=True,
            env={
                **os.environ,
                MARK: self.mark,
                "TMPDIR": str(self.temporary),
                "PYTHONFAULTHANDLER": "1",
            },
            start_new_session=True,
            cwd=folder,
        )
        self.children.append(child)
        return child

    def run(self, *arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run ``python -m ARGUMENTS`` to its end."""
        child = self.start(*arguments, folder=folder)
        out, err = child.communicate(timeout=PATIENCE_S)
        return subprocess.CompletedProcess(arguments, child.returncode, out, err)

    def processes(self, *words: str) -> list[psutil.Process]:
        """Live processes with our mark whose command line holds all ``words``; a sandbox around
        one of them is none."""
        mark, found = f"{MARK}={self.mark}".encode(), []
        for pid in psutil.pids():
            try:
                # Tests ask all the time, so nothing is asked of strangers but this.
                try:
                    marks = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
                except PermissionError:  # a worker keeps its own from its user; root sees it
                    marks = _ancestors_marks(pid)
                if mark not in marks:
                    continue
                process = psutil.Process(pid)
                line = process.cmdline()
                if words and process.name() in ("bwrap", "sh") and "bwrap" in line:
                    continue
            except (OSError, psutil.Error):
                continue
            if all(word in line for word in words):
                found.append(process)
        return found

    def one(self, *words: str) -> psutil.Process:
        """Wait for a live process with these words and return it."""
        return wait_for(lambda: next(iter(self.processes(*words)), None), f"a process {words}")

    def end(self) -> None:
        """Kill whatever is left and reap it."""
        shutil.rmtree(self.temporary, ignore_errors=True)
        for process in self.processes():
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue
        for child in self.children:
            if child.poll() is None:
                child.kill()
            child.wait()
            for stream in (child.stdout, child.stderr):
                if stream is not None:
                    stream.close()


def keys_of(state: Path) -> Path:
    """The folder of keys that a conductor of this state folder makes."""
    return fabric_folder(fabric_name(state))


def _ancestors_marks(pid: int) -> list[bytes]:
    """Environment of the nearest ancestor of one of our processes that shows it."""
    process = psutil.Process(pid)
    if process.uids().real != os.getuid():
        return []
    for parent in process.parents():
        try:
            return Path(f"/proc/{parent.pid}/environ").read_bytes().split(b"\0")
        except PermissionError:
            continue
    return []


def committed(folder: Path) -> int:
    """Attempt folders with KPIs: cases that got at least that far."""
    return len(list(folder.glob("cases/*/attempt-*/kpi.parquet")))


def complete(folder: Path) -> bool:
    """Every case has an outcome, as the conductor's file says."""
    try:
        return bool(json.loads((folder / "outcomes.json").read_text())["complete"])
    except FileNotFoundError:
        return False


def outcomes(folder: Path) -> dict[str, dict[str, object]]:
    """Cases of a finished campaign."""
    cases: dict[str, dict[str, object]] = json.loads((folder / "outcomes.json").read_text())[
        "cases"
    ]
    return cases


def _shared() -> set[str]:
    """Shared memory under names that a careless session leaves behind."""
    return {name for name in os.listdir("/dev/shm") if "twin" in name or "zenoh" in name}


@contextmanager
def nothing_left(marked: Marked) -> Iterator[None]:
    """Fail if processes, shared memory or temporary files outlive the block."""
    before = _shared()
    yield
    wait_for(lambda: not marked.processes(), "the end of every process")
    left = [str(path) for path in marked.temporary.rglob("*")]
    assert not left, left  # the list is what a log shows
    # Others on this machine may share memory as well, for a while.
    wait_for(lambda: _shared() <= before, f"the end of {_shared() - before} in /dev/shm")


def recorded_run(campaign: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Run a campaign with one worker, recorded in every way."""
    starter = Marked()
    try:
        with nothing_left(starter):
            done = starter.run(
                *("conductor", "run", str(campaign), "--workers", "1", "--out", str(out)),
                *("--view", "record", "--record-drive"),
            )
    finally:
        starter.end()
    assert done.returncode in (0, 1), done.stderr
    return done


@contextmanager
def suspended(processes: Sequence[psutil.Process]) -> Iterator[None]:
    """Processes stand still during the block; those that end meanwhile are left alone."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.suspend()
    try:
        yield
    finally:
        for process in processes:
            with suppress(psutil.NoSuchProcess):
                process.resume()


def has_line_to(pid: int, endpoint: str) -> bool:
    """Whether a process has a connection to an endpoint: a viewer that has sees what comes."""
    port = int(endpoint.rpartition(":")[2])
    lines = psutil.Process(pid).net_connections("tcp")
    return any(line.raddr and line.raddr.port == port for line in lines)


def interrupt(process: subprocess.Popen[str]) -> None:
    """Ctrl-C."""
    process.send_signal(signal.SIGINT)


def catches(pid: int, number: int) -> bool:
    """Whether the process has a handler for the signal; Python has none of SIGTERM by itself."""
    status = Path(f"/proc/{pid}/status").read_text()
    (mask,) = [line.split()[1] for line in status.splitlines() if line.startswith("SigCgt")]
    return bool(int(mask, 16) & 1 << (number - 1))
