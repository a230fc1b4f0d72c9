"""Files of attempts that come through the fabric, from workers that do not share our disk.

They are written by a thread of their own, before the worker commits the attempt: when the commit is
journalled, the files are there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from conductor.records.attempts import leads_away
from conductor.serve.answering import AnsweringThread
from schemas import SCHEMA_VERSION
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.delivery import (
    MESSAGE_BYTES_MAX,
    AttemptFiles,
    Delivered,
    Delivery,
    SeenFolder,
    extras_sha256,
    files_sha256,
)
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.fabric.bus import Respond
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE

WAITING_BYTES_MAX = 128 << 20
"""Most bytes of files that wait to be written; more are refused and sent again."""

FolderOf = Callable[[Delivery], tuple[str, str]]
"""Message -> campaign folder and nothing; or nothing and why its sender may not, in a line."""


class Deliveries:
    """Takes what comes on ``conductor/files``."""

    def __init__(self, folder_of: FolderOf) -> None:
        self._folder_of = folder_of
        self._answering = AnsweringThread(
            "deliveries",
            WAITING_BYTES_MAX,
            lambda payload: encode(self.handle(payload)),
            lambda error: encode(_refused(error, retry=True)),
        )

    def receive(self, payload: bytes, respond: Respond) -> None:
        """A message came in; from any thread, never waits."""
        if len(payload) > MESSAGE_BYTES_MAX:
            error = f"message of {len(payload)} bytes, at most {MESSAGE_BYTES_MAX} are accepted"
            respond(encode(_refused(error)))
            return
        if not self._answering.offer(payload, respond, len(payload) + 256):
            error = "busy: too many files are waiting to be written"
            respond(encode(Delivered(v=SCHEMA_VERSION, ok=False, error=error, retry=True)))

    def close(self) -> None:
        """Write what is waiting, and end."""
        self._answering.close(answering=True)

    def handle(self, payload: bytes) -> Delivered:
        """Do what a message asks for."""
        try:
            message: Delivery = decode(payload, Delivery, MESSAGE_BYTES_MAX)
        except WireError as error:
            return _refused(str(error))
        if isinstance(message, SeenFolder):
            return Delivered(v=SCHEMA_VERSION, ok=self._is_ours(message))
        return self._store(message)

    def _is_ours(self, sighting: SeenFolder) -> bool:
        folder, denied = self._folder_of(sighting)
        if denied:
            return False
        try:
            content = read_regular(Path(folder) / CONDUCTOR_FILE, RUN_FILE_BYTES_MAX)
        except OSError:
            return False
        return hashlib.sha256(content).hexdigest() == sighting.sha256

    def _store(self, files: AttemptFiles) -> Delivered:
        out, denied = self._folder_of(files)
        if denied:
            return _refused(denied, fenced=True)
        folder = Path(out)
        whole = files_sha256(files.kpi, files.log), extras_sha256(files.extras)
        if whole != (files.sha256, files.extras_sha256):
            return _refused(f"{files.case}: damaged on its way", retry=True)
        attempt = folder / "cases" / files.case / f"attempt-{files.attempt}"
        if leads_away(folder, attempt):
            return _refused(f"{attempt}: leads out of {folder} through a symbolic link")
        try:
            attempt.mkdir(parents=True, exist_ok=True)
            # An attempt that ended without a result has what its stack printed, and no KPIs.
            kpi = [("kpi.parquet", files.kpi)] if files.kpi else []
            written = [*kpi, ("log.txt", files.log)]
            for name, data in (*written, *files.extras.items()):
                path = attempt / name
                if leads_away(folder, path):
                    return _refused(f"{path}: a symbolic link")
                if not path.exists():
                    write_atomic(path, data)
                elif path.read_bytes() != data:
                    return _refused(f"{path}: is there already, with another content")
        except OSError as error:
            return _refused(str(storage_error(error, str(attempt))), retry=True)
        return Delivered(v=SCHEMA_VERSION, ok=True)


def _refused(error: str, *, retry: bool = False, fenced: bool = False) -> Delivered:
    return Delivered(v=SCHEMA_VERSION, ok=False, error=error, retry=retry, fenced=fenced)
