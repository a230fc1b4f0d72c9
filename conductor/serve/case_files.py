"""Logs and KPI rows of committed attempts, for members who look on without the conductor's disk."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from conductor.core.facts import Committed
from conductor.serve.answering import AnsweringThread
from conductor.serve.engine import ConductorEngine
from schemas import SCHEMA_VERSION
from schemas.escape import escape
from schemas.files.regular_file import open_below
from schemas.wire.case_files import (
    PIECE_BYTES_MAX,
    REQUEST_BYTES_MAX,
    CaseFilePiece,
    CaseFileRequest,
)
from schemas.wire.codec import WireError, decode, encode
from twin.fabric.bus import Respond
from twin.fabric.front.rules import Bucket

WAITING_MAX = 64
"""Most requests that wait; further ones are answered "busy"."""
BYTES_PER_S = 8 << 20
"""What all who ask are given together [bytes/s]."""
ASKED_BYTES = 4096
"""What a request costs beside its piece: to open a file takes longer than to read a little."""


class CaseFiles:
    """Takes what comes on ``conductor/case-files``."""

    def __init__(self, engine: ConductorEngine, lock: threading.Lock) -> None:
        """Begin to answer.

        Args:
            engine: knows which attempts are committed.
            lock: held by whoever changes its state.
        """
        self._engine, self._lock = engine, lock
        self._given = Bucket(BYTES_PER_S)
        self.answering = AnsweringThread(
            "case files",
            WAITING_MAX,
            lambda payload: encode(self.handle(payload, time.monotonic())),
            lambda error: encode(_none(error, retry=True)),
        )

    def receive(self, payload: bytes, respond: Respond) -> None:
        """A message came in; from any thread, never waits."""
        if len(payload) > REQUEST_BYTES_MAX:
            error = f"message of {len(payload)} bytes, at most {REQUEST_BYTES_MAX} are accepted"
            respond(encode(_none(error)))
        elif not self.answering.offer(payload, respond):
            respond(encode(_none("busy: too many requests are waiting", retry=True)))

    def close(self) -> None:
        """End; what is waiting has no answer, since the session with whoever asked has ended."""
        self.answering.close(answering=False)

    def handle(self, payload: bytes, now_s: float) -> CaseFilePiece:
        """The piece that a message asks for; ``now_s`` by the monotonic clock."""
        try:
            request: CaseFileRequest = decode(payload, CaseFileRequest, REQUEST_BYTES_MAX)
        except WireError as error:
            return _none(str(error))
        with self._lock:
            campaign = self._engine.state.campaigns.get(request.campaign)
            case = campaign.cases.get(request.case) if campaign else None
            end = case.end if case else None
            out = campaign.out if campaign else ""
        # Who asks for what is not here costs the others nothing.
        if case is None:
            what = escape(f"{request.campaign}/{request.case}", ASKED_BYTES)
            return _none(f"no case '{what}' here; ask for one that the status has")
        if not isinstance(end, Committed):
            return _none(f"{case.case.id}: no result of it is committed; ask when it has ended")
        if not self._given.has(ASKED_BYTES + PIECE_BYTES_MAX, now_s):
            return _none("busy: more is asked for than is given at once", retry=True)
        # The names are the journal's; no path of it comes from whoever asks or whoever committed.
        name = f"cases/{case.case.id}/attempt-{end.attempt}/{request.file}"
        piece = _read(Path(out), name, request.first, end)
        # What was set aside for a whole piece and not given is there for the next.
        self._given.take(len(piece.data) - PIECE_BYTES_MAX, now_s)
        return piece


def _read(out: Path, name: str, asked: int, end: Committed) -> CaseFilePiece:
    """The piece of file ``name`` of campaign folder ``out`` from byte ``asked`` on; if negative, as
    many bytes before its end."""
    try:
        with open_below(out, name) as file:
            size = file.seek(0, 2)
            first = asked if asked >= 0 else max(0, size + asked)
            file.seek(min(first, size))
            data = file.read(PIECE_BYTES_MAX)
    except OSError as error:
        return _none(f"{name}: {error.strerror or 'cannot be read'}")
    return CaseFilePiece(
        v=SCHEMA_VERSION,
        data=data,
        first=min(first, size),
        size=size,
        attempt=end.attempt,
        kpi_sha256=end.result.kpi_sha256,
    )


def _none(error: str, *, retry: bool = False) -> CaseFilePiece:
    return CaseFilePiece(v=SCHEMA_VERSION, error=error, retry=retry)
