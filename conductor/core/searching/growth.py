"""A search in a conductor: when a generation has closed, the next one of its chain is proposed.

The request that ends the last case of a generation also brings the fact of the next one, so both
are on disk together, before a case of it is leased. After a restart generations are read from
facts, and never proposed again. Generations close in the order in which they were proposed: one
whose cases have all ended waits for those before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec
from msgspec import UNSET

from conductor.core.case_table import pack
from conductor.core.facts import CaseEnded, Committed, Generation
from conductor.core.searching.record import packed
from conductor.core.state import CampaignState, CaseState
from conductor.core.turn import RequestTurn
from schemas.case import Case
from schemas.escape import escape
from schemas.files.search_result import SearchAnswer
from schemas.identity import grown_digest
from schemas.plan import Plan
from schemas.points import points_of
from schemas.searching.search_points import with_forks
from schemas.sections.search import Rows, Search, text_of

if TYPE_CHECKING:
    from conductor.search.driver import Proposal

WHY_CHARS_MAX = 500
"""Longest reason why a search ended that is kept [characters]."""


def grow(turn: RequestTurn) -> None:
    """Close the generations of every search whose cases have ended, and propose what follows."""
    for name in list(turn.state.searches):
        campaign = turn.state.campaigns[name]
        while name in turn.state.searches and _over(campaign):
            turn.emit(next_generation(campaign, turn.state.config.cpu))


def _over(campaign: CampaignState) -> bool:
    """Whether all cases of the oldest open generation have ended; the last ones are leased last."""
    record = campaign.search
    assert record is not None
    size = record.sizes[len(record.results)]
    begin, ordered = record.closed, campaign.ordered
    return all(ordered[place].ended for place in range(begin + size - 1, begin - 1, -1))


def next_generation(campaign: CampaignState, cpu: str) -> Generation:
    """The fact that follows when all cases of the oldest open generation have ended."""
    # Late: only who searches has the libraries, and waits for them.
    from conductor.search.driver import Closed, follow, versions

    search, record = campaign.campaign.search, campaign.search
    assert search is not UNSET
    assert record is not None
    closes = len(record.results)
    latest = campaign.ordered[record.closed : record.closed + record.sizes[closes]]
    results = [_kpi(case, search.objective.kpi) for case in latest]
    name, number = campaign.campaign.campaign, len(record.u)
    fact = Generation(campaign=name, number=number, results=results, digest=campaign.digest)
    fact = msgspec.structs.replace(fact, versions=versions(search.sampler), cpu=cpu)
    replace = msgspec.structs.replace
    if any(isinstance(case.end, CaseEnded) and _cancelled(case) for case in latest):
        why = "a case of its latest generation was cancelled"
        return replace(fact, answer=_nothing(record.answers, len(campaign.ordered)), ended=why)
    try:
        closed = Closed(
            record.u[: closes + 1],
            [*record.results, results],
            record.chains[: closes + 1],
            record.estimates,
            open=record.open - 1,
            ends=bool(record.ended),
        )
        step = follow(search, name, campaign.campaign.seed, closed)
    except Exception as error:  # a sampler may be anybody's: its search ends, and no other
        why = escape(f"its sampler failed: {type(error).__name__}: {error}", WHY_CHARS_MAX)
        return replace(fact, answer=_nothing(record.answers, len(campaign.ordered)), ended=why)
    fact = replace(fact, answer=step.answer, estimate=step.estimate)
    fact = replace(fact, ended=escape(step.ended, WHY_CHARS_MAX))
    if step.proposal is None:
        return fact
    cases, mistake = _cases(campaign, search, number, step.proposal)
    if mistake:
        return replace(fact, ended=f"a proposed case is not allowed: {mistake}")
    return replace(
        fact,
        u=packed(step.proposal.u),
        values=text_of(step.proposal.values),
        forks=step.proposal.forks,
        cases=pack(cases),
        digest=grown_digest(campaign.digest, cases),
    )


def _cases(
    campaign: CampaignState, search: Search, number: int, proposal: Proposal
) -> tuple[list[Case], str]:
    """The cases of a generation; or none, and what is wrong with one of them in a line."""
    proposed: list[Rows] = [[] for _ in range(number)]
    alone = msgspec.structs.replace(search, proposed=[*proposed, proposal.values])
    if proposal.forks:
        alone = msgspec.structs.replace(alone, forks=with_forks(search, number, proposal.forks))
    whole = msgspec.structs.replace(campaign.campaign, search=alone)
    points, mistakes = points_of(whole)
    if mistakes:
        return [], mistakes[0].line(campaign.campaign.campaign)[:WHY_CHARS_MAX]
    return Plan(whole, points).cases, ""


def _kpi(case: CaseState, name: str) -> float | None:
    """The KPI of a case that has ended; None: it has none."""
    end = case.end
    if not isinstance(end, Committed) or end.result.outcome != "verdict":
        return None
    value = end.result.scalars.get(name)
    return float(value) if value is not None and math.isfinite(value) else None


def _cancelled(case: CaseState) -> bool:
    return isinstance(case.end, CaseEnded) and case.end.outcome == "cancelled"


def _nothing(answers: Sequence[SearchAnswer], cases: int) -> SearchAnswer:
    """The answer of a search that was ended: what was known before."""
    if answers:
        return answers[-1]
    return SearchAnswer(method="none", cases=cases, failures=0, missing=0)
