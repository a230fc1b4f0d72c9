"""Finished cases become attempt folders on a thread of their own, while the others go on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec import structs

from schemas.messages import Lease, PerceptionCost, Result

if TYPE_CHECKING:
    from twin.rig.drive_recorder import AttemptRecord
    from twin.rig.engine import Finished
    from twin.rig.interventions.journal import SteeringJournal
    from twin.rig.realtime import Paced
    from twin.rig.stack_output import Kept

WAITING_MAX = 4096
"""Most results that wait for the disk; beyond it the simulator waits, too."""


@dataclass(frozen=True, slots=True)
class EndedCase:
    """A case that has ended, and what it took."""

    lease: Lease
    finished: Finished
    wall_s: float
    """From when its slot took it to its end [s]."""
    perception: PerceptionCost | None
    rig_wall_s: float
    changes: int = 0
    """That a hand has made; if any, it is no result of the case."""
    journal: SteeringJournal | None = None
    """Of these."""
    paced: Paced | None = None
    """How it went by the wall clock; None: in lockstep."""
    record: AttemptRecord | None = None
    """Of what the stack saw."""
    output: Kept | None = None
    """What the stack printed; None: that is on another host."""


class ResultWriter:
    """Writes attempts in the order in which they ended, and tells of each when it is complete."""

    def __init__(self, tell: Callable[[EndedCase, Result], None]) -> None:
        self._tell = tell
        self._waiting: queue.Queue[EndedCase] = queue.Queue(WAITING_MAX)
        self._tokens: list[int] = []
        self._settled = threading.Condition()
        """Notified when there are fewer tokens."""
        self._error: Exception | None = None
        threading.Thread(target=self._run, name="results", daemon=True).start()

    def put(self, ended: EndedCase) -> None:
        """Hand over a case.

        Raises:
            Exception: what kept an earlier one from being written (disk full, no permission).
        """
        self.check()
        with self._settled:
            self._tokens.append(ended.lease.token)
        self._waiting.put(ended)

    @property
    def tokens(self) -> list[int]:
        """Of the cases whose attempts are not complete yet."""
        with self._settled:
            return list(self._tokens)

    def drain(self, timeout_s: float) -> bool:
        """Wait until all that was handed over is told or has failed; False: it took too long."""
        with self._settled:
            return self._settled.wait_for(lambda: not self._tokens, timeout_s)

    def check(self) -> None:
        """Raise what kept a case from being written, on the caller's thread."""
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            ended = self._waiting.get()
            if self._error is None:  # or the process is about to end
                try:
                    self._tell(ended, _written(ended))
                except Exception as error:
                    self._error = error
            with self._settled:
                self._tokens.remove(ended.lease.token)
                self._settled.notify_all()


def _written(ended: EndedCase) -> Result:
    # Late: this module imports Parquet only after the engine is warm.
    from twin.rig.attempt import write_attempt, write_pace

    result = write_attempt(ended.lease, ended.finished, ended.wall_s, ended.output)
    if ended.journal is not None:
        ended.journal.end(result, len(ended.finished.table.columns["tick"].values))
    if ended.record is not None:
        ended.record.finish(result)
    result = structs.replace(result, perception=ended.perception, rig_wall_s=ended.rig_wall_s)
    if ended.paced is None:
        return result
    write_pace(ended.lease, ended.paced)
    return structs.replace(result, realtime=ended.paced.summary)
