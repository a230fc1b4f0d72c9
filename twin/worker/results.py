"""Finished cases become attempt folders on a thread of their own, while the others go on."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec import structs

from schemas.messages import Lease, PerceptionCost, Result

if TYPE_CHECKING:
    from twin.engine import Finished

WAITING_MAX = 4096
"""Most results that wait for the disk; beyond it the simulator waits, too."""


@dataclass(frozen=True, slots=True)
class Ended:
    """A case that has ended, and what it took."""

    lease: Lease
    finished: Finished
    started_s: float
    """When its slot took it, monotonic [s]."""
    perception: PerceptionCost | None
    rig_wall_s: float


class ResultWriter:
    """Writes attempts in the order in which they ended, and tells of each when it is complete."""

    def __init__(self, tell: Callable[[Result], None]) -> None:
        self._tell = tell
        self._waiting: queue.Queue[Ended] = queue.Queue(WAITING_MAX)
        self._error: Exception | None = None
        threading.Thread(target=self._run, name="results", daemon=True).start()

    def put(self, ended: Ended) -> None:
        """Hand over a case.

        Raises:
            Exception: what kept an earlier one from being written (disk full, no permission).
        """
        self.check()
        self._waiting.put(ended)

    def check(self) -> None:
        """Raise what kept a case from being written, on the caller's thread."""
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            ended = self._waiting.get()
            if self._error is not None:
                continue  # the process is about to end; nobody waits for these
            try:
                self._tell(_written(ended))
            except Exception as error:
                self._error = error


def _written(ended: Ended) -> Result:
    # Late: this module imports Parquet only after the engine is warm.
    from twin.worker.attempt import write_attempt

    wall_s = time.monotonic() - ended.started_s
    result = write_attempt(ended.lease, ended.finished, wall_s)
    return structs.replace(result, perception=ended.perception, rig_wall_s=ended.rig_wall_s)
