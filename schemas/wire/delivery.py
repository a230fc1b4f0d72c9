"""Messages of ``conductor/files``: results of workers that do not share the conductor's disk.

A worker asks whether it sees the conductor's campaign folder, by the digest of the
``conductor.json`` it finds there. If not, it delivers the files of an attempt before it commits it.
"""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from msgspec import Meta, Struct, field

from schemas.campaign import Name
from schemas.digest import digest
from schemas.wire.bounds import COUNT_MAX, Session

FILES_BYTES_MAX = 64 << 20
"""Largest attempt that is delivered [bytes]; the KPIs of a minute are about one MiB."""

MESSAGE_BYTES_MAX = FILES_BYTES_MAX + (1 << 20)
"""Largest message of this topic [bytes]."""


Extra = Literal["interventions.jsonl", "judge.json", "realtime.csv"]
"""Files that an attempt may have besides KPIs and log: interventions, what its judge
needs, and how it went by the wall clock."""
EXTRAS: tuple[Extra, ...] = get_args(Extra)


class SeenFolder(Struct, frozen=True, tag_field="verb", tag="seen"):
    """What a worker sees where the campaign folder should be."""

    v: int
    campaign: Name
    sha256: str
    """SHA-256 of the ``conductor.json`` there."""
    worker: str = ""
    session: Session = b""


class AttemptFiles(Struct, frozen=True, tag_field="verb", tag="attempt"):
    """The files of one attempt; the same ones again are answered the same."""

    v: int
    campaign: Name
    case: Annotated[str, Meta(min_length=1)]
    attempt: Annotated[int, Meta(ge=1, le=COUNT_MAX)]
    kpi: bytes
    """Content of ``kpi.parquet``; empty: the attempt ended without."""
    log: bytes
    """Content of ``log.txt``."""
    sha256: str
    """See :func:`files_sha256`."""
    extras: dict[Extra, bytes] = field(default_factory=dict)
    """Content of further files, by name."""
    extras_sha256: str = ""
    """See :func:`extras_sha256`."""
    worker: str = ""
    """Worker that ran the attempt: its lease is, or was, this worker's."""
    session: Session = b""


Delivery = SeenFolder | AttemptFiles


class Delivered(Struct, frozen=True):
    """Answer: ``ok`` if the folder is the conductor's own, or the files are safe on its disk."""

    v: int
    ok: bool
    error: str = ""
    """Why the files were not taken, in one line."""
    retry: bool = False
    """The same may succeed later: a full disk, or too many files at once."""
    fenced: bool = False
    """The attempt is not, or no longer, the sender's: the conductor takes no result of it either,
    and says so when it is committed."""


def files_sha256(kpi: bytes, log: bytes) -> str:
    """Digest over both files with their lengths."""
    return digest([kpi, log])


def extras_sha256(extras: dict[Extra, bytes]) -> str:
    """Digest over names and files with their lengths; empty without any."""
    parts = [part for name in sorted(extras) for part in (name.encode(), extras[name])]
    return digest(parts) if parts else ""
