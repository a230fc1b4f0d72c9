"""``search.json``, as a conductor writes it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec import UNSET

from conductor.core.facts import Committed
from conductor.core.searching.record import unpacked
from conductor.core.state import CampaignState
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.files.search_result import (
    FILE_NAME,
    FailureMap,
    SearchBoundary,
    SearchCluster,
    SearchCoverage,
    SearchFile,
    SearchGeneration,
    SearchIndices,
)
from schemas.kinds.sampler import sampler_kinds
from schemas.sections.search import Search, Value, name_of, rows_of
from schemas.verdict import IMPACT
from twin.base.errors import InfrastructureError, UsageError

SEARCH_BYTES_MAX = 256 << 20
"""Largest file that is read: a hundred thousand cases of forty parameters take 180 MB."""


def encode_search(campaign: CampaignState) -> bytes:
    """A search as it stands: the same facts, the same bytes."""
    return msgspec.json.format(msgspec.json.encode(search_file(campaign)), indent=1) + b"\n"


def read_search(folder: Path) -> SearchFile:
    """The search of a campaign folder.

    Raises:
        UsageError: there is none.
        InfrastructureError: its file is damaged.
    """
    path = folder / FILE_NAME
    try:
        return decode_json(read_regular(path, SEARCH_BYTES_MAX), SearchFile)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}; no search was run there") from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}") from None


def search_file(campaign: CampaignState) -> SearchFile:
    """A search as it stands."""
    search, record = campaign.campaign.search, campaign.search
    assert search is not UNSET
    assert record is not None
    objective = search.objective
    generations = []
    forks = [] if search.forks is UNSET else search.forks
    for number, (u, values) in enumerate(zip(record.u, search.proposed, strict=True)):
        closed = number < len(record.results)
        rows = unpacked(u, record.sizes[number])
        generations.append(
            SearchGeneration(
                cases=[name_of(number, index) for index in range(len(rows))],
                values=rows_of(values),
                u=rows,
                results=record.results[number] if closed else [],
                forks=forks[number] if number < len(forks) else [],
                answer=record.answers[number] if number < len(record.answers) else None,
                chain=record.chains[number],
            )
        )
    values = [row for generation in generations if generation.results for row in generation.values]
    further = _further(search, campaign, values)
    return SearchFile(
        campaign=campaign.campaign.campaign,
        sampler=search.sampler,
        title=sampler_kinds().find(search.sampler).title,
        chains=search.chains,
        kpi=objective.kpi,
        formula="" if objective.formula is UNSET else objective.formula,
        fails_below=None if objective.fails_below is UNSET else objective.fails_below,
        fails_above=None if objective.fails_above is UNSET else objective.fails_above,
        parameters=list(search.parameters),
        ended=record.ended,
        answer=record.answers[-1] if record.answers else None,
        clusters=_clusters(search, campaign) if record.ended else [],
        indices=further.indices,
        failure_map=further.failure_map,
        coverage=further.coverage,
        boundary=_boundary(search, campaign),
        versions=record.versions,
        cpus=record.cpus,
        generations=generations,
    )


def _clusters(search: Search, campaign: CampaignState) -> list[SearchCluster]:
    from conductor.search.driver import Closed, clusters

    record = campaign.search
    assert record is not None
    if search.objective.goal is not UNSET:
        return []

    def impact_mps(name: str) -> float:
        end = campaign.cases[name].end
        speed = end.result.scalars.get(IMPACT) if isinstance(end, Committed) else None
        return float(speed or 0.0)

    closed = Closed(record.u[: len(record.results)], record.results)
    return clusters(search, closed, impact_mps)


class _Further(NamedTuple):
    """What is made of a search that has ended."""

    indices: SearchIndices | None = None
    failure_map: FailureMap | None = None
    coverage: SearchCoverage | None = None


def _further(search: Search, campaign: CampaignState, values: list[list[Value]]) -> _Further:
    """``values``: those of the cases of closed generations."""
    record = campaign.search
    assert record is not None
    if not record.ended or not record.results or not search.parameters:
        return _Further()
    from conductor.search.answers.case_rows import case_rows
    from conductor.search.answers.domain import search_coverage
    from conductor.search.answers.failure_map import failure_map
    from conductor.search.answers.indices import search_indices
    from conductor.search.driver import Closed

    rows = case_rows(search, Closed(record.u[: len(record.results)], record.results), values)
    name, seed = campaign.campaign.campaign, campaign.campaign.seed
    indices = search_indices(search, name, seed, rows)
    return _Further(indices, failure_map(search, rows, indices), search_coverage(search, rows))


def _boundary(search: Search, campaign: CampaignState) -> SearchBoundary | None:
    record = campaign.search
    assert record is not None
    if sampler_kinds().find(search.sampler).gives != "boundary" or not record.results:
        return None
    from conductor.search.driver import Closed
    from conductor.search.traced import boundary_of

    return boundary_of(search, Closed(record.u[: len(record.results)], record.results))
