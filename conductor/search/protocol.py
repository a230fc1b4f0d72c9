"""What a sampler is: a pure function of closed generations and keyed random numbers.

Samplers work on standard normal coordinates ``u``, one per parameter, independent of each other;
:mod:`conductor.search.space` makes values of them. A margin ``g`` is negative where a case failed,
and smaller where it is worse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Streams = Callable[[str], np.random.Generator]
"""Random numbers by the name of what they are for: the same name, the same numbers."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What a sampler is made for."""

    dimension: int
    """Parameters."""
    cases: int
    """Most cases; of a chain, where there are several."""
    generation: int
    """Cases of a generation, where the sampler does not say otherwise."""
    names: Sequence[str] = ()
    """Their names."""
    tails: Sequence[bool] = ()
    """Which of them thin out towards their ends, as a normal one does."""
    repeats: bool = False
    """Whether an interval is asked for: a sampler that has its answer goes on for a better one."""
    chain: int = 0
    """Which of the chains side by side it proposes for."""


@dataclass(frozen=True, slots=True)
class History:
    """The closed generations, in order; cases in the order in which they were proposed."""

    u: Sequence[Array]
    """Coordinates [cases, parameters] per generation."""
    g: Sequence[Array]
    """Margins [cases] per generation."""

    @property
    def cases(self) -> int:
        """Number of cases of all generations."""
        return sum(len(rows) for rows in self.g)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What a sampler makes of a history."""

    method: str
    """How probability and interval were obtained, in words."""
    probability: float | None = None
    """Probability of failure; None: none yet, or none at all."""
    low: float | None = None
    """Lower end of its 95 % interval."""
    high: float | None = None
    settled: bool = False
    """Whether the sampler has nothing more to propose."""


class Sampler(Protocol):
    """Proposes cases and answers; it keeps nothing between two calls."""

    def propose(self, history: History, streams: Streams, /) -> Array:
        """Coordinates of the next generation [cases, parameters]; no row: nothing more."""

    def answer(self, history: History, /) -> Estimate:
        """What is known after ``history``."""


@dataclass(frozen=True, slots=True)
class Forks:
    """What the cases of a generation are forks of."""

    parents: npt.NDArray[np.int64]
    """Case of the history [cases], counted over all generations; -1: it is no fork."""
    margins: Array
    """Margin below which the parent's had fallen when the fork goes its own way [cases]."""


@runtime_checkable
class Forker(Sampler, Protocol):
    """A sampler whose cases may go on from the middle of others: they have their coordinates, and
    other random numbers from there on."""

    def forks(self, history: History, streams: Streams, /) -> Forks:
        """What the cases of :meth:`propose` are forks of, for the same arguments."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A point of a boundary, between two cases."""

    holds: int
    """Number of a case that holds, in the order of proposals."""
    fails: int
    """Number of one that fails."""
    share: float
    """Where the boundary is likely between them: 0 at the one that holds, 1 at the other."""
    width: float
    """Distance between them, as a share of the plane's side."""


@dataclass(frozen=True, slots=True)
class Traced:
    """A boundary in the plane of two parameters."""

    x: int
    """Number of the one parameter."""
    y: int
    points: Sequence[Crossing]
    lines: Sequence[Sequence[int]]
    """Points by number along each of its parts; a closed part ends where it began."""


@runtime_checkable
class TracesBoundary(Protocol):
    """A sampler that knows a boundary between cases that hold and cases that fail."""

    def trace(self, history: History, /) -> Traced:
        """The boundary as far as it is known after ``history``."""
