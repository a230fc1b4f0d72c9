"""Drive record of one attempt: what its stack saw and answered."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schemas import SCHEMA_VERSION
from schemas.files.drive_record import (
    DRIVE_FILE,
    FILE_BYTES_MAX,
    RecordAnswer,
    RecordHead,
    RecordSeen,
)
from schemas.messages import Command, Episode
from schemas.wire.control import Lease, Result
from twin.base.software import device_class, software_digest

if TYPE_CHECKING:
    from twin.records.drive_record import RecordWriter

Arrays = dict[str, tuple[np.ndarray, int]]
"""Sensor -> one slot's values, and how many rows of them are valid (-1: all)."""


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
        folder = Path(lease.out) / lease.attempt_dir
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

    def seen(self, tick: int, sim_time_ns: int, arrays: Arrays, episode: Episode | None) -> None:
        """Record what was published for one tick."""
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
        """Record the stack's answer to that tick."""
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
            if self._lease.case.variation.drive == "failed" and result.passed:
                writer.path.unlink()
        except OSError as error:
            self._writer = writer
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        """The record ends here, the attempt goes on."""
        case = self._lease.case.id
        print(f"record of {case}: {error.strerror}; it ends here", file=sys.stderr, flush=True)
        self.abandon()
