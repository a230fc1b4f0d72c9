"""``allocations.json`` in a run folder: jobs of workers that were asked for at several sites.

Whoever asks for them keeps the file; the report reads the prices.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.wire.site_name import SITE_PATTERN

FILE_NAME = "allocations.json"
FILE_BYTES_MAX = 16 << 20
"""Largest file that is read [bytes]."""
KEPT_MAX = 10_000
"""Most allocations of a run; then nothing more is asked for."""

State = Literal["wanted", "queued", "running", "unreachable", "ended"]


class Allocation(Struct, kw_only=True):
    """One job of workers."""

    id: Annotated[str, Meta(pattern=rf"^{SITE_PATTERN}-[0-9]{{1,9}}$")]
    """``SITE-NUMBER``; never used again in this run."""
    site: Annotated[str, Meta(pattern=f"^{SITE_PATTERN}$")]
    scheduler: str
    workers: Annotated[int, Meta(ge=1)]
    walltime_h: Annotated[float, Meta(ge=0.0)]
    """Longest duration [h]."""
    made_s: float
    """Wall clock at which it was asked for, since 1970 [s]."""
    job: str = ""
    """The batch system's id; empty: not known yet."""
    state: State = "wanted"
    """``wanted``: written down before it is submitted. ``unreachable``: its site does not
    answer, or says nothing of it."""
    joined: bool = False
    """Whether the conductor has seen a worker of it."""
    dismissed: bool = False
    """Whether it was told to end."""
    ended_s: float = 0.0
    code: int | None = None
    """Exit code, where the batch system tells it."""
    why: str = ""
    """Why it was asked for; of one that has ended, why it did."""


class SiteRecord(Struct, kw_only=True):
    """How a site has done."""

    failures: int = 0
    """Allocations in a row that failed."""
    rests_until_s: float = 0.0
    """Wall clock until which nothing is asked of it [s]."""
    cost: float | None = None
    """Price of a worker's hour; None: unknown."""


class AllocationBook(Struct, kw_only=True):
    """Content of the file."""

    campaign: str
    """Shipped name, or absolute path of the campaign file."""
    run: Annotated[str, Meta(max_length=64)] = ""
    """Drawn once, when the book is made: submissions of another run in the same folder are not
    ours. Empty: an older book."""
    made: int = 0
    """Allocations that were ever asked for."""
    allocations: Annotated[list[Allocation], Meta(max_length=KEPT_MAX)] = field(
        default_factory=list
    )
    sites: dict[str, SiteRecord] = field(default_factory=dict)


def read_book(folder: Path) -> AllocationBook | None:
    """The book of a run folder; None: it has none.

    Raises:
        JsonError: it is damaged.
        OSError: it cannot be read.
    """
    try:
        data = read_regular(folder / FILE_NAME, FILE_BYTES_MAX)
    except FileNotFoundError:
        return None
    book: AllocationBook = decode_json(data, AllocationBook)
    return book


__all__ = ["Allocation", "AllocationBook", "JsonError", "SiteRecord", "read_book"]
