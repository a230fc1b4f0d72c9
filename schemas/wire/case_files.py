"""Messages of ``conductor/case-files``: what the committed attempt of a case left, for members who
look on and do not share the conductor's disk.

A file comes in pieces. Who asks names a case and a kind of file, never a path.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.campaign import Name
from schemas.wire.bounds import COUNT_MAX

CaseFileName = Literal["log.txt", "kpi.parquet"]
"""Files that are given."""

REQUEST_BYTES_MAX = 4096
"""Largest request [bytes]: a few names."""

PIECE_BYTES_MAX = 256 << 10
"""Largest piece of a file [bytes]; a worker's log is hardly larger."""


class CaseFileRequest(Struct, frozen=True):
    """Asks for a piece of a file."""

    v: int
    campaign: Name
    case: Annotated[str, Meta(min_length=1)]
    file: CaseFileName
    first: Annotated[int, Meta(ge=-PIECE_BYTES_MAX, le=COUNT_MAX)] = 0
    """From which byte on; negative: so many bytes before the end."""


class CaseFilePiece(Struct, frozen=True):
    """Answer: a piece, or why there is none."""

    v: int
    data: bytes = b""
    first: int = 0
    """Where the piece begins [bytes]."""
    size: int = 0
    """Length of the file [bytes]."""
    attempt: int = 0
    """Attempt that it is of; pieces of two are not one file."""
    kpi_sha256: str = ""
    """SHA-256 of the values in the attempt's KPI file, as it was committed."""
    error: str = ""
    """Why there is no piece, in one line."""
    retry: bool = False
    """The same may succeed in a moment: more is asked for than is given."""
