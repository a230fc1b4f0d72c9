"""What a conductor knows of a search beside its cases."""

from __future__ import annotations

from msgspec import Struct

from schemas.files.search_result import SearchAnswer


class SearchRecord(Struct):
    """The generations of one search, in the order in which they were proposed."""

    u: list[list[list[float]]]
    """Standard normal coordinates [generations][cases][parameters]."""
    results: list[list[float | None]] = []
    """KPI per case of the generations that have closed, as it was then."""
    answers: list[SearchAnswer] = []
    """What was known after each of them."""
    ended: str = ""
    """Why it ended; empty: it goes on."""
    versions: dict[str, str] = {}
    """Libraries that proposed last."""
    cpus: list[str] = []
    """Classes of the processors that proposed, in the order in which they came."""
