"""Subset simulation: a rare failure as a chain of events that are not rare.

Au and Beck, Probabilistic Engineering Mechanics 16 (2001); steps of the chains by conditional
sampling in normal space: Papaioannou et al., Probabilistic Engineering Mechanics 41 (2015).

The interval follows the failures back to the cases of the first level that they come from. These
are independent, and what comes from one is the sum over all that it led to, so correlations along
chains, between the chains of a level and between levels are in it (Lee and Whiteley, Biometrika
105, 2018, for particle filters).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from conductor.search.intervals import weighted, wilson
from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from schemas.kinds.sampler import SubsetOptions

Indices = npt.NDArray[np.int64]

LEVELS_MAX = 20
"""Most levels of a run: with a share of 0.1, a probability of 10^-20."""


@dataclass(slots=True)
class _Run:
    """One run: levels from all cases down to failures."""

    levels: int = 0
    reached: float = 1.0
    """Probability of the level that it is at."""
    threshold: float = math.inf
    """Margin that chains of this level stay below."""
    u: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """States of the chains as they are [chains, parameters]."""
    g: Array = field(default_factory=lambda: np.zeros(0))
    states: list[tuple[Array, Array]] = field(default_factory=list)
    """The states of this level, step by step: coordinates and margins."""
    roots: Indices = field(default_factory=lambda: np.zeros(0, np.int64))
    """The case of the first level that each chain comes from [chains]."""
    failed: float = -1.0
    """Share of failures in the last level; negative: the run goes on."""
    shares: Array = field(default_factory=lambda: np.zeros(0))
    """Share of each case of the first level in these failures: of all that come from it."""


class Subset:
    """Runs one after the other, independent of each other."""

    def __init__(self, options: SubsetOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem
        self._steps = max(2, round(1 / options.share))
        self._chains = max(1, options.level // self._steps)
        self._size = self._chains * self._steps
        self._seen: list[Array] = []
        """The generations of the last call, and what became of them: a step asks twice."""
        self._runs: list[_Run] = []

    def propose(self, history: History, streams: Streams) -> Array:
        """A level from the whole space, or a step of every chain."""
        dimension = self._problem.dimension
        runs = self._replayed(history)
        stream = streams(f"generation {len(history.g)}")
        done = not runs or runs[-1].failed >= 0
        if done:
            if runs and not self._problem.repeats:
                return np.zeros((0, dimension))
            proposed = stream.standard_normal((self._size, dimension))
        else:
            keep = self._options.keep
            moved = stream.standard_normal((self._chains, dimension))
            proposed = keep * runs[-1].u + math.sqrt(1 - keep * keep) * moved
        if len(proposed) > self._problem.cases - history.cases:
            return np.zeros((0, dimension))
        return proposed

    def answer(self, history: History) -> Estimate:
        """The mean of the runs that are done."""
        runs = [run for run in self._replayed(history) if run.failed >= 0]
        method = f"subset simulation, {len(runs)} runs of {self._size} cases a level"
        if not runs:
            return Estimate(method=f"{method}; no run is done yet")
        settled = not self._problem.repeats
        each = np.array([run.reached * run.failed for run in runs])
        mean, cases = float(np.mean(each)), self._size * len(runs)
        if not any(run.levels for run in runs):
            low, high = wilson(round(mean * cases), cases)
            method = f"{method}; Wilson's interval"
        elif mean == 0.0:
            low, high = 0.0, max(run.reached for run in runs) * wilson(0, cases)[1]
        else:
            parts = [p * run.shares for p, run in zip(each / np.sum(each), runs, strict=True)]
            low, high = weighted(mean, np.concatenate(parts), cases)
            method = f"{method}; lognormal interval of what comes from each case of a first level"
        return Estimate(method=method, probability=mean, low=low, high=high, settled=settled)

    def _replayed(self, history: History) -> list[_Run]:
        """The runs so far; those of the last call go on where its history does."""
        seen = len(self._seen)
        known = zip(self._seen, history.u, strict=False)
        if seen > len(history.u) or any(u is not v for u, v in known):
            seen, self._seen, self._runs = 0, [], []
        runs = self._runs
        for u, g in zip(history.u[seen:], history.g[seen:], strict=True):
            self._seen.append(u)
            if not runs or runs[-1].failed >= 0:
                runs.append(_Run(states=[(u, g)], roots=np.arange(len(g))))
                self._close(runs[-1])
                continue
            run = runs[-1]
            moves = g <= run.threshold
            run.u = np.where(moves[:, None], u, run.u)
            run.g = np.where(moves, g, run.g)
            run.states.append((run.u, run.g))
            if len(run.states) == self._steps:
                self._close(run)
        return runs

    def _close(self, run: _Run) -> None:
        """All states of a level are known: begin the next one, or end the run."""
        u = np.concatenate([u for u, _ in run.states])
        g = np.concatenate([g for _, g in run.states])
        roots = np.tile(run.roots, len(run.states))
        order = np.argsort(g, kind="stable")
        threshold = float(g[order[self._chains - 1]])
        # Where many cases are equal, as at the end of a KPI's range, more than the share go on.
        inside = order[: np.count_nonzero(g <= threshold)]
        last = threshold < 0 or run.levels + 1 >= LEVELS_MAX
        if last or len(inside) == len(g):  # or no case is worse than the others: no further level
            failures = np.bincount(roots[g < 0], minlength=self._size)
            run.failed = float(np.mean(g < 0))
            run.shares = failures / max(1, int(np.sum(failures)))
            return
        seeds = inside[np.arange(self._chains) * len(inside) // self._chains]
        run.levels += 1
        run.reached *= len(inside) / len(g)
        run.threshold = threshold
        run.u, run.g, run.roots = u[seeds], g[seeds], roots[seeds]
        run.states = [(run.u, run.g)]
