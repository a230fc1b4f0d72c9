"""Journal of the interventions in an attempt: a line of JSON per action, written at once."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from schemas import SCHEMA_VERSION
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.first_stage import head_of
from schemas.wire.control import Lease, Result
from schemas.wire.interventions import (
    JOURNAL_FILE,
    Action,
    JournalEnd,
    JournalHead,
    JournalLine,
    RecordedAction,
)
from twin.base.errors import TwinError, UsageError, storage_error
from twin.base.software import device_class, software_digest


class InterventionJournal:
    """Appends to the file beside the attempt's KPIs; begun with the first action."""

    def __init__(self, lease: Lease, slots: int, device: str) -> None:
        """Begin the journal of an attempt, in its folder.

        Raises:
            TwinError: the folder cannot be written.
        """
        folder = Path(lease.out) / lease.attempt_dir
        self._path = folder / JOURNAL_FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(
                self._path,
                os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC,
                0o666,
            )
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        self._size = self._before = 0
        head = JournalHead(
            v=SCHEMA_VERSION,
            attempt=lease.attempt,
            software=software_digest(),
            device_class=device_class(device),
            slots=slots,
            case=lease.case,
        )
        try:
            self._write(head)
        except TwinError:
            self.discard()
            raise

    def add(self, tick: int, sim_time_ns: int, actions: Sequence[Action]) -> None:
        """Add actions that are done together, before they are applied.

        Raises:
            TwinError: it cannot be written; the journal is as it was.
        """
        self._write(*(RecordedAction(tick, sim_time_ns, action) for action in actions))

    def take_back(self) -> None:
        """Remove the actions added last, which could not be applied."""
        self._cut(self._before)

    def end(self, result: Result, ticks: int) -> None:
        """The attempt came to its end."""
        try:
            self._write(JournalEnd(result.outcome, result.verdict, result.kpi_sha256, ticks))
        finally:
            self.close()

    def close(self) -> None:
        """Close the journal: nothing more is written."""
        os.close(self._descriptor)

    def discard(self) -> None:
        """Remove the journal: nothing was done after all."""
        self.close()
        self._path.unlink(missing_ok=True)

    def _write(self, *lines: JournalLine) -> None:
        """Append lines, whole or not at all."""
        data = memoryview(b"".join(msgspec.json.encode(line) + b"\n" for line in lines))
        size = self._size + len(data)
        try:
            while data:  # a disk that is nearly full takes a part
                data = data[os.write(self._descriptor, data) :]
        except OSError as error:
            self._cut(self._size)
            raise storage_error(error, str(self._path)) from None
        self._before, self._size = self._size, size

    def _cut(self, size: int) -> None:
        with contextlib.suppress(OSError):  # a reader says then that it is damaged
            os.ftruncate(self._descriptor, size)
        self._size = size


def read_journal(path: Path) -> tuple[JournalHead, list[RecordedAction], JournalEnd | None]:
    """A journal; without an end if its attempt was cut off.

    Raises:
        UsageError: there is none, or it is damaged; one line.
    """
    path = path / JOURNAL_FILE if path.is_dir() else path
    try:
        texts = read_regular(path, RUN_FILE_BYTES_MAX).splitlines()
        lines: list[JournalLine] = [_head(text) for text in texts[:1]]
        lines += [decode_json(text, JournalLine) for text in texts[1:]]
    except FileNotFoundError:
        raise UsageError(
            f"{path}: no such journal; give the folder of an attempt that was steered by hand"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except JsonError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
    if not lines or not isinstance(lines[0], JournalHead):
        raise UsageError(f"{path}: damaged: it does not begin with its attempt")
    if lines[0].v != SCHEMA_VERSION:
        raise UsageError(
            f"{path}: schema version {lines[0].v} given, this side speaks {SCHEMA_VERSION}; "
            "install the version that wrote it"
        )
    end = lines[-1] if isinstance(lines[-1], JournalEnd) else None
    return lines[0], [line for line in lines if isinstance(line, RecordedAction)], end


def _head(text: bytes) -> JournalLine:
    """The first line, also as release 0.1 wrote it.

    Raises:
        JsonError: it is damaged.
    """
    try:
        head: JournalLine = msgspec.convert(head_of(decode_json(text, Any)), JournalLine)
    except msgspec.ValidationError as error:
        raise JsonError(str(error)) from None
    return head
