"""Finished cases become attempt folders on a thread of their own, while the others go on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from msgspec import structs

from schemas.wire.control import Result
from twin.rig.slot import Slot, SlotEnd
from twin.rig.slot_listener import SlotListener
from twin.rig.stack_output import StackOutput

WAITING_MAX = 4096
"""Most results that wait for the disk; beyond it the simulator waits, too."""


class OutputListener(SlotListener):
    """Cuts what the stack printed into attempts."""

    def __init__(self, output: StackOutput) -> None:
        self._output = output

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        self._output.begin(slot.lease.token, slot.lease.case.id)

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`."""
        end.output = self._output.end(slot.lease.token)

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        self._output.forget(slot.lease.token)


class ResultWriter(SlotListener):
    """Writes attempts in the order in which they ended, and tells of each when it is complete."""

    def __init__(self, tell: Callable[[SlotEnd, Result], None]) -> None:
        self._tell = tell
        self._waiting: queue.Queue[tuple[Slot, SlotEnd]] = queue.Queue(WAITING_MAX)
        self._tokens: list[int] = []
        self._settled = threading.Condition()
        """Notified when there are fewer tokens."""
        self._error: Exception | None = None
        threading.Thread(target=self._run, name="results", daemon=True).start()

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """Take over an attempt, to which nothing is added any more.

        Raises:
            Exception: what kept an earlier one from being written (disk full, no permission).
        """
        self.check()
        with self._settled:
            self._tokens.append(slot.lease.token)
        self._waiting.put((slot, end))

    @property
    def tokens(self) -> list[int]:
        """Tokens of the cases whose attempts are not complete yet."""
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
            slot, end = self._waiting.get()
            if self._error is None:  # or the process is about to end
                try:
                    self._tell(end, _written(slot, end))
                except Exception as error:
                    self._error = error
            with self._settled:
                self._tokens.remove(slot.lease.token)
                self._settled.notify_all()


def _written(slot: Slot, end: SlotEnd) -> Result:
    # Late: this module imports Parquet only after the engine is warm.
    from twin.rig.attempt import write_attempt, write_pace

    result = write_attempt(slot.lease, end.finished, end.wall_s, end.output)
    if end.journal is not None:
        end.journal.end(result, len(end.finished.table.columns["tick"].values))
    if end.record is not None:
        end.record.finish(result)
    result = structs.replace(result, perception=slot.perception, rig_wall_s=slot.rig_wall_s)
    if end.paced is None:
        return result
    write_pace(slot.lease, end.paced)
    return structs.replace(result, realtime=end.paced.summary)
