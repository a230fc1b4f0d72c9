"""What one case left in its attempt folders, read for the console: rows, recording, log."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pyarrow.parquet as pq

from schemas.files.regular_file import open_below
from twin.base.errors import TwinError, UsageError
from twin.records.kpi_file import read_kpi
from viewer.console.moments import COLUMNS, DecisiveMoment, decisive
from viewer.console.run_folder import RunFolder
from viewer.playback.folder import FoundRecording, recording_of
from viewer.playback.frames import RecordedCase, read_case
from viewer.recording import naming

LOG_FILE = "log.txt"
LOG_BYTES_MAX = 64 << 10
"""What is shown of the end of a log [bytes]."""


@dataclass(frozen=True)
class RecordedAttempt:
    """The committed attempt of a case, or the latest one; what was not recorded is None."""

    run: RunFolder
    case: str
    committed: str = ""
    """Name of the committed attempt's folder; empty: none yet."""
    verdict: str = ""
    """Its verdict, which has a say in what is decisive; empty: none."""

    @cached_property
    def found(self) -> FoundRecording | None:
        """Recording of the case."""
        try:
            return recording_of(self.run.folder, self.case, [], self.committed)
        except UsageError:
            return None

    @cached_property
    def attempt(self) -> str:
        """Name of the attempt's folder below the case's; empty: there is none."""
        if self.committed:
            return self.committed
        if self.found is not None:
            return self.found.path.parent.name
        names = self.attempts
        return names[0] if names else ""

    @cached_property
    def attempts(self) -> list[str]:
        """Attempt folders, the latest first."""
        if not self.case or "/" in self.case or self.case.startswith("."):
            return []
        folders = (self.run.folder / "cases" / self.case).glob("attempt-*")
        return sorted((p.name for p in folders if p.is_dir()), key=_number, reverse=True)

    @cached_property
    def rows(self) -> dict[str, list[Any]] | None:
        """KPI rows by column; None: there are none, or they cannot be read."""
        if not self.attempt:
            return None
        path = self.run.folder / "cases" / self.case / self.attempt / naming.KPI_FILE
        try:
            with open_below(self.run.folder, str(path.relative_to(self.run.folder))):
                pass
            rows: dict[str, list[Any]] = read_kpi(path).to_pydict()
        except (OSError, TwinError):
            return None
        return rows

    @cached_property
    def moment(self) -> DecisiveMoment | None:
        """Decisive moment of the case; None: it left neither rows nor a recording."""
        if (columns := self._deciding()) is not None:
            return decisive(*(columns[name] for name in COLUMNS), self.verdict)
        if self.recording is None or not self.recording.frames:
            return None
        frames = self.recording.frames
        nothing = [None] * len(frames)
        return decisive(
            [frame.sim_time_ns for frame in frames],
            nothing,
            [frame.dtc_m for frame in frames],
            nothing,
            [frame.aeb for frame in frames],
            self.verdict,
        )

    @cached_property
    def recording(self) -> RecordedCase | None:
        """All of its recording; None: it has none, or it cannot be read."""
        if self.found is None:
            return None
        try:
            return read_case(self.found.path)
        except UsageError:
            return None

    def log(self) -> tuple[str, bool] | None:
        """The end of its log, and whether something stands before it; None: it left none."""
        if not self.attempt:
            return None
        name = f"cases/{self.case}/{self.attempt}/{LOG_FILE}"
        try:
            with open_below(self.run.folder, name) as file:
                size = file.seek(0, 2)
                file.seek(max(0, size - LOG_BYTES_MAX))
                text = file.read(LOG_BYTES_MAX).decode("utf-8", "replace")
        except OSError:
            return None
        return text, size > LOG_BYTES_MAX

    def _deciding(self) -> dict[str, list[Any]] | None:
        """The columns that decide the moment; those that a file of an earlier version lacks are
        empty of values."""
        if not self.attempt:
            return None
        name = f"cases/{self.case}/{self.attempt}/{naming.KPI_FILE}"
        try:
            with open_below(self.run.folder, name) as file:
                parquet = pq.ParquetFile(file)
                names = [name for name in COLUMNS if name in parquet.schema_arrow.names]
                table = parquet.read(columns=names).to_pydict()
                count = parquet.metadata.num_rows
        except (OSError, ValueError):
            return None
        if "sim_time_ns" not in table:
            return None
        return {name: table.get(name, [None] * count) for name in COLUMNS}


def has_recording(run: RunFolder, case: str, committed: str) -> bool:
    """Whether a case was recorded; a link or another user's file counts as not recorded."""
    if committed:
        # Mostly it is this attempt; to look at the others takes five times as long.
        try:
            name = f"cases/{case}/{committed}/{naming.RECORDING_FILE}"
            with open_below(run.folder, name) as file:
                if os.fstat(file.fileno()).st_size:
                    return True
        except OSError:
            pass
    return RecordedAttempt(run, case, committed).found is not None


def _number(name: str) -> int:
    text = name.removeprefix("attempt-")
    return int(text) if text.isdigit() else -1
