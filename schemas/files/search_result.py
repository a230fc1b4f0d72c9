"""``search.json``: everything that a search proposed, what came of it, and its answer."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from schemas.sections.fork import Branch
from schemas.sections.search import Value

FILE_NAME = "search.json"


class SearchAnswer(Struct, frozen=True, kw_only=True):
    """What is known after the closed generations."""

    method: str
    """How probability and interval were obtained, in words."""
    cases: int
    """Cases that it is about."""
    failures: int
    """Cases that failed among those that were proposed; no probability."""
    missing: int
    """Cases without the KPI."""
    probability: float | None = None
    """Probability of failure; None: none yet, or the sampler gives none."""
    low: float | None = None
    """Lower end of its 95 % interval."""
    high: float | None = None
    best: float | None = None
    """Worst value of the KPI, which the search looks for; None: no case had one."""
    best_case: str = ""

    def line(self) -> str:
        """The answer in a line."""
        parts = []
        if self.probability is not None:
            parts.append(f"probability of failure {self.probability:.3g}")
        if self.low is not None and self.high is not None:
            parts.append(f"95 % interval {self.low:.3g} to {self.high:.3g}")
        parts.append(f"{self.failures} of {self.cases} proposed cases failed")
        if self.best is not None:
            parts.append(f"worst {self.best:.4g} in {self.best_case}")
        return ", ".join(parts)


class ChainEstimate(Struct, frozen=True, array_like=True):
    """What one of several chains knows after a generation of it has closed."""

    method: str = ""
    probability: float | None = None
    low: float | None = None
    high: float | None = None


class SearchCluster(Struct, frozen=True, kw_only=True):
    """Failures that lie beside each other."""

    mildest: str
    """The case whose KPI is nearest to the limit; of equal ones the slowest impact."""
    kpi: float
    """Its KPI."""
    values: list[Value]
    """Its parameters."""
    cases: list[str]
    """All of them, the mildest first."""


class SearchGeneration(Struct, frozen=True, kw_only=True):
    """One generation."""

    cases: list[str]
    values: list[list[Value]]
    """Parameters [cases][parameters]."""
    u: list[list[float]]
    """Standard normal coordinates behind them."""
    results: list[float | None]
    """KPI per case; None: missing. Empty: the generation runs."""
    forks: list[Branch | None] = []
    """Per case the case that it is a fork of, and the margin below which the other's had fallen
    there; empty: none is one."""
    answer: SearchAnswer | None = None
    """What was known when it had closed, by all that had closed before."""
    chain: int = 0
    """The chain that proposed it."""


class SensitivityIndex(Struct, frozen=True, kw_only=True):
    """How much of a variance is due to one parameter, as a share of it, with 95 % intervals."""

    parameter: str
    first: float
    """Share that goes when the parameter alone is fixed."""
    first_low: float
    first_high: float
    total: float | None = None
    """Share that stays when all other parameters are fixed; None: not known."""
    total_low: float | None = None
    total_high: float | None = None


class SearchIndices(Struct, frozen=True, kw_only=True):
    """Which parameters matter."""

    method: str
    """How the indices and their intervals were obtained, in words."""
    cases: int
    """Cases that they were taken from."""
    kpi: list[SensitivityIndex]
    """For the KPI's value, a parameter each; empty: it never varied."""
    failure: list[SensitivityIndex]
    """For whether a case fails; empty: no limit, or fewer than ten cases that fail or that hold."""


class FailureMap(Struct, frozen=True, kw_only=True):
    """Where cases fail, in the two parameters that matter most."""

    parameters: list[str]
    """Those of x and y."""
    method: str
    """How the shares were obtained, in words."""
    x: list[float]
    """Values of the first [points]."""
    y: list[float]
    """Values of the second [points]."""
    share: list[list[float | None]]
    """Share of failures [points of y][points of x]; None: no case is near."""


class CoveredParameter(Struct, frozen=True, kw_only=True):
    """Which values of one parameter were tried."""

    parameter: str
    cells: list[str]
    """Cells of its values, in words."""
    weights: list[float]
    """Probability of each."""
    cases: list[int]
    """Cases in each."""


class CoveredPair(Struct, frozen=True, kw_only=True):
    """Which values of two parameters were tried together."""

    parameters: list[str]
    possible: int
    """Cells that are possible at all."""
    tried: int
    """Cells of these with a case."""
    untried: float
    """Probability of those without one, all together."""
    weights: list[list[float]]
    """Probability [cells of the first][cells of the second]."""
    cases: list[list[int]]
    """Cases in each."""


class UntriedCell(Struct, frozen=True, kw_only=True):
    """Values of one or two parameters that were never tried."""

    parameters: list[str]
    cells: list[str]
    weight: float
    """Its probability."""


class SearchCoverage(Struct, frozen=True, kw_only=True):
    """How much of the declared operational domain was tried, by parameters and pairs of them."""

    cases: int
    parameters: list[CoveredParameter]
    pairs: list[CoveredPair]
    """Those with the most untried first."""
    untried: list[UntriedCell]
    """The largest cells without a case; a pair's only where each of the two was tried."""


class BoundaryPoint(Struct, frozen=True, kw_only=True):
    """A point of a boundary between cases that hold and cases that fail."""

    at: list[float]
    """x and y, where the boundary is likely if margins are linear in between."""
    holds: str
    """The nearest case that holds."""
    holds_at: list[float]
    """Its x and y."""
    fails: str
    """The nearest case that fails."""
    fails_at: list[float]
    width: float
    """Distance between the two, as a share of the plane's side."""


class SearchBoundary(Struct, frozen=True, kw_only=True):
    """A boundary in the plane of two parameters."""

    x: str
    """The one parameter."""
    y: str
    fixed: dict[str, Value]
    """All other parameters, at their medians."""
    points: list[BoundaryPoint]
    lines: list[list[int]]
    """Points by number along each part of the boundary; a closed part ends where it began."""


class SearchFile(Struct, frozen=True, kw_only=True):
    """Content of ``search.json``."""

    schema: int = 1
    campaign: str
    sampler: str
    title: str
    """The sampler's name in sentences."""
    kpi: str
    formula: str = ""
    """Formula whose margin the KPI is; empty: it is a KPI of its own."""
    fails_below: float | None = None
    fails_above: float | None = None
    chains: int = 1
    """Searches side by side."""
    parameters: list[str]
    ended: str
    """Why it ended; empty: it runs."""
    answer: SearchAnswer | None
    clusters: list[SearchCluster]
    """Failures by cluster, the largest first."""
    indices: SearchIndices | None = None
    """Which parameters matter; None: it has not ended, or has too few cases."""
    failure_map: FailureMap | None = None
    """Where cases fail; None: too few fail or hold, or too few parameters are numbers."""
    coverage: SearchCoverage | None = None
    """What was tried of the domain, and what never; None: it has not ended."""
    boundary: SearchBoundary | None = None
    """Boundary that it traced; None: it traces none, or no point is known yet."""
    versions: dict[str, str]
    """Libraries that proposed."""
    cpus: list[str]
    """Classes of the processors that proposed; more than one: it went on on another."""
    generations: list[SearchGeneration]

    def closed(self) -> Iterator[tuple[str, list[Value], float | None]]:
        """Name, values and KPI of every case that has come to an end, in the order of proposals."""
        for generation in self.generations:
            yield from zip(generation.cases, generation.values, generation.results, strict=False)

    def fails(self, kpi: float | None) -> bool:
        """Whether a value of the KPI is a failure; a missing one is none."""
        if kpi is None:
            return False
        if self.fails_below is not None:
            return kpi < self.fails_below
        return self.fails_above is not None and kpi > self.fails_above
