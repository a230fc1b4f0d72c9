"""The table of samplers: what proposes the cases of a search, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.samplers"
"""Entry points that bring samplers."""

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


class CmaOptions(_Options, frozen=True, kw_only=True):
    """Options of CMA-ES."""

    sigma: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """First step size, in standard deviations of the parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerKind:
    """Declaration of a sampler."""

    name: str
    """The word in ``search.sampler``."""
    title: str
    """The name in sentences."""
    gives: Literal["probability", "extreme"]
    """What it answers; a probability needs an objective with a limit."""
    implementation: str
    """``module:attribute`` of its :class:`conductor.search.protocol.Sampler`, made of options and
    a :class:`conductor.search.protocol.Problem`."""
    options: type[Struct] = NoOptions
    parameters_min: int = 1
    """Fewest parameters with which it works."""
    generation_min: int = 1
    """Fewest cases of a generation from which it learns anything."""


KINDS = (
    SamplerKind(
        name="monte_carlo",
        title="Monte Carlo",
        gives="probability",
        implementation="conductor.search.samplers.random_points:MonteCarlo",
    ),
    SamplerKind(
        name="latin_hypercube",
        title="Latin hypercube",
        gives="probability",
        implementation="conductor.search.samplers.spread_points:LatinHypercube",
    ),
    SamplerKind(
        name="sobol",
        title="scrambled Sobol points",
        gives="probability",
        implementation="conductor.search.samplers.spread_points:Sobol",
    ),
    SamplerKind(
        name="cma_es",
        title="CMA-ES",
        gives="extreme",
        implementation="conductor.search.samplers.evolution:CmaEs",
        options=CmaOptions,
        parameters_min=2,
        generation_min=2,
    ),
    SamplerKind(
        name="importance",
        title="cross-entropy importance sampling",
        gives="probability",
        implementation="conductor.search.samplers.importance:Importance",
        options=ImportanceOptions,
        generation_min=20,
    ),
    SamplerKind(
        name="subset",
        title="subset simulation",
        gives="probability",
        implementation="conductor.search.samplers.subset:Subset",
        options=SubsetOptions,
    ),
)
"""The samplers that are shipped."""


@cache
def sampler_kinds() -> Kinds[SamplerKind]:
    """All samplers, the shipped ones first."""
    return read_kinds(GROUP, SamplerKind, OURS)
