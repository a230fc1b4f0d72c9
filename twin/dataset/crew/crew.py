"""Several processes render one dataset: this one hands out tasks and counts what is done.

No byte depends on who renders what: an image follows from the recipe and its number. A child that
fails ends them all; what is written stays, and the same command goes on from there.
"""

from __future__ import annotations

import contextlib
import selectors
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from twin.base.errors import InfrastructureError, UsageError
from twin.base.process import end, how_it_ended, last_lines, spawn
from twin.dataset.crew.messages import Begin, ChildReady, ChildWork, Trouble, line_of, read_answer
from twin.dataset.crew.task import Agenda

_READ_BYTES = 65536
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Each process has one core."""


@dataclass(slots=True)
class _Child:
    """One process."""

    number: int
    process: subprocess.Popen[bytes]
    log: IO[bytes]
    """Unnamed: gone with its last user."""
    rest: bytes = b""
    """The beginning of a line."""
    free: bool = False
    """Whether it was told that nothing is left."""

    def tell(self, *lines: bytes) -> None:
        """What a dead child is told is lost; that it is dead shows in what it says."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(b"".join(lines))


def render_together(begin: Begin, agenda: Agenda, jobs: int) -> Iterator[int]:
    """Render everything on ``agenda`` in ``jobs`` processes; yields the number of each image.

    None of them is left when this ends, however it ends. Call it from the main thread.

    Raises:
        UsageError: scene, lens or number of slots cannot be used; one line.
        InfrastructureError: a process died; one line.
    """
    with contextlib.ExitStack() as open_logs, selectors.DefaultSelector() as selector:
        children: list[_Child] = []
        try:
            for number in range(jobs):
                log = open_logs.enter_context(tempfile.TemporaryFile())
                child = _start(number, log, begin)
                children.append(child)
                selector.register(child.process.stdout, selectors.EVENT_READ, child)  # type: ignore[arg-type]
            while not all(child.free for child in children):
                for key, _ in selector.select():
                    yield from _hear(key.data, agenda)
        finally:
            for child in children:
                child.process.terminate()
            for child in children:
                end(child.process)


def _start(number: int, log: IO[bytes], begin: Begin) -> _Child:
    command = [sys.executable, "-m", "twin.dataset.crew.child"]
    process = spawn(command, environment=_ONE_THREAD, log=log, pipe_output=True)
    child = _Child(number, process, log)
    child.tell(line_of(begin))
    return child


def _hear(child: _Child, agenda: Agenda) -> Iterator[int]:
    """Read what a child says, and answer it."""
    assert child.process.stdout is not None
    data = child.process.stdout.read(_READ_BYTES)
    if not data:
        raise _death(child)
    *lines, child.rest = (child.rest + data).split(b"\n")
    for line in lines:
        answer = read_answer(line)
        if isinstance(answer, Trouble):
            raise (UsageError if answer.usage else InfrastructureError)(answer.text)
        if not isinstance(answer, ChildReady):
            yield answer.index
            continue
        task = agenda.take(child.number)
        child.free = task is None
        if task is not None:
            child.tell(line_of(ChildWork(task)))


def _death(child: _Child) -> InfrastructureError:
    code = child.process.wait()
    said = last_lines(child.log)
    tail = f"; it said: {said}" if said else ""
    return InfrastructureError(
        f"dataset: a process that renders ended ({how_it_ended(code)}); run the same command again "
        f"to go on, with fewer --jobs or --slots if memory was short{tail}"
    )
