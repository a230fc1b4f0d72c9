"""Closed generations of a search on a closed form of its values, by its driver alone."""

from __future__ import annotations

from search_bench import LimitState

from conductor.search.driver import Closed, Proposal, first, follow
from schemas.sections.search import Search


def closed_of(section: Search, seed: int, form: LimitState) -> Closed:
    """All generations: no conductor, no cases."""
    proposal: Proposal | None = first(section, "solved", seed)
    u: list[list[list[float]]] = []
    results: list[list[float | None]] = []
    while proposal is not None:
        u.append(proposal.u)
        results.append([form([float(value) for value in row]) for row in proposal.values])
        proposal = follow(section, "solved", seed, Closed(u, results)).proposal
    return Closed(u, results)
