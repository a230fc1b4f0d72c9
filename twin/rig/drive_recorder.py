"""Records what the stack of a rig sees and answers, one file per attempt; opt-in, and complete.

The simulator's loop copies; a thread of its own packs and writes. A disk that is slower than the
simulator holds it up, which changes no value; a disk that is full ends the file.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable

import numpy as np
from msgspec import structs

from schemas.messages import Command, Episode
from twin.base.channel import BoundedChannel
from twin.rig.attempt_record import Arrays, AttemptRecord
from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.rig.slot_listener import SlotListener
from twin.sensors.wanted import NOTHING, Wanted

WAITING_BYTES_MAX = 256 << 20
"""Most bytes of sensors that wait to be written [bytes]."""

_COMMAND_BYTES = 512
"""What a command counts for in the queue [bytes]."""


class DriveRecorder(SlotListener):
    """The records of a rig's slots; attempts whose case asks for none cost nothing."""

    def __init__(self, slots: int, device: str) -> None:
        """Begin without records.

        Args:
            slots: of the rig.
            device: where it computes.
        """
        self._records: dict[int, AttemptRecord] = {}
        self._slots, self._device = slots, device
        self._jobs: BoundedChannel[Callable[[], None]] | None = None
        """Jobs of the thread, once there is something to record."""

    # --- the simulator's loop ---------------------------------------------------------------

    def started(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        if slot.lease.case.variation.drive == "none":
            return
        if self._jobs is None:
            self._jobs = BoundedChannel(WAITING_BYTES_MAX)
            threading.Thread(target=_work, args=[self._jobs], name="record", daemon=True).start()
        jobs = self._jobs
        record = AttemptRecord(slot.lease, lambda job: jobs.put(job, 0))
        self._records[slot.index] = record
        jobs.put(lambda: record.open(self._slots, self._device), 0)

    def wanted(self) -> Wanted:
        """See :class:`SlotListener`: a record has everything, for stacks that look at more."""
        return None if self._records else NOTHING

    def sensed(self, tick: RigTick) -> None:
        """See :class:`SlotListener`; before the stack is asked, so that one that dies leaves it
        behind."""
        message = tick.message
        for slot, record in self._records.items():
            if not message.active[slot]:
                continue  # it stands still
            arrays: Arrays = {}
            for name, data in tick.told.items():
                count = -1 if data.count is None else int(data.count[slot])
                arrays[name] = np.array(data.values[slot]), count
            fresh = next((episode for episode in tick.episodes if episode.slot == slot), None)
            self._put_seen(record, message.tick[slot], message.sim_time_ns[slot], arrays, fresh)

    def _put_seen(
        self,
        record: AttemptRecord,
        tick: int,
        time_ns: int,
        arrays: Arrays,
        fresh: Episode | None,
    ) -> None:
        assert self._jobs is not None
        episode = None if fresh is None else structs.replace(fresh, slot=0)
        size = sum(values.nbytes for values, _ in arrays.values())
        self._jobs.put(lambda: record.seen(tick, time_ns, arrays, episode), size)

    def commanded(self, tick: RigTick) -> None:
        """See :class:`SlotListener`."""
        for slot, record in self._records.items():
            command = tick.answered[slot]
            if command is not None:
                self._put_answer(record, command)

    def _put_answer(self, record: AttemptRecord, command: Command) -> None:
        assert self._jobs is not None
        self._jobs.put(lambda: record.answered(command), _COMMAND_BYTES)

    def ended(self, slot: Slot, end: SlotEnd) -> None:
        """See :class:`SlotListener`."""
        end.record = self._records.pop(slot.index, None)

    def withdrawn(self, slot: Slot) -> None:
        """See :class:`SlotListener`."""
        record = self._records.pop(slot.index, None)
        if record is not None and self._jobs is not None:
            self._jobs.put(record.abandon, 0)

    # --- any thread -------------------------------------------------------------------------

    def drain(self, timeout_s: float) -> None:
        """Wait until all that was seen is written, for at most ``timeout_s``."""
        if self._jobs is not None:
            done = threading.Event()
            self._jobs.put(done.set, 0)
            done.wait(timeout_s)


def _work(jobs: BoundedChannel[Callable[[], None]]) -> None:
    while (job := jobs.take()) is not None:
        try:
            job()
        except Exception as error:  # who waits for the next job must not wait for ever
            print(f"record: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
