"""Records what the stack of a rig sees and answers, one file per attempt; opt-in, and complete.

The simulator's loop copies; a thread of its own packs and writes. A disk that is slower than the
simulator holds it up, which changes no value; a disk that is full ends the file.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from schemas import SCHEMA_VERSION
from schemas.files.drive_record import (
    DRIVE_FILE,
    FILE_BYTES_MAX,
    RecordAnswer,
    RecordHead,
    RecordSeen,
)
from schemas.messages import Command, Episode, Lease, Result, Tick
from twin.base.channel import BoundedChannel
from twin.base.software import device_class, software_digest

if TYPE_CHECKING:
    from twin.records.drive_record import RecordWriter
    from twin.sensors.data import SensorData

WAITING_BYTES_MAX = 256 << 20
"""Most bytes of sensors that wait to be written [bytes]."""

_COMMAND_BYTES = 512
"""What a command counts for in the queue [bytes]."""


class AttemptRecord:
    """The file of one attempt; all methods but :meth:`finish` run on the recorder's thread."""

    def __init__(self, lease: Lease, post: Callable[[Callable[[], None]], None]) -> None:
        self._lease = lease
        self._post = post
        self._writer: RecordWriter | None = None
        self._cut = ""

    def open(self, slots: int, device: str) -> None:
        """Begin the file."""
        from twin.records.drive_record import RecordWriter

        lease = self._lease
        folder = Path(lease.out) / "cases" / lease.case.id / f"attempt-{lease.attempt}"
        head = RecordHead(
            v=SCHEMA_VERSION,
            attempt=lease.attempt,
            software=software_digest(),
            device_class=device_class(device),
            slots=slots,
            case=lease.case,
        )
        try:
            self._writer = RecordWriter(folder / DRIVE_FILE, head)
        except OSError as error:
            self._lose(error)

    def seen(self, tick: int, sim_time_ns: int, arrays: _Arrays, episode: Episode | None) -> None:
        """What was published for one tick."""
        from twin.records.drive_record import coded

        if self._writer is not None and self._writer.size > FILE_BYTES_MAX:
            self._cut = f"at most {FILE_BYTES_MAX >> 20} MB are recorded"
        if self._writer is None or self._cut:
            return
        sensors = {name: coded(values, count) for name, (values, count) in arrays.items()}
        try:
            self._writer.write(RecordSeen(tick, sim_time_ns, sensors, episode))
        except OSError as error:
            self._lose(error)

    def answered(self, command: Command) -> None:
        """What the stack answered to it."""
        if self._writer is None or self._cut:
            return
        try:
            self._writer.write(RecordAnswer(command))
        except OSError as error:
            self._lose(error)

    def abandon(self) -> None:
        """The attempt ends without a result: the file stays, without an end."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def finish(self, result: Result) -> None:
        """The attempt has a result: complete the file, or remove it; on the results' thread."""
        done = threading.Event()

        def end() -> None:
            try:
                self._end(result)
            finally:
                done.set()

        self._post(end)
        done.wait()

    def _end(self, result: Result) -> None:
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.end(result.outcome, result.verdict, self._cut)
            if self._lease.case.drive == "failed" and result.verdict == "pass":
                writer.path.unlink()
        except OSError as error:
            self._writer = writer
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        """The record ends here, the attempt goes on."""
        case = self._lease.case.id
        print(f"record of {case}: {error.strerror}; it ends here", file=sys.stderr, flush=True)
        self.abandon()


_Arrays = dict[str, tuple[np.ndarray, int]]
"""Sensor -> one slot's values, and how many rows of them are valid (-1: all)."""


class DriveRecorder:
    """The records of a rig's slots; attempts whose case asks for none cost nothing."""

    def __init__(self, slots: int, device: str) -> None:
        """
        Args:
            slots: of the rig.
            device: where it computes.
        """
        self._records: dict[int, AttemptRecord] = {}
        self._slots, self._device = slots, device
        self._jobs: BoundedChannel[Callable[[], None]] | None = None
        """Of the thread, once there is something to record."""

    # --- the simulator's loop ---------------------------------------------------------------

    def begin(self, slot: int, lease: Lease) -> None:
        """A case begins in ``slot``."""
        if lease.case.drive == "none":
            return
        if self._jobs is None:
            self._jobs = BoundedChannel(WAITING_BYTES_MAX)
            threading.Thread(target=_work, args=[self._jobs], name="record", daemon=True).start()
        jobs = self._jobs
        record = self._records[slot] = AttemptRecord(lease, lambda job: jobs.put(job, 0))
        jobs.put(lambda: record.open(self._slots, self._device), 0)

    def seen(self, tick: Tick, sensed: dict[str, SensorData], episodes: list[Episode]) -> None:
        """A tick was sensed; before the stack is asked, so that one that dies leaves it behind."""
        for slot, record in self._records.items():
            if not tick.active[slot]:
                continue  # it stands still
            arrays: _Arrays = {}
            for name, data in sensed.items():
                count = -1 if data.count is None else int(data.count[slot])
                arrays[name] = np.array(data.values[slot]), count
            fresh = next((episode for episode in episodes if episode.slot == slot), None)
            self._put_seen(record, tick.tick[slot], tick.sim_time_ns[slot], arrays, fresh)

    def _put_seen(
        self,
        record: AttemptRecord,
        tick: int,
        time_ns: int,
        arrays: _Arrays,
        fresh: Episode | None,
    ) -> None:
        assert self._jobs is not None
        episode = None if fresh is None else structs.replace(fresh, slot=0)
        size = sum(values.nbytes for values, _ in arrays.values())
        self._jobs.put(lambda: record.seen(tick, time_ns, arrays, episode), size)

    def answered(self, commands: list[Command | None]) -> None:
        """The commands of all slots came."""
        for slot, record in self._records.items():
            command = commands[slot]
            if command is not None:
                self._put_answer(record, command)

    def _put_answer(self, record: AttemptRecord, command: Command) -> None:
        assert self._jobs is not None
        self._jobs.put(lambda: record.answered(command), _COMMAND_BYTES)

    def end(self, slot: int) -> AttemptRecord | None:
        """The attempt in ``slot`` has ended; its record is to be finished with the result."""
        return self._records.pop(slot, None)

    def abandon(self, slot: int) -> None:
        """The attempt in ``slot`` is no longer wanted."""
        record = self._records.pop(slot, None)
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
