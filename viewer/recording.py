"""One recording: an attempt's messages in a file of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import rerun as rr

from schemas.view import CameraSample, CaseEnd, CaseStart, StateSample, clock
from viewer import naming
from viewer.blueprint import case_blueprint
from viewer.convert import CaseConverter
from viewer.scenery import Logged
from viewer.sequence import Sequence

FLUSH_PERIOD_S = 5.0
"""Rows are written in batches of this age; what a killed recorder loses [s]."""
FLUSH_BYTES = 4 << 20
"""Or of this size [bytes]."""


class Recording:
    """Writes ``recording.rrd`` as messages come; readable at any time, also after a kill.

    ``recording.json`` is written last and says whether anything is missing. No file changes its
    name, so nothing temporary can stay behind.
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
        self._stream = rr.RecordingStream(
            naming.CASE_APP,
            recording_id=naming.recording_id(start.campaign, start.case, start.attempt),
            batcher_config=rr.ChunkBatcherConfig(
                flush_tick=FLUSH_PERIOD_S, flush_num_bytes=FLUSH_BYTES
            ),
        )
        self._stream.set_log_tick_enabled(False)
        self._stream.set_log_time_enabled(False)
        self._stream.set_sinks(
            rr.FileSink(self._folder / naming.RECORDING_FILE),
            default_blueprint=case_blueprint(start.stage),
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

    def state(self, sample: StateSample) -> None:
        """A KPI row."""
        if self._sequence.take(sample.seq):
            self._at(sample.sim_time_ns, sample.tick)
            self._log(self._converter.state(sample))

    def camera(self, sample: CameraSample, jpeg: bytes) -> None:
        """A picture."""
        if self._sequence.take(sample.seq):
            self._at(sample.sim_time_ns, sample.tick)
            self._log(self._converter.camera(jpeg))

    def close(self, end: CaseEnd | None) -> bool:
        """Finish the file; ``end`` None: the attempt's end never came. Whether it is complete."""
        if end is not None:
            self._sequence.take(end.seq)
            self._at(end.sim_time_ns, None)
            self._log(self._converter.end(end))
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
        self._stream.flush()
        self._stream.disconnect()
        self._note(complete)
        return complete

    def _note(self, complete: bool) -> None:
        note = {
            "complete": complete,
            "samples": self._sequence.received,
            "lost": self._sequence.lost,
        }
        path = self._folder / naming.RECORDING_NOTE
        path.write_text(json.dumps(note) + "\n", encoding="utf-8")

    def _at(self, sim_time_ns: int, tick: int | None) -> None:
        self._stream.set_time(naming.SIM_TIME, duration=np.timedelta64(sim_time_ns, "ns"))
        if tick is not None:
            self._stream.set_time(naming.TICK, sequence=tick)

    def _log(self, logged: list[Logged], *, static: bool = False) -> None:
        for path, archetype in logged:
            self._stream.log(path, archetype, static=static)
