"""One step of a search: from closed generations to an answer and the next proposals.

Nothing but the section, the campaign's name and seed, and the results in the order in which cases
were proposed decides a step: neither a clock, nor who was first, nor earlier calls.
"""

from __future__ import annotations

import functools
import importlib.metadata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from msgspec import UNSET, convert

from conductor.search.chains import history_of, mean_of
from conductor.search.protocol import (
    Array,
    Estimate,
    Forker,
    Forks,
    History,
    Problem,
    Sampler,
    Traced,
    TracesBoundary,
)
from conductor.search.space import values_of
from schemas.files.search_result import ChainEstimate, SearchAnswer, SearchCluster
from schemas.identity import stream_key
from schemas.kinds.registry import implementation
from schemas.kinds.sampler import EXTRA, SamplerKind, sampler_kinds
from schemas.sections.fork import Branch
from schemas.sections.search import WITH_TAILS, Objective, Search, Value, name_of

LIBRARIES = ("numpy", "scipy")
"""Those of every search, by the names of their packages."""
REACH = 1.0
"""Distance of a failure from the mildest one of its cluster, in units of the square root of the
number of parameters."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """One generation."""

    u: list[list[float]]
    """Standard normal coordinates [cases][parameters]."""
    values: list[list[Value]]
    """Values of the parameters [cases][parameters]."""
    forks: list[Branch | None] = field(default_factory=list)
    """What each case is a fork of; empty: none is one."""


@dataclass(frozen=True, slots=True)
class SearchStep:
    """What follows from the closed generations."""

    answer: SearchAnswer
    proposal: Proposal | None
    """The next generation, of the chain whose generation closed last; None: the chain, or the
    search, has ended."""
    ended: str
    """Why the search proposes nothing more; empty: it does, or another chain will."""
    estimate: ChainEstimate = field(default_factory=ChainEstimate)
    """What the chain knows, where chains have a mean."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The closed generations in their order: coordinates and KPI of every case."""

    u: Sequence[bytes | Sequence[Sequence[float]]]
    """Per generation as rows, or packed: float64, little-endian, cases by parameters."""
    results: Sequence[Sequence[float | None]]
    chains: Sequence[int] = ()
    """Chain of each; empty: there is one."""
    estimates: Sequence[ChainEstimate] = ()
    """What its chain knew after each but the last, as the steps before said."""
    open: int = 0
    """Generations that are proposed and have not closed."""
    ends: bool = False
    """Whether it was decided before that the search ends: nothing more is proposed."""


def first(search: Search, campaign: str, seed: int, chain: int = 0) -> Proposal:
    """The first generation of a chain.

    Raises:
        ValueError: it cannot be proposed; one line.
    """
    sampler = _sampler(search, chain)
    with _one_thread(search.sampler):
        u = sampler.propose(History([], []), _Streams(campaign, seed, chain))
    if not len(u):
        cases, chains = search.budget.cases, search.chains
        each = f" in each of {chains} chains" if chains > 1 else ""
        raise ValueError(f"{cases} cases are too few for one generation of {search.sampler}{each}")
    return _proposal(search, u)


def follow(search: Search, campaign: str, seed: int, closed: Closed) -> SearchStep:
    """What follows when the last of the closed generations has closed; at least one has.

    Raises:
        ValueError: a library is missing; one line.
    """
    chain = closed.chains[-1] if closed.chains else 0
    sampler = _sampler(search, chain)
    with _one_thread(search.sampler):
        return _follow(search, sampler, _Streams(campaign, seed, chain), closed)


def _follow(search: Search, sampler: Sampler, streams: _Streams, closed: Closed) -> SearchStep:
    objective, whole = search.objective, closed_history(search, closed)
    if objective.missing == "ends" and (name := _first_missing(closed)):
        answer = _answer(search, whole, closed, Estimate(method="none: a value is missing"))
        if closed.ends and None not in closed.results[-1]:
            return SearchStep(answer, None, "")  # it was said before
        why = f"{name} has no {objective.kpi}; see its outcome, retry it, or say in "
        return SearchStep(answer, None, f"{why}search.objective.missing what that means")
    history = history_of(streams.chain, whole, closed.chains)
    estimate, known = _estimate(search, sampler, whole, history, closed)
    answer = _answer(search, whole, closed, estimate)
    settled, proposal, ended = estimate.settled, None, ""
    if closed.ends:
        pass
    elif not settled and _narrow(search, estimate, answer):
        ended = "the interval asked for is reached"
    else:
        u = np.zeros((0, 0)) if settled else sampler.propose(history, streams)
        if len(u) and history.cases + len(u) <= _budget(search):
            proposal = _proposal(search, u)
            if isinstance(sampler, Forker):
                forks = _branches(sampler.forks(history, streams), history)
                proposal = replace(proposal, forks=forks)
        elif not closed.open:  # else other chains go on
            spent = f"the budget of {search.budget.cases} cases is spent"
            ended = "the sampler has its answer" if settled else spent
    return SearchStep(answer, proposal, ended, known)


def _branches(forks: Forks, history: History) -> list[Branch | None]:
    """Forks by the names of the cases that they are of; a sampler that forks has one chain."""
    names = case_names(history)
    pairs = zip(forks.parents.tolist(), forks.margins.tolist(), strict=True)
    branches = [Branch(names[parent], margin) if parent >= 0 else None for parent, margin in pairs]
    return branches if any(branches) else []


def _estimate(
    search: Search, sampler: Sampler, whole: History, history: History, closed: Closed
) -> tuple[Estimate, ChainEstimate]:
    """What all chains know, settled if the chain of ``history`` is; and what it knows itself."""
    if search.chains == 1 or sampler_kind(search).chains != "mean":
        return sampler.answer(whole), ChainEstimate()
    one = sampler.answer(history)
    known = ChainEstimate(one.method, one.probability, one.low, one.high)
    latest = dict(zip(closed.chains, [*closed.estimates, known], strict=True))
    return replace(mean_of(search.chains, list(latest.values())), settled=one.settled), known


def _no_impact(_: str) -> float:
    return 0.0


def clusters(
    search: Search, closed: Closed, impact_mps: Callable[[str], float] = _no_impact
) -> list[SearchCluster]:
    """The failures by cluster, the largest cluster first.

    From the mildest failure to the worst, each joins the cluster whose mildest failure is nearest,
    if it is near enough, or begins one. Of failures with equal KPIs, as all collisions have by
    their distance, the slower impact is milder; of equal ones the case that was proposed first.

    Args:
        search: the section.
        closed: its closed generations.
        impact_mps: impact speed of a case by its name [m/s]; 0: it had no impact.
    """
    history = closed_history(search, closed)
    if not history.g:
        return []
    names = case_names(history)
    g, u = np.concatenate(history.g), np.concatenate(history.u)
    kpis = [value for results in closed.results for value in results]
    failed = [i for i in range(len(g)) if g[i] < 0 and kpis[i] is not None]
    failed.sort(key=lambda i: (-g[i], impact_mps(names[i])))
    reach = REACH * float(np.sqrt(u.shape[1]))
    groups: list[list[int]] = []
    for index in failed:
        apart = [float(np.sqrt(np.sum((u[index] - u[group[0]]) ** 2))) for group in groups]
        nearest = int(np.argmin(apart)) if apart else -1
        if nearest >= 0 and apart[nearest] <= reach:
            groups[nearest].append(index)
        else:
            groups.append([index])
    groups.sort(key=lambda group: (-len(group), group[0]))
    values = values_of(search, u)
    return [
        SearchCluster(
            mildest=names[group[0]],
            kpi=float(kpis[group[0]] or 0.0),
            values=values[group[0]],
            cases=[names[index] for index in group],
        )
        for group in groups
    ]


def traced(search: Search, closed: Closed) -> Traced | None:
    """The boundary that the sampler knows after the closed generations; None: it traces none."""
    sampler = _sampler(search, 0)
    return (
        sampler.trace(closed_history(search, closed))
        if isinstance(sampler, TracesBoundary)
        else None
    )


def case_names(history: History) -> list[str]:
    """The names of all cases of closed generations, in the order in which they were proposed."""
    return [name_of(i, j) for i, g in enumerate(history.g) for j in range(len(g))]


def load(search: Search) -> None:
    """Load what the sampler of a search needs.

    Raises:
        ValueError: a library is missing; one line.
    """
    _sampler(search, 0)
    _libraries(search.sampler)


@functools.cache
def versions(sampler: str) -> dict[str, str]:
    """Versions of the libraries by which a sampler proposes, whatever else is loaded."""
    names = (*LIBRARIES, *sampler_kinds().find(sampler).libraries)
    return {name: importlib.metadata.version(name) for name in names}


def sampler_kind(search: Search) -> SamplerKind:
    """The declaration of the sampler of a search."""
    return sampler_kinds().find(search.sampler)


class _Streams:
    """Random numbers of a chain by name, keyed as those of cases are."""

    def __init__(self, campaign: str, seed: int, chain: int) -> None:
        self._campaign, self._seed, self.chain = campaign, seed, chain

    def __call__(self, name: str) -> np.random.Generator:
        name = f"chain {self.chain}/{name}" if self.chain else name
        key = stream_key(self._seed, self._campaign, f"search/{name}")
        return np.random.Generator(np.random.Philox(key=[key, 0]))


def _sampler(search: Search, chain: int) -> Sampler:
    kind = sampler_kind(search)
    try:
        made: Any = implementation(kind.implementation)
    except ValueError as error:
        raise ValueError(f"sampler {kind.name}: {error}; {EXTRA}") from None
    budget = search.budget
    problem = Problem(
        dimension=len(search.parameters),
        names=list(search.parameters),
        tails=[isinstance(d, WITH_TAILS) for d in search.parameters.values()],
        cases=_budget(search),
        generation=budget.generation,
        repeats=budget.half_width is not UNSET or budget.relative_half_width is not UNSET,
        chain=chain,
    )
    sampler: Sampler = made(convert(search.options, kind.options), problem)
    return sampler


def _budget(search: Search) -> int:
    """Most cases of one chain."""
    return search.budget.cases // search.chains


def _proposal(search: Search, u: Array) -> Proposal:
    assert np.all(np.isfinite(u)), "a sampler proposed a point that is not finite"
    return Proposal(u.tolist(), values_of(search, u))


def _first_missing(closed: Closed) -> str:
    for generation, results in enumerate(closed.results):
        if None in results:
            return name_of(generation, results.index(None))
    return ""


def closed_history(search: Search, closed: Closed) -> History:
    """The closed generations as samplers see them."""
    dimension = len(search.parameters)
    return History(
        [
            _rows(rows).reshape(len(results), dimension)
            for rows, results in zip(closed.u, closed.results, strict=True)
        ],
        [_margins(search.objective, results) for results in closed.results],
    )


def _rows(u: bytes | Sequence[Sequence[float]]) -> Array:
    return np.frombuffer(u, "<f8") if isinstance(u, bytes) else np.array(u, np.float64)


def _margins(objective: Objective, results: Sequence[float | None]) -> Array:
    """Margins of a generation: below 0 is a failure; a missing value is as bad, or as good, as the
    worst or the best of the others."""
    kpis = np.array(results, np.float64)  # None becomes NaN
    if objective.fails_below is not UNSET:
        g = kpis - objective.fails_below
    elif objective.fails_above is not UNSET:
        g = objective.fails_above - kpis
    else:
        g = kpis if objective.goal == "least" else -kpis
    known = g[~np.isnan(g)]
    if objective.missing == "fails":
        stand_in = min(-1.0, float(np.min(known, initial=0.0)))
    else:
        stand_in = max(1.0, float(np.max(known, initial=0.0)))
    return np.where(np.isnan(g), stand_in, g)


def _answer(search: Search, history: History, closed: Closed, estimate: Estimate) -> SearchAnswer:
    g = np.concatenate(history.g)
    kpis = np.concatenate([np.array(results, np.float64) for results in closed.results])
    defined = search.objective.goal is UNSET
    known = ~np.isnan(kpis)
    best: float | None = None
    best_case = ""
    if np.any(known):
        place = int(np.argmin(np.where(known, g, np.inf)))
        begins = np.cumsum([0, *map(len, history.g)])
        generation = int(np.searchsorted(begins, place, side="right")) - 1
        best = float(kpis[place])
        best_case = name_of(generation, place - int(begins[generation]))
    return SearchAnswer(
        method=estimate.method,
        cases=len(g),
        failures=int(np.count_nonzero(g < 0)) if defined else 0,
        missing=int(np.count_nonzero(~known)),
        probability=estimate.probability,
        low=estimate.low,
        high=estimate.high,
        best=best,
        best_case=best_case,
    )


def _narrow(search: Search, estimate: Estimate, answer: SearchAnswer) -> bool:
    """Whether the interval is as narrow as was asked for; without a failure none is."""
    if estimate.probability is None or estimate.low is None or estimate.high is None:
        return False
    half, budget = (estimate.high - estimate.low) / 2, search.budget
    if budget.half_width is not UNSET and half <= budget.half_width:
        return True
    if budget.relative_half_width is UNSET or not answer.failures:
        return False
    return half <= budget.relative_half_width * estimate.probability


def _one_thread(sampler: str) -> Any:
    """Linear algebra on one thread: sums over threads end in other bits. Call it when what
    ``sampler`` needs is loaded."""
    return _libraries(sampler).limit(limits=1)


@functools.cache
def _libraries(_sampler: str) -> Any:
    """The libraries with threads that are loaded; looking for them takes 30 ms."""
    try:
        from threadpoolctl import ThreadpoolController
    except ImportError as error:
        raise ValueError(f"a search needs further libraries ({error}); {EXTRA}") from None
    return ThreadpoolController()
