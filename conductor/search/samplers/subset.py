"""Subset simulation: a rare failure as a chain of events that are not rare.

Au and Beck, Probabilistic Engineering Mechanics 16 (2001); steps of the chains by conditional
sampling in normal space: Papaioannou et al., Probabilistic Engineering Mechanics 41 (2015).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from conductor.search.intervals import lognormal, wilson
from conductor.search.protocol import Array, Estimate, History, Problem, Streams
from schemas.kinds.sampler import SubsetOptions

Flags = npt.NDArray[np.bool_]

LEVELS_MAX = 20
"""Most levels of a run: with a share of 0.1, a probability of 10^-20."""


@dataclass(slots=True)
class _Run:
    """One run: levels from all cases down to failures."""

    first: int
    """Its first generation."""
    levels: int = 0
    threshold: float = math.inf
    """Margin that chains of this level stay below."""
    u: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """States of the chains as they are [chains, parameters]."""
    g: Array = field(default_factory=lambda: np.zeros(0))
    states: list[tuple[Array, Array]] = field(default_factory=list)
    """The states of this level, step by step: coordinates and margins."""
    spreads: list[float] = field(default_factory=list)
    """Squared relative errors of the levels that are done."""
    failed: float = -1.0
    """Share of failures in the last level; negative: the run goes on."""


class Subset:
    """Runs one after the other, independent of each other."""

    def __init__(self, options: SubsetOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem
        self._steps = max(2, round(1 / options.share))
        self._chains = max(1, options.level // self._steps)
        self._size = self._chains * self._steps

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
        share = 1 / self._steps
        each = [share**run.levels * run.failed for run in runs]
        mean = sum(each) / len(runs)
        if mean == 0.0:
            high = share ** min(run.levels for run in runs) * wilson(0, self._size * len(runs))[1]
            return Estimate(method=method, probability=0.0, low=0.0, high=high, settled=settled)
        squares = [p * p * sum(run.spreads) for p, run in zip(each, runs, strict=True)]
        relative = math.sqrt(sum(squares)) / len(runs) / mean
        low, high = lognormal(mean, relative)
        method = f"{method}; lognormal interval of the levels' errors"
        return Estimate(method=method, probability=mean, low=low, high=high, settled=settled)

    def _replayed(self, history: History) -> list[_Run]:
        runs: list[_Run] = []
        for index, (u, g) in enumerate(zip(history.u, history.g, strict=True)):
            if not runs or runs[-1].failed >= 0:
                runs.append(_Run(index))
                run = runs[-1]
                run.states = [(u, g)]
                self._close(run, independent=True)
                continue
            run = runs[-1]
            moves = g <= run.threshold
            run.u = np.where(moves[:, None], u, run.u)
            run.g = np.where(moves, g, run.g)
            run.states.append((run.u, run.g))
            if len(run.states) == self._steps:
                self._close(run, independent=False)
        return runs

    def _close(self, run: _Run, *, independent: bool) -> None:
        """All states of a level are known: begin the next one, or end the run."""
        u = np.concatenate([u for u, _ in run.states])
        g = np.concatenate([g for _, g in run.states])
        order = np.argsort(g, kind="stable")
        seeds = order[: self._chains]
        threshold = float(g[seeds[-1]])
        ends = threshold < 0 or run.levels + 1 >= LEVELS_MAX
        inside = (g < 0) if ends else (g <= threshold)
        shares = [inside] if independent else np.split(inside, len(run.states))
        share = float(np.mean(inside))
        if share > 0:
            run.spreads.append(_spread(shares, share, independent=independent))
        if ends:
            run.failed = share
            return
        run.levels += 1
        run.threshold = threshold
        run.u, run.g = u[seeds], g[seeds]
        run.states = [(run.u, run.g)]


def _spread(steps: list[Flags], share: float, *, independent: bool) -> float:
    """Squared relative error of a level's share, with the correlation along chains."""
    count = sum(len(step) for step in steps)
    plain = (1 - share) / (share * count)
    if independent or share >= 1.0:
        return plain
    variance = share * (1 - share)
    length, factor = len(steps), 0.0
    for lag in range(1, length):
        pairs = [np.mean(steps[i] & steps[i + lag]) for i in range(length - lag)]
        correlation = (float(np.mean(pairs)) - share * share) / variance
        factor += 2 * (1 - lag / length) * correlation
    return plain * (1 + max(0.0, factor))
