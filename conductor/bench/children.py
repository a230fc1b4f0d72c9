"""Processes of the bench: started, waited for, and ended with it."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from twin.base.errors import InfrastructureError, TwinError
from twin.base.process import end, how_it_ended, last_lines, spawn
from twin.fabric.discovery import find_conductor
from twin.fabric.handshake import greet

START_S = 30.0
"""Longest wait for a process of ours to be ready [s]."""
JUDGING_S = 600.0
"""Longest wait for a conductor that still judges [s]."""


class BenchChild:
    """A Python module in a process of its own; its log is shown when it fails."""

    def __init__(self, *arguments: str) -> None:
        self._name = " ".join(arguments[:2])
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        self.process: subprocess.Popen[bytes] = spawn(
            [sys.executable, "-m", *arguments], log=self._log, pipe_output=True
        )

    def line(self) -> str:
        """The next line of its standard output.

        Raises:
            InfrastructureError: it ended instead, with its last words.
        """
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            raise InfrastructureError(
                f"{self._name}: {how_it_ended(code)}: {last_lines(self._log, 5)}"
            )
        return line.decode().rstrip("\n")

    def tell(self, line: str) -> None:
        """Write a line to its standard input."""
        assert self.process.stdin is not None
        self.process.stdin.write(line.encode() + b"\n")

    def finish(self, patience_s: float) -> None:
        """Ask the process to end in good order, and wait.

        Raises:
            InfrastructureError: it did not.
        """
        self.process.terminate()
        try:
            code = self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            raise InfrastructureError(f"{self._name}: no end in {patience_s:g} s") from None
        if code:
            words = last_lines(self._log, 5)
            raise InfrastructureError(f"{self._name}: {how_it_ended(code)}: {words}")

    def stop(self) -> None:
        """End the process and its log."""
        end(self.process, grace_s=10.0)
        self._log.close()


@contextlib.contextmanager
def child(*arguments: str) -> Iterator[BenchChild]:
    """A :class:`BenchChild` for the block."""
    made = BenchChild(*arguments)
    try:
        yield made
    finally:
        made.stop()


@contextlib.contextmanager
def serving(
    folder: Path, *store: str, judged: bool = False, start_s: float = START_S
) -> Iterator[tuple[str, int]]:
    """A conductor on ``folder``; yields its endpoint and process id.

    Args:
        folder: state folder.
        store: URL of a result store and what replies wait for, ``local`` or ``store``; or nothing.
        judged: it ends when its judge has read all attempts.
        start_s: longest wait for it [s].
    """
    with child("conductor.bench.server", str(folder), *store) as server:
        yield _await(folder, server, start_s), server.process.pid
        if judged:
            server.finish(JUDGING_S)


def _await(folder: Path, server: BenchChild, start_s: float) -> str:
    until_s = time.monotonic() + start_s
    while time.monotonic() < until_s:
        try:
            conductor = find_conductor(folder)
            if conductor.pid == server.process.pid:
                greet(conductor.endpoint, None)
                return conductor.endpoint
        except TwinError:
            pass
        if server.process.poll() is not None:
            server.line()
        time.sleep(0.01)
    raise InfrastructureError(f"{folder}: the conductor did not start in {start_s:g} s")
