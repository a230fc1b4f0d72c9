"""Log and KPI rows of a case whose campaign's folder is not at hand: the conductor gives them, in
pieces and as fast as it likes."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from schemas import SCHEMA_VERSION
from schemas.wire.case_files import PIECE_BYTES_MAX, CaseFileName, CaseFilePiece, CaseFileRequest
from twin.base.errors import TwinError
from twin.base.process import PARENT_VARIABLE
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
        """A file as one piece; None: there is none, or it is larger than ``most`` bytes.

        Raises:
            SilentError: nobody knows.
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
        """The last ``most`` bytes of a file, at most a piece; None: there is none.

        Raises:
            SilentError: nobody knows.
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
            if not piece.retry:
                return None if piece.error or len(piece.data) > PIECE_BYTES_MAX else piece
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
    _lock: threading.Lock = field(default_factory=threading.Lock, compare=False)

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
        """KPI rows by column; None: there are none, or not those that were committed."""
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
        with self._lock:
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
        table = _read_apart(file.data)
        if table is None or kpi_sha256(table) != file.kpi_sha256:
            return None  # not what the verdict is about
        rows: dict[str, list[Any]] = table.to_pydict()
        return rows

    def _is_committed(self, piece: CaseFilePiece) -> bool:
        return self.committed == f"attempt-{piece.attempt}"


def _read_apart(data: bytes) -> pa.Table | None:
    """The rows of a KPI file that a worker wrote, perhaps on a machine that is not trusted here.

    Parquet is a format for a large library, so a process in the sandbox of stacks reads it. None:
    it is no KPI file, or has too many rows.
    """
    with tempfile.TemporaryDirectory(prefix="console-") as folder, _READING:
        given, wanted = (Path(folder) / name for name in ("given.parquet", "read.parquet"))
        given.write_bytes(data)
        try:
            done = subprocess.run(
                [sys.executable, "-m", "twin.kpi.foreign"],
                input=msgspec.json.encode([(str(given), str(wanted))]),
                capture_output=True,
                timeout=READ_S,
                check=False,
                env={**os.environ, PARENT_VARIABLE: str(os.getpid())},  # it ends with us
            )
            if done.returncode != 0:
                return None
            table = read_kpi(wanted)
        except (subprocess.TimeoutExpired, TwinError):
            return None
    return table if table.num_rows <= KPI_ROWS_MAX else None
