"""The table of samplers: what proposes the cases of a search, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.boundary import BoundaryOptions
from schemas.kinds.registry import Kinds, read_kinds
from schemas.sections.search import SEARCH_CASES_MAX

GROUP = "drivetwin.samplers"
"""Entry points that bring samplers."""

PROCESS_CASES_MAX = 500
"""Most cases of a search by a Gaussian process, whose effort grows with their third power."""

EXTRA = "pip install 'drivetwin[search]'"
"""What brings the libraries of the samplers."""

OURS = {"shipped": "schemas.kinds.sampler:KINDS"}
"""Samplers that are shipped; the same as in pyproject.toml."""


class _Options(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of the options of samplers."""


class NoOptions(_Options, frozen=True, kw_only=True):
    """A sampler without options."""


class SubsetOptions(_Options, frozen=True, kw_only=True):
    """Options of subset simulation."""

    level: Annotated[int, Meta(ge=20, le=5000)] = 500
    """Cases of one level."""
    share: Annotated[float, Meta(ge=0.05, le=0.5)] = 0.1
    """Share of a level from which the next one starts; its inverse is a whole number."""
    keep: Annotated[float, Meta(ge=0.0, le=0.99)] = 0.8
    """Correlation of a step of a chain with the one before."""


class ImportanceOptions(_Options, frozen=True, kw_only=True):
    """Options of cross-entropy importance sampling."""

    share: Annotated[float, Meta(ge=0.02, le=0.5)] = 0.1
    """Share of a generation that the next density is fitted to."""
    modes: Annotated[int, Meta(ge=1, le=16)] = 8
    """Normal densities of the mixture that is fitted."""


class SplittingOptions(_Options, frozen=True, kw_only=True):
    """Options of multilevel splitting."""

    particles: Annotated[int, Meta(ge=10, le=5000)] = 50
    """Cases that a run begins with."""
    runs: Annotated[int, Meta(ge=4, le=100)] = 10
    """Runs side by side, independent of each other."""
    share: Annotated[float, Meta(ge=0.02, le=0.8)] = 0.5
    """Share of a run's cases that a generation replaces by forks of the others."""


class CmaOptions(_Options, frozen=True, kw_only=True):
    """Options of CMA-ES."""

    sigma: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """First step size, in standard deviations of the parameters."""


class BayesianOptions(_Options, frozen=True, kw_only=True):
    """Options of Bayesian search."""

    first: Annotated[int, Meta(ge=0, le=500)] = 0
    """Cases that are spread evenly before the first fit; 0: as many as the parameters want."""
    explore: Annotated[float, Meta(ge=0, le=1)] = 0.25
    """Share of a generation that is far from all cases, however good others look."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerKind:
    """Declaration of a sampler."""

    name: str
    """The word in ``search.sampler``."""
    title: str
    """The name in sentences."""
    gives: Literal["probability", "extreme", "indices", "boundary"]
    """What it answers; all but an extreme need an objective with a limit."""
    implementation: str
    """``module:attribute`` of its :class:`conductor.search.protocol.Sampler`, made of options and
    a :class:`conductor.search.protocol.Problem`."""
    options: type[Struct] = NoOptions
    checks: str = ""
    """``module:attribute`` of a function that says what else is wrong with a section: the section
    and the options -> list of :class:`schemas.validation.Mistake`."""
    parameters_min: int = 1
    """Fewest parameters with which it works."""
    follows: bool = False
    """Whether its cases are distributed as the parameters are, so that shares of them say something
    about the parameters."""
    generation_min: int = 1
    """Fewest cases of a generation from which it learns anything."""
    forks: bool = False
    """Whether it proposes forks: its implementation is a :class:`conductor.search.protocol.Forker`,
    and its objective a KPI that is the extreme of a column."""
    cases_max: int = SEARCH_CASES_MAX
    """Most cases with which it works."""
    libraries: tuple[str, ...] = ()
    """Packages by which it proposes beside NumPy and SciPy; their versions are kept with its
    generations."""
    chains: Literal["none", "pooled", "mean", "best"] = "none"
    """What is made of chains side by side: they are refused; all their generations are one history;
    their probabilities have a mean; their worst case is the answer."""


KINDS = (
    SamplerKind(
        name="monte_carlo",
        title="Monte Carlo",
        gives="probability",
        implementation="conductor.search.samplers.random_points:MonteCarlo",
        chains="pooled",
        follows=True,
    ),
    SamplerKind(
        name="latin_hypercube",
        title="Latin hypercube",
        gives="probability",
        implementation="conductor.search.samplers.spread_points:LatinHypercube",
        chains="pooled",
        follows=True,
    ),
    SamplerKind(
        name="sobol",
        title="scrambled Sobol points",
        gives="probability",
        implementation="conductor.search.samplers.spread_points:Sobol",
        chains="pooled",
        follows=True,
    ),
    SamplerKind(
        name="cma_es",
        libraries=("cma",),
        title="CMA-ES",
        gives="extreme",
        implementation="conductor.search.samplers.evolution:CmaEs",
        chains="best",
        options=CmaOptions,
        parameters_min=2,
        generation_min=2,
    ),
    SamplerKind(
        name="bayesian",
        libraries=("scikit-learn",),
        title="Bayesian search",
        gives="extreme",
        implementation="conductor.search.samplers.bayesian:Bayesian",
        chains="best",
        options=BayesianOptions,
        cases_max=PROCESS_CASES_MAX,
    ),
    SamplerKind(
        name="boundary",
        title="Boundary tracing",
        gives="boundary",
        implementation="conductor.search.samplers.boundary:Boundary",
        options=BoundaryOptions,
        checks="schemas.kinds.boundary:boundary_mistakes",
        parameters_min=2,
    ),
    SamplerKind(
        name="importance",
        title="cross-entropy importance sampling",
        gives="probability",
        implementation="conductor.search.samplers.importance:Importance",
        chains="mean",
        options=ImportanceOptions,
        generation_min=20,
    ),
    SamplerKind(
        name="subset",
        title="subset simulation",
        gives="probability",
        implementation="conductor.search.samplers.subset:Subset",
        chains="mean",
        options=SubsetOptions,
    ),
    SamplerKind(
        name="sensitivity",
        title="Saltelli's design",
        gives="indices",
        implementation="conductor.search.samplers.saltelli:Saltelli",
    ),
    SamplerKind(
        name="splitting",
        title="adaptive multilevel splitting",
        gives="probability",
        implementation="conductor.search.samplers.splitting:Splitting",
        options=SplittingOptions,
        parameters_min=0,
        forks=True,
    ),
)
"""The samplers that are shipped."""


@cache
def sampler_kinds() -> Kinds[SamplerKind]:
    """All samplers, the shipped ones first."""
    return read_kinds(GROUP, SamplerKind, OURS)
