"""Log and KPI rows of a case whose campaign's folder is not at hand: the conductor gives them, in
pieces and as fast as it likes."""

from __future__ import annotations

import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from schemas import SCHEMA_VERSION
from schemas.kinds.kpi import columns_by_name
from schemas.wire.case_files import PIECE_BYTES_MAX, CaseFileName, CaseFilePiece, CaseFileRequest
from twin.base.errors import EXIT_USAGE, TwinError
from twin.records.kpi_apart import written_anew
from twin.records.kpi_file import kpi_sha256, read_kpi
from viewer.console.moments import COLUMNS, DecisiveMoment, decisive
from viewer.console.recorded import LOG_BYTES_MAX, LOG_FILE, RecordedAttempt
from viewer.recording import naming

KPI_BYTES_MAX = 16 << 20
"""Largest KPI file that is sent for [bytes]; that of a minute is about one MiB."""
KPI_ROWS_MAX = 60_000
"""Most rows that it may have."""
READ_S = 60.0
"""Longest time that reading it may take [s]."""
READ_TRIES = 3
"""How often the process that reads it may end without an answer: then it has none of use."""
READINGS_MAX = 2
"""KPI files that are read at the same time; further ones wait."""
_READING = threading.BoundedSemaphore(READINGS_MAX)
BUSY_TRIES = 20
"""How often a piece is asked for while the conductor is busy."""
BUSY_S = 0.25
"""Time between two of these [s]."""
UNANSWERED_S = 30.0
"""After no answer nothing is asked for so long [s]: conductors of earlier releases give no files,
and a page should not wait for each."""


class SilentError(Exception):
    """The conductor does not answer, or gives no files: nothing is known about the file."""


class _UnreadError(SilentError):
    """The process that should read a file was stopped, or ended without an answer."""


AskConductor = Callable[[CaseFileRequest], CaseFilePiece | None]
"""One question to the conductor; None: no answer. Raises TwinError: it cannot be asked now."""


class RemoteFiles:
    """Files of committed attempts of one conductor; any thread may ask."""

    def __init__(self, ask: AskConductor, wait: Callable[[float], object] = time.sleep) -> None:
        """``ask``: one question; ``wait``: spends a time [s]."""
        self._ask, self._wait = ask, wait
        self._silent_until_s = 0.0

    def whole(
        self, campaign: str, case: str, file: CaseFileName, most: int
    ) -> CaseFilePiece | None:
        """A file as one piece; None: it is larger than ``most`` bytes.

        Raises:
            SilentError: nobody knows, or it is not there, perhaps not yet.
        """
        first = self._piece(campaign, case, file, 0)
        if first is None or first.size > most:
            return None
        parts, length, piece = [first.data], len(first.data), first
        while length < first.size:
            following = self._piece(campaign, case, file, length)
            if following is None:
                return None
            same = (following.attempt, following.size, following.first)
            if same != (piece.attempt, first.size, length) or not following.data:
                raise SilentError  # another attempt was committed meanwhile: asked for anew
            piece = following
            parts.append(piece.data)
            length += len(piece.data)
        return CaseFilePiece(
            v=first.v,
            data=b"".join(parts),
            size=length,
            attempt=first.attempt,
            kpi_sha256=first.kpi_sha256,
        )

    def end_of(
        self, campaign: str, case: str, file: CaseFileName, most: int
    ) -> CaseFilePiece | None:
        """The last ``most`` bytes of a file, at most a piece; None: it is of no use.

        Raises:
            SilentError: nobody knows, or it is not there, perhaps not yet.
        """
        return self._piece(campaign, case, file, -min(most, PIECE_BYTES_MAX))

    def _piece(
        self, campaign: str, case: str, file: CaseFileName, first: int
    ) -> CaseFilePiece | None:
        request = CaseFileRequest(
            v=SCHEMA_VERSION, campaign=campaign, case=case, file=file, first=first
        )
        if time.monotonic() < self._silent_until_s:
            raise SilentError
        for _ in range(BUSY_TRIES):
            try:
                piece = self._ask(request)
            except TwinError as error:
                raise SilentError from error
            if piece is None:
                self._silent_until_s = time.monotonic() + UNANSWERED_S
                raise SilentError
            if piece.error and not piece.retry:
                raise SilentError  # after a takeover files come back one by one: it may be later
            if not piece.retry:
                return piece if len(piece.data) <= PIECE_BYTES_MAX else None
            self._wait(BUSY_S)
        raise SilentError


@dataclass(frozen=True)
class RemoteAttempt(RecordedAttempt):
    """The committed attempt of a case, as far as the conductor gives it: log and KPI rows. What
    could not be asked is asked again."""

    files: RemoteFiles | None = None
    campaign: str = ""
    """Its campaign, for the conductor."""
    _known: dict[str, Any] = field(default_factory=dict, compare=False)
    _unread: list[_UnreadError] = field(default_factory=list, compare=False)
    _locks: dict[str, threading.Lock] = field(
        default_factory=lambda: {n: threading.Lock() for n in (naming.KPI_FILE, LOG_FILE)},
        compare=False,
    )
    """One per file: a log does not wait until rows are read."""

    @cached_property
    def found(self) -> None:
        """No recording is sent for."""
        return None

    @cached_property
    def attempts(self) -> list[str]:
        """No folder of it is here."""
        return []

    @property
    def rows(self) -> dict[str, list[Any]] | None:  # type: ignore[override]
        """KPI rows by column, without detections; None: there are none, or not those that were
        committed."""
        rows: dict[str, list[Any]] | None = self._once(naming.KPI_FILE, self._read_rows)
        return rows

    @property
    def moment(self) -> DecisiveMoment | None:  # type: ignore[override]
        """Decisive moment of the case; None: it has no rows."""
        if not (rows := self.rows):
            return None
        nothing = [None] * len(rows["sim_time_ns"])
        return decisive(*(rows.get(name, nothing) for name in COLUMNS), self.verdict)

    def log(self) -> tuple[str, bool] | None:
        """The end of its log, and whether something stands before it; None: it left none."""
        log: tuple[str, bool] | None = self._once(LOG_FILE, self._read_log)
        return log

    def _once(self, name: str, read: Callable[[], Any]) -> Any:
        with self._locks[name]:
            if name not in self._known:
                try:
                    self._known[name] = read() if self.committed else None
                except SilentError:
                    return None
            return self._known[name]

    def _read_log(self) -> tuple[str, bool] | None:
        assert self.files is not None
        piece = self.files.end_of(self.campaign, self.case, "log.txt", LOG_BYTES_MAX)
        if piece is None or not self._is_committed(piece):
            return None
        return piece.data.decode("utf-8", "replace"), piece.first > 0

    def _read_rows(self) -> dict[str, list[Any]] | None:
        assert self.files is not None
        file = self.files.whole(self.campaign, self.case, "kpi.parquet", KPI_BYTES_MAX)
        if file is None or not self._is_committed(file):
            return None
        try:
            table = _read_apart(file.data)
        except _UnreadError as error:
            self._unread.append(error)
            if len(self._unread) < READ_TRIES:
                raise
            return None
        if table is None or kpi_sha256(table) != file.kpi_sha256:
            return None  # not what the verdict is about
        rows: dict[str, list[Any]] = table.select(_shown(table)).to_pydict()
        return rows

    def _is_committed(self, piece: CaseFilePiece) -> bool:
        return self.committed == f"attempt-{piece.attempt}"


def _shown(table: pa.Table) -> list[str]:
    """Columns that a page may show. Not detections: of these a small file can hold so many that
    they fill the memory as values of Python, and pages take them from recordings."""
    kinds = columns_by_name()
    return [name for name in table.column_names if kinds[name].type != "detections"]


def _read_apart(data: bytes) -> pa.Table | None:
    """The rows of a KPI file that a worker wrote, perhaps on a machine that is not trusted here.

    Parquet is a format for a large library, so a process in the sandbox of stacks reads it. None:
    it is no KPI file, or has too many rows.

    Raises:
        SilentError: there was no room for it, or no process.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="console-") as folder, _READING:
            given, wanted = (Path(folder) / name for name in ("given.parquet", "read.parquet"))
            given.write_bytes(data)
            done = written_anew([(given, wanted)], READ_S)
            if done.returncode == EXIT_USAGE:
                return None
            if done.returncode != 0:
                raise _UnreadError
            table = read_kpi(wanted)
    except OSError as error:
        raise SilentError from error
    except (subprocess.TimeoutExpired, TwinError) as error:
        raise _UnreadError from error
    return table if table.num_rows <= KPI_ROWS_MAX else None
