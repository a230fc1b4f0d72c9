"""The local workers of ``conductor run``: started, replaced when they die, stopped together."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from conductor.places import Place
from twin.fabric.process import end, how_it_ended, last_lines, spawn

STOP_S = 12.0
"""How long workers may take to give their leases back and finish recordings [s]."""


@dataclass(slots=True)
class Child:
    """One worker process and its log."""

    place: int
    """Which of the places it has."""
    number: int
    process: subprocess.Popen[bytes]
    log: IO[bytes]
    told: int = 0
    """Bytes of the log that were looked at."""


@dataclass(slots=True)
class LocalWorkers:
    """Worker processes of one run."""

    options: Sequence[str]
    """Options of ``twin worker`` that all have."""
    folder: Path
    """Campaign folder; what workers say goes to its ``logs``."""
    places: Sequence[Place]
    """Where each of them computes; one that died is replaced at its place."""
    children: list[Child] = field(default_factory=list)
    started: int = 0
    died: int = 0
    """Workers that died since a case ended; the caller sets it back."""

    @property
    def count(self) -> int:
        """How many there should be."""
        return len(self.places)

    def start(self) -> None:
        """Start as many as are missing. Only from the main thread (see ``spawn``)."""
        taken = {child.place for child in self.children}
        for index in sorted(set(range(self.count)) - taken):
            self.started += 1
            log = (self.folder / "logs" / f"worker-{self.started}.log").open("w+b")
            options = (*self.options, *self.places[index].options())
            process = spawn([sys.executable, "-m", "twin", "worker", *options], log=log)
            self.children.append(Child(index, self.started, process, log))

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
            reason = f"{how_it_ended(code)}, replaced" + (
                f"; its last words: {tail}" if tail else ""
            )
            lines.append(f"worker {child.number} {reason}")
        return lines

    def _rig_deaths(self, child: Child) -> list[str]:
        """Whole lines that came since the last look and tell of a rig that died."""
        text = os.pread(child.log.fileno(), 1 << 20, child.told)
        text = text[: text.rfind(b"\n") + 1]
        child.told += len(text)
        return [
            f"worker {child.number}: {line}"
            for line in text.decode("utf-8", "replace").splitlines()
            if line.startswith("rig ended")
        ]

    def ask(self) -> None:
        """Ask all to end, and wait for none."""
        for child in self.children:
            with contextlib.suppress(ProcessLookupError):
                child.process.terminate()

    def stop(self) -> None:
        """Ask all at once, then wait for each; they give their leases back."""
        self.ask()
        for child in self.children:
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.process.wait(STOP_S)
            end(child.process)
            child.log.close()
        self.children.clear()
