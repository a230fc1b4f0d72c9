"""One recording: an attempt's messages in a file of their own."""

from __future__ import annotations

import hashlib
import json
import threading
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings

from schemas.wire.codec import decode, encode
from schemas.wire.view import CameraSample, CaseEnd, CaseStart, Stage, StateSample, clock
from viewer.recording import naming
from viewer.recording.blueprint import case_blueprint
from viewer.recording.convert import CaseConverter
from viewer.recording.rows import EntityRows, send
from viewer.recording.scenery import Logged


@dataclass(slots=True)
class Sequence:
    """Counts the samples of an attempt as they arrive, in order."""

    received: int = 0
    lost: int = 0
    _next: int = 0

    def take(self, seq: int, count: int = 1) -> bool:
        """Note ``count`` samples from ``seq`` on; False: an old one that is not to be used."""
        if seq < self._next:
            return False
        self.lost += seq - self._next
        self.received += count
        self._next = seq + count
        return True

    @property
    def complete(self) -> bool:
        """Whether no message is missing so far."""
        return self.lost == 0


FLUSH_PERIOD_S = 5.0
"""Messages are written in batches of this age; what a killed recorder loses [s]."""
FLUSH_BYTES = 2 << 20
"""Messages are written in batches of this size, if that is reached earlier [bytes]."""
STATE_BYTES = 1024
"""Size that a state counts for in a batch [bytes]."""
ROW_BYTES = 256
"""Size that a row of a sensor adds to a state [bytes]."""
MOVER_BYTES = 64
"""Size that an object that moves adds to a state [bytes]."""


class RecordingFile:
    """Writes ``recording.rrd`` in batches; readable at any time, also after a kill.

    ``recording.json`` is written last: whether anything is missing, and the file's digest, or that
    it was not kept. No file changes its name, so nothing temporary can stay behind.
    """

    def __init__(self, start: CaseStart) -> None:
        """Create the file.

        Raises:
            OSError: the attempt folder cannot be written.
        """
        self.start = start
        self._folder = Path(start.folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._sequence = Sequence()
        self._sequence.take(start.seq)
        self._converter = CaseConverter(start)
        self._states: list[StateSample] = []
        self._pictures: list[tuple[CameraSample, bytes]] = []
        self._bytes = 0
        self._since_s: float | None = None
        """Time at which the oldest message that is not written yet came [s]."""
        self._stream = rr.RecordingStream(
            naming.CASE_APP,
            recording_id=naming.recording_id(start.campaign, start.case, start.attempt),
        )
        self._stream.set_log_tick_enabled(False)
        self._stream.set_log_time_enabled(False)
        _set_file(
            self._stream,
            self._folder / naming.RECORDING_FILE,
            _layout(encode(start.stage), _columns(start), tuple(start.rows)),
        )
        self._stream.send_recording_name(f"{start.case} ({start.campaign})")
        self._stream.send_property(
            "case",
            rr.AnyValues(
                campaign=start.campaign,
                case=start.case,
                attempt=start.attempt,
                model=start.model,
                weather=start.weather,
                time_of_day=clock(start.time_of_day_min),
                seed=start.seed,
                schema=start.v,
            ),
        )
        self._log(self._converter.start(), static=True)
        # Before all else, so that the file of a killed recorder says what it is.
        self._stream.flush()

    def state(self, sample: StateSample, now_s: float = 0.0) -> None:
        """A KPI row that came at ``now_s``, on a clock that does not jump [s]."""
        if self._sequence.take(sample.seq):
            self._states.append(sample)
            rows = sum(len(its) for its in sample.rows.values())
            size = STATE_BYTES + MOVER_BYTES * len(sample.movers) + ROW_BYTES * rows
            self._came(size, now_s)

    def camera(self, sample: CameraSample, jpeg: bytes, now_s: float = 0.0) -> None:
        """A picture, like :meth:`state`."""
        if self._sequence.take(sample.seq):
            self._pictures.append((sample, jpeg))
            self._came(len(jpeg), now_s)

    def write(self, now_s: float) -> None:
        """Write what has waited for too long; call it again and again."""
        if self._since_s is not None and now_s - self._since_s >= FLUSH_PERIOD_S:
            self._write()

    def close(self, end: CaseEnd | None) -> bool:
        """Finish the file; ``end`` None: the attempt's end never came. Whether it is complete."""
        self._write()
        if end is not None:
            self._sequence.take(end.seq)
            self._send(self._converter.end(end))
        lost = self._sequence.lost
        complete = end is not None and lost == 0
        self._log(self._converter.summary(end, lost), static=True)
        self._stream.send_property(
            "verdict",
            rr.AnyValues(
                outcome=end.outcome if end else "",
                verdict=end.verdict if end else "",
                passed=bool(end and end.passed),
                complete=complete,
                lost=lost,
            ),
        )
        # Returns when all is written.
        self._stream.disconnect()
        passed = end is not None and end.passed
        self._note(complete, kept=not (self.start.keep == "failed" and passed))
        return complete

    def _note(self, complete: bool, *, kept: bool) -> None:
        path = self._folder / naming.RECORDING_FILE
        note: dict[str, Any] = {
            "complete": complete,
            "samples": self._sequence.received,
            "lost": self._sequence.lost,
            "kept": kept,
        }
        if kept:
            with path.open("rb") as file:
                note["sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
            note["bytes"] = path.stat().st_size
        (self._folder / naming.RECORDING_NOTE).write_text(json.dumps(note) + "\n", "utf-8")
        if not kept:
            # Last: a recorder that is killed here has left a file too many.
            path.unlink()

    def _came(self, nbytes: int, now_s: float) -> None:
        self._bytes += nbytes
        if self._since_s is None:
            self._since_s = now_s
        if self._bytes >= FLUSH_BYTES:
            self._write()

    def _write(self) -> None:
        """Everything that has come so far."""
        self._send(self._converter.pictures(self._pictures))
        self._send(self._converter.states(self._states))
        self._states, self._pictures = [], []
        self._bytes, self._since_s = 0, None

    def _send(self, entities: list[EntityRows]) -> None:
        for rows in entities:
            send(self._stream, rows)

    def _log(self, logged: list[Logged], *, static: bool = False) -> None:
        for path, archetype in logged:
            self._stream.log(path, archetype, static=static)


def release_closed() -> None:
    """Let go of streams that nobody holds any more; Rerun keeps two threads and 0.2 MB of each
    until it is asked."""
    bindings.flush_and_cleanup_orphaned_recordings()


def _set_file(stream: rr.RecordingStream, path: Path, blueprint: rrb.Blueprint) -> None:
    """``stream.set_sinks(FileSink(path), default_blueprint=blueprint)``, which leaves two threads
    behind for ever: the blueprint's own stream and its memory hold each other until it is
    disconnected, and nobody else can."""
    made = rr.RecordingStream._from_native(
        bindings.new_blueprint(
            application_id=naming.CASE_APP,
            make_default=False,
            make_thread_default=False,
            default_enabled=True,
        )
    )

    def lay_out() -> None:
        made.set_time("blueprint", sequence=0)
        blueprint._log_to_stream(made)

    # A stream's time is kept by the thread that set it, as long as that thread lives.
    thread = threading.Thread(target=lay_out)
    thread.start()
    thread.join()
    memory = made.memory_recording()
    bindings.set_sinks(
        [rr.FileSink(path)], default_blueprint=memory.storage, recording=stream.inner
    )
    made.disconnect()


@lru_cache(maxsize=16)
def _layout(
    stage: bytes, sensors: tuple[tuple[str, tuple[str, ...]], ...], rows: tuple[str, ...]
) -> rrb.Blueprint:
    """Cases of a campaign share one."""
    return case_blueprint(decode(stage, Stage), sensors=dict(sensors), rows=rows)


def _columns(start: CaseStart) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Sensors with a row of numbers, each with its columns."""
    return tuple((name, tuple(columns)) for name, columns in start.sensors.items())
