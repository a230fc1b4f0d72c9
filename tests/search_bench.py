"""A search on closed forms: campaigns, simulated workers with delays, and the trace."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable
from typing import Any

import msgspec
from conductor_bench import CONFIG, Bench, hello, result

from conductor.core.facts import Fact, is_durable
from conductor.core.fold import fold
from conductor.core.invariants import check
from conductor.core.state import Config, State
from conductor.records.search import encode_search
from conductor.search.driver import Closed, first, follow
from schemas import SCHEMA_VERSION as V
from schemas.campaign import Campaign
from schemas.files.search_result import ChainEstimate, SearchAnswer
from schemas.plan import examine
from schemas.sections.search import Search
from schemas.wire.control import Lease, Result, Submit

NAMES = ("objects.a.start_s", "objects.a.offset_m")
"""Parameters of the campaign, which stand for the coordinates of a closed form."""
KPI = "dtc_min_m"

LimitState = Callable[[list[float]], float]
"""Coordinates -> margin, below 0 where a case fails."""


def plane(values: list[float]) -> float:
    """A plane at distance 1.5: the probability of failure is 0.0668."""
    return 1.5 - sum(values) / math.sqrt(len(values))


def section(sampler: str = "monte_carlo", **changes: Any) -> dict[str, Any]:
    """The section of a search with standard normal parameters."""
    budget = {"cases": 30, "generation": 10, **changes.pop("budget", {})}
    return {
        "parameters": {name: {"distribution": "normal", "mean": 0.0, "sd": 1.0} for name in NAMES},
        "objective": {"kpi": KPI, "fails_below": 0.0},
        "budget": budget,
        "sampler": sampler,
        **changes,
    }


def content(search: dict[str, Any], name: str = "searched", **fields: Any) -> dict[str, Any]:
    """A campaign that searches, as a client submits it: with its first generation."""
    data = {"campaign": name, "seed": 5, "matrix": {"weather": ["clear"]}, "search": search}
    data |= fields
    plan, mistakes = examine(data)
    assert not mistakes, mistakes[0].line(name)
    assert plan is not None
    campaign: Campaign = plan.campaign
    asked = campaign.search
    begun = [first(asked, name, campaign.seed, chain) for chain in range(asked.chains)]
    proposed = {
        "first": [row for proposal in begun for row in proposal.u],
        "proposed": [proposal.values for proposal in begun],
    }
    return {**data, "search": {**search, **proposed}}


def submission(search: dict[str, Any], **fields: Any) -> Submit:
    """The request that begins a search."""
    return Submit(v=V, campaign=content(search, **fields))


def measured(lease: Lease, form: LimitState) -> Result:
    """The result of a case whose KPI is a closed form of its parameters."""
    varied = lease.case.variation.objects["a"]
    assert varied.start_s is not None
    return result(lease, scalars={KPI: form([varied.start_s, varied.offset_m])})


class Unchecked(Bench):
    """A bench that looks at its invariants at the end alone: hundreds of requests are made."""

    def _keep(self, facts: list[Fact]) -> None:
        self.journal += [fact for fact in facts if is_durable(fact)]

    def verify(self) -> None:
        """Invariants, and whether the journal gives the same state."""
        check(self.state)
        assert fold(self.journal, self.config) == self.state


class Crew:
    """Workers that take simulated times for their cases, so that results come in any order."""

    def __init__(
        self, bench: Bench, workers: int, slots: int, seed: int, form: LimitState = plane
    ) -> None:
        self.bench, self.form, self.slots = bench, form, slots
        self.names = [f"w{seed}-{index}" for index in range(workers)]
        self._random = random.Random(seed)
        self._held: dict[str, list[tuple[float, int, Lease]]] = {}
        for name in self.names:
            bench.ask(hello(name, slots=slots))
            self._held[name] = []

    def work(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Until nothing is left, or ``stop`` says so after a request."""
        time_s, clock = 0.0, [(0.0, name) for name in self.names]
        heapq.heapify(clock)
        while self.bench.state.left and not stop():
            time_s, name = heapq.heappop(clock)
            held = self._held[name]
            done = [entry for entry in held if entry[0] <= time_s]
            self._random.shuffle(done)
            held[:] = [entry for entry in held if entry[0] > time_s]
            reply = self.bench.next(
                name,
                k=self.slots - len(held),
                results=[measured(lease, self.form) for _, _, lease in done],
                held=[lease.token for _, _, lease in held],
            )
            assert not reply.error, reply.error
            for lease in reply.leases:
                took_s = self._random.expovariate(1.0)
                held.append((time_s + took_s, lease.token, lease))
            after_s = min((entry[0] for entry in held), default=time_s + 0.1)
            heapq.heappush(clock, (after_s, name))


def searched(
    search: dict[str, Any],
    *,
    workers: int = 1,
    slots: int = 1,
    seed: int = 0,
    form: LimitState = plane,
    config: Config = CONFIG,
    out: str = "",
) -> Bench:
    """A search that was run to its end."""
    bench = Unchecked(config)
    reply = bench.ask(msgspec.structs.replace(submission(search), out=out))
    assert not reply.error, reply.error
    Crew(bench, workers, slots, seed, form).work()
    bench.verify()
    return bench


def trace(state: State, name: str = "searched") -> bytes:
    """Everything that was proposed, what came of it, and every answer."""
    return encode_search(state.campaigns[name])


def four_branches(values: list[float]) -> float:
    """The series system of four branches; the probability of failure is 0.00446."""
    a, b = values
    root = math.sqrt(2.0)
    bowl = 3.0 + 0.1 * (a - b) ** 2
    return min(bowl - (a + b) / root, bowl + (a + b) / root, a - b + 6 / root, b - a + 6 / root)


def sphere(radius: float) -> LimitState:
    """Failures outside of a sphere around the origin."""
    return lambda values: radius - math.sqrt(sum(value * value for value in values))


def tilted(distance: float) -> LimitState:
    """A plane at any distance from the origin, tilted against all axes."""
    return lambda values: distance - sum(values) / math.sqrt(len(values))


def solve(search: dict[str, Any], seed: int, form: LimitState) -> SearchAnswer:
    """The answer of a search on a closed form, by its driver alone: no conductor, no cases."""
    section = msgspec.convert(search, Search)
    chains = list(range(section.chains))
    u = [first(section, "solved", seed, chain).u for chain in chains]
    results: list[list[float | None]] = []
    estimates: list[ChainEstimate] = []
    ended = ""
    while True:
        results.append([form(row) for row in u[len(results)]])
        closed = len(results)
        known = Closed(
            u[:closed],
            results,
            chains[:closed],
            estimates,
            open=len(u) - closed,
            ends=bool(ended),
        )
        step = follow(section, "solved", seed, known)
        ended = ended or step.ended
        estimates.append(step.estimate)
        if step.proposal is not None:
            u.append(step.proposal.u)
            chains.append(chains[closed - 1])
        if len(u) == closed:
            return step.answer


def normal_section(dimension: int, sampler: str, **changes: Any) -> dict[str, Any]:
    """The section of a search in so many standard normal parameters."""
    normal = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    names = [f"objects.o{index}.start_s" for index in range(dimension)]
    return section(sampler, parameters=dict.fromkeys(names, normal), **changes)
