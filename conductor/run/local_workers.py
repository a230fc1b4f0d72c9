"""The local workers of ``conductor run``: started, replaced when they die, stopped together.

A worker may be started before the conductor listens, so that it loads meanwhile; in any case it is
told on its standard input whom to serve.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import msgspec

from conductor.run.places import WorkerPlace
from twin.base.gpu.first_use import PLACE_VARIABLE
from twin.base.gpu.slot_count import MemoryCount
from twin.base.process import end, how_it_ended, last_lines, spawn
from twin.base.worker_start import LOCAL_WORKER, LocalWorker, WorkerStart

STOP_S = 12.0
"""How long workers may take to give their leases back and finish recordings [s]."""


@dataclass(slots=True)
class WorkerChild:
    """One worker process and its log."""

    place: int
    """Index of its place."""
    number: int
    process: subprocess.Popen[bytes]
    log: IO[bytes]
    handover: socket.socket
    """Where it is handed the conductor's socket; closed once it is told whom to serve."""
    told: int = 0
    """Bytes of the log that were looked at."""


@dataclass(slots=True)
class LocalWorkers:
    """Worker processes of one run."""

    worker: LocalWorker
    """Each of them, without its place."""
    folder: Path
    """Campaign folder; what workers say goes to its ``logs``."""
    places: Sequence[WorkerPlace]
    """Where each of them computes; one that died is replaced at its place."""
    memory: MemoryCount | None = None
    """How many slots they may have, where that is to be counted."""
    told: WorkerStart | None = None
    """Start message of the conductor that they serve; None: it is not known yet. The log is each
    worker's own."""
    handed: int | None = None
    """Descriptor of the socket by which they join; None: they take the endpoint."""
    children: list[WorkerChild] = field(default_factory=list)
    started: int = 0
    died: int = 0
    """Workers that died since a case ended; the caller sets it back."""

    @property
    def slots(self) -> int:
        """Slots of each; 0: they were told of none."""
        return self.told.slots if self.told is not None and self.places else 0

    @property
    def count(self) -> int:
        """Number of workers that there should be."""
        return len(self.places)

    def start(self) -> None:
        """Start as many as are missing, always from the same thread, which outlives them (see
        ``spawn``)."""
        taken = {child.place for child in self.children}
        for index in sorted(set(range(self.count)) - taken):
            self.started += 1
            # Until it is told it has no log on disk, and nothing to say.
            log = tempfile.TemporaryFile()  # noqa: SIM115
            ours, theirs = socket.socketpair()
            with theirs:
                worker = self.places[index].placed(self.worker)
                worker = msgspec.structs.replace(worker, handover=theirs.fileno())
                text = msgspec.json.encode(worker).decode()
                process = spawn(
                    [sys.executable, "-m", "twin", *LOCAL_WORKER, text],
                    environment={PLACE_VARIABLE: str(index)},
                    log=log,
                    descriptors=[theirs.fileno()],
                )
            self.children.append(WorkerChild(index, self.started, process, log, ours))
            self._tell(self.children[-1])

    def serve(
        self, told: WorkerStart, places: Sequence[WorkerPlace], handed: int | None = None
    ) -> None:
        """The conductor listens: tell those that run, and end those that have no place any more.

        ``handed``: descriptor of its socket for them, which stays open; None: it has none.
        """
        self.told, self.places, self.handed = told, places, handed
        surplus = [child for child in self.children if child.place >= len(places)]
        self.children = [child for child in self.children if child.place < len(places)]
        _end(surplus)
        for child in self.children:
            self._tell(child)

    def _tell(self, child: WorkerChild) -> None:
        if self.told is None or child.process.poll() is not None:
            return  # what it said last stays where it is
        path = self.folder / "logs" / f"worker-{child.number}.log"
        child.log.close()
        child.log = path.open("w+b")
        share = self.places[child.place].share
        handed = self.handed is not None
        start = msgspec.structs.replace(self.told, log=str(path), share=share, handed=handed)
        assert child.process.stdin is not None
        with contextlib.suppress(ConnectionError), child.handover:  # it dies just now: replaced
            if self.handed is not None:
                socket.send_fds(child.handover, [b"\n"], [self.handed])
            child.process.stdin.write(msgspec.json.encode(start) + b"\n")

    def look(self) -> list[str]:
        """Reap the dead and read the logs: one line per death of a worker or of its rig."""
        lines = []
        for child in list(self.children):
            lines += self._rig_deaths(child)
            code = child.process.poll()
            if code is None:
                continue
            self.children.remove(child)
            self.died += 1
            tail = last_lines(child.log, 1)
            end(child.process)
            child.log.close()
            child.handover.close()
            reason = f"{how_it_ended(code)}, replaced" + (
                f"; its last words: {tail}" if tail else ""
            )
            lines.append(f"worker {child.number} {reason}")
        return lines

    def _rig_deaths(self, child: WorkerChild) -> list[str]:
        """Whole lines that came since the last look and tell of a rig that died, or waits."""
        text = os.pread(child.log.fileno(), 1 << 20, child.told)
        text = text[: text.rfind(b"\n") + 1]
        child.told += len(text)
        return [
            f"worker {child.number}: {line}"
            for line in text.decode("utf-8", "replace").splitlines()
            if line.startswith(("rig ended", "waits for port"))
        ]

    def ask(self) -> None:
        """Ask all to end, and wait for none."""
        _ask(self.children)

    def stop(self) -> None:
        """Ask all at once, then wait for each; they give their leases back."""
        _end(self.children)
        self.children = []
        if self.memory is not None:
            self.memory.discard()


def _ask(children: Sequence[WorkerChild]) -> None:
    for child in children:
        with contextlib.suppress(ProcessLookupError):
            child.process.terminate()


def _end(children: Sequence[WorkerChild]) -> None:
    _ask(children)
    for child in children:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.process.wait(STOP_S)
        end(child.process)
        child.log.close()
        child.handover.close()
