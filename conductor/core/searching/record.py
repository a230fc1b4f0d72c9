"""What a conductor knows of a search beside its cases."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from msgspec import Struct

from schemas.files.search_result import ChainEstimate, SearchAnswer
from schemas.sections.search import Search, rows_of


class SearchRecord(Struct):
    """The generations of one search, in the order in which they were proposed.

    They close in this order as well: a generation whose cases have all ended waits for those before
    it, so nothing here depends on which case ended first.
    """

    u: list[bytes]
    """Standard normal coordinates per generation, see :func:`packed`."""
    results: list[list[float | None]] = []
    """KPI per case of the generations that have closed, as it was then."""
    answers: list[SearchAnswer] = []
    """What was known after each of them."""
    ended: str = ""
    """Why nothing more is proposed; empty: the search goes on."""
    versions: dict[str, str] = {}
    """Libraries that proposed last."""
    cpus: list[str] = []
    """Classes of the processors that proposed, in the order in which they came."""
    chains: list[int] = []
    """Chain of each generation."""
    sizes: list[int] = []
    """Cases of each generation."""
    closed: int = 0
    """Cases of the generations that have closed."""
    reasons: list[str] = []
    """Why each closed generation ended the search; empty: it did not."""
    estimates: list[ChainEstimate] = []
    """What its chain knew after each, where chains have a mean."""

    @property
    def open(self) -> int:
        """Number of generations that are proposed and have not closed."""
        return len(self.sizes) - len(self.results)

    def close(
        self,
        results: list[float | None],
        answer: SearchAnswer | None,
        estimate: ChainEstimate,
        ended: str,
    ) -> None:
        """The oldest open generation has closed."""
        self.closed += len(results)
        self.results.append(results)
        if answer is not None:
            self.answers.append(answer)
        self.estimates.append(estimate)
        self.reasons.append(ended)
        self.ended = ended or self.ended

    def reopen(self, generation: int) -> bool:
        """A generation has not closed after all; whether that changes anything: what followed from
        it is proposed already, unless the search had ended."""
        ends = next((place for place, why in enumerate(self.reasons) if why), len(self.reasons))
        if not ends <= generation < len(self.results):
            return False
        for kept in (self.results, self.answers, self.reasons, self.estimates):
            del kept[generation:]
        self.closed = sum(self.sizes[:generation])
        self.ended = next((why for why in reversed(self.reasons) if why), "")
        return True

    def generation_of(self, order: int) -> int:
        """The generation of the case at a position of its campaign."""
        for number, size in enumerate(self.sizes):
            if order < size:
                return number
            order -= size
        raise AssertionError("a case of no generation")


def begun(search: Search) -> SearchRecord:
    """The record of a search that begins: a generation of every chain."""
    sizes = [len(rows_of(rows)) for rows in search.proposed]
    ends = [sum(sizes[: number + 1]) for number in range(len(sizes))]
    parts = [search.first[end - size : end] for end, size in zip(ends, sizes, strict=True)]
    return SearchRecord(
        u=[packed(part) for part in parts], chains=list(range(len(sizes))), sizes=sizes
    )


def packed(u: Sequence[Sequence[float]]) -> bytes:
    """Coordinates [cases][parameters] as float64, little-endian: a hundred thousand rows as lists
    are most of what a conductor remembers of a search."""
    flat = [value for row in u for value in row]
    return struct.pack(f"<{len(flat)}d", *flat)


def unpacked(u: bytes, cases: int) -> list[list[float]]:
    """Coordinates [cases][parameters] of :func:`packed`; there may be no parameter."""
    flat = struct.unpack(f"<{len(u) // 8}d", u)
    size = len(flat) // cases
    return [list(flat[at * size : (at + 1) * size]) for at in range(cases)]
