"""The section ``search`` of a campaign: parameters with distributions, an objective, a budget.

The cases of a search are proposed by a sampler (:mod:`schemas.kinds.sampler`), a generation at a
time; :mod:`schemas.searching.search_points` says what is wrong with a section.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec.structs import force_setattr

from schemas.kinds.kpis.formula import ROBUSTNESS
from schemas.sections.fork import Branch

SEARCH_CASES_MAX = 100_000
"""Most cases of a search."""
GENERATION_CASES_MAX = 5000
"""Most cases of one generation."""
PARAMETERS_MAX = 40
"""Most parameters of a search."""
CHAINS_MAX = 64
"""Most chains of a search."""
CHOICES_MAX = 1000
"""Most values that a parameter chooses from."""

CELLS_MAX = 32
"""Most cells of a parameter in the declared operational domain."""

Value = bool | int | float | str
Rows = str | list[list[Value]]
"""Values of a generation's parameters [cases][parameters], or the same as JSON: a hundred thousand
rows take a tenth of the memory so."""
Positive = Annotated[float, Meta(gt=0)]


class _Distribution(
    Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="distribution"
):
    """Base of the distributions of a parameter."""


class Uniform(_Distribution, frozen=True, kw_only=True, tag="uniform"):
    """Every value of a range is as likely as any other."""

    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    whole: bool = False
    """Rounded to a whole number."""


class Normal(_Distribution, frozen=True, kw_only=True, tag="normal"):
    """The bell curve."""

    mean: float
    """Mean."""
    sd: Positive
    """Standard deviation."""
    whole: bool = False
    """Rounded to a whole number."""


class TruncatedNormal(_Distribution, frozen=True, kw_only=True, tag="truncated_normal"):
    """The bell curve between two limits."""

    mean: float
    """Mean."""
    sd: Positive
    """Standard deviation before it is cut."""
    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    whole: bool = False
    """Rounded to a whole number."""


class LogNormal(_Distribution, frozen=True, kw_only=True, tag="lognormal"):
    """The logarithm of the value is normal."""

    median: Positive
    """Median."""
    sigma: Positive
    """Standard deviation of the logarithm."""
    whole: bool = False
    """Rounded to a whole number."""


class Exponential(_Distribution, frozen=True, kw_only=True, tag="exponential"):
    """Waiting times: ``low`` and what an exponential distribution adds."""

    mean: Positive
    """Mean of what is added."""
    low: float = 0.0
    """Smallest value."""
    whole: bool = False
    """Rounded to a whole number."""


class Triangular(_Distribution, frozen=True, kw_only=True, tag="triangular"):
    """Straight up from ``low`` to ``mode``, straight down to ``high``."""

    low: float
    """Smallest value."""
    mode: float
    """Likeliest value."""
    high: float
    """Largest value."""
    whole: bool = False
    """Rounded to a whole number."""


class Integers(_Distribution, frozen=True, kw_only=True, tag="integers"):
    """Every whole number of a range, both ends included, is as likely as any other."""

    low: int
    """Smallest value."""
    high: int
    """Largest value."""


class Choices(_Distribution, frozen=True, kw_only=True, tag="choices"):
    """One of a list of values."""

    values: Annotated[list[Value], Meta(min_length=1, max_length=CHOICES_MAX)]
    """Values."""
    weights: list[Annotated[float, Meta(ge=0)]] = []
    """How likely each is, in any unit; empty: all the same."""


Distribution = (
    Uniform | Normal | TruncatedNormal | LogNormal | Exponential | Triangular | Integers | Choices
)


WITH_TAILS = (Normal, TruncatedNormal, LogNormal, Exponential)
"""Distributions that thin out towards their ends."""


class _Part(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of the other parts of the section."""


class Correlation(_Part, frozen=True, kw_only=True):
    """Two parameters that depend on each other, by a Gaussian copula."""

    between: list[str]
    """The two axes."""
    rho: Annotated[float, Meta(gt=-1, lt=1)]
    """Correlation of the two normal variables behind them."""


class Objective(_Part, frozen=True, kw_only=True):
    """The KPI that is searched, and which of its values are failures; or a formula, whose margin
    is that KPI then."""

    kpi: str = ""
    """A scalar of the scenario, such as ``dtc_min_m``."""
    formula: str | UnsetType = UNSET
    """A condition over the columns of a case in signal temporal logic, such as
    ``always (ttc_s > 1.0 or speed_mps < 0.5)``; a case fails if its margin is below 0."""
    fails_below: float | UnsetType = UNSET
    """Smaller values are failures."""
    fails_above: float | UnsetType = UNSET
    """Larger values are failures."""
    goal: Literal["least", "most"] | UnsetType = UNSET
    """Extreme that is looked for where no failure is defined."""
    missing: Literal["ends", "fails", "holds"] = "ends"
    """Meaning of a case without the KPI: the search ends there, the case is a failure, or it is
    none."""

    def __post_init__(self) -> None:
        """With a formula, the KPI is its margin, and failures are below 0."""
        if self.formula is not UNSET and not self.kpi:
            force_setattr(self, "kpi", ROBUSTNESS)
        if self.formula is not UNSET and self.fails_below is UNSET:
            force_setattr(self, "fails_below", 0.0)


class SearchBudget(_Part, frozen=True, kw_only=True):
    """When a search ends."""

    cases: Annotated[int, Meta(ge=1, le=SEARCH_CASES_MAX)]
    """Most cases."""
    generation: Annotated[int, Meta(ge=1, le=GENERATION_CASES_MAX)] = 50
    """Cases of one generation, all of which end before the next of its chain is proposed."""
    half_width: Positive | UnsetType = UNSET
    """The search ends when half of the 95 % interval is no wider than this."""
    relative_half_width: Positive | UnsetType = UNSET
    """The same as a share of the probability."""


class DomainCells(_Part, frozen=True, kw_only=True):
    """Cells into which the values of a parameter are divided to see which were tried."""

    bins: Annotated[int, Meta(ge=2, le=CELLS_MAX)] | UnsetType = UNSET
    """Number of cells of equal width."""
    edges: Annotated[list[float], Meta(min_length=1, max_length=CELLS_MAX - 1)] | UnsetType = UNSET
    """Values between the cells, ascending: one more cell than edges."""


class Search(_Part, frozen=True, kw_only=True):
    """A search for failures, or for their probability."""

    parameters: Annotated[dict[str, Distribution], Meta(max_length=PARAMETERS_MAX)]
    """Axis -> distribution; the axes of a matrix."""
    correlations: list[Correlation] = []
    objective: Objective
    budget: SearchBudget
    sampler: str = "monte_carlo"
    """What proposes the cases, see `docs/search.md`."""
    chains: Annotated[int, Meta(ge=1, le=CHAINS_MAX)] = 1
    """Searches side by side, each with random numbers and a share of the budget of its own, so that
    workers do not wait for the last cases of a generation."""
    options: dict[str, bool | int | float | str] = {}
    """Options of the sampler."""
    domain: dict[str, DomainCells] | UnsetType = UNSET
    """Axis -> cells of the declared operational domain; others have eight of equal width, and
    `choices` one for each value."""
    first: list[list[float]] = []
    """Standard normal coordinates of the cases of every chain's first generation, in the order of
    `proposed`; filled in at submission."""
    proposed: list[Rows] = []
    """Generation -> case -> values of the parameters, a generation also as JSON text; filled in at
    submission and as it runs. The file of a run names `proposed.jsonl` here, which has them."""
    forks: list[list[Branch | None]] | UnsetType = UNSET
    """Generation -> case -> what it is a fork of, of generations with forks; filled in as it
    runs."""
    chosen: list[str] = []
    """Cases of `proposed` that are run again by name; nothing is searched then."""


def rows_of(rows: Rows) -> list[list[Value]]:
    """The values of a generation.

    Raises:
        ValueError: they are text and no JSON of rows.
    """
    if not isinstance(rows, str):
        return rows
    try:
        return _decoder.decode(rows)
    except msgspec.MsgspecError as error:
        raise ValueError(f"no rows of values: {error}") from None


_decoder = msgspec.json.Decoder(list[list[Value]])


def text_of(rows: Rows) -> str:
    """The values of a generation as JSON on one line."""
    return rows if isinstance(rows, str) else msgspec.json.encode(rows).decode()


def name_of(generation: int, number: int) -> str:
    """The name of a case: ``g0003-0017``."""
    return f"g{generation:04d}-{number:04d}"


def place_of(name: str) -> tuple[int, int]:
    """Generation and number of the case that :func:`name_of` gives a name.

    Raises:
        ValueError: it gives nobody this name.
    """
    generation, _, number = name.removeprefix("g").partition("-")
    place = int(generation), int(number)
    if name_of(*place) != name or min(place) < 0:
        raise ValueError(f"no name of a proposed case: {name}")
    return place
