"""Adaptive multilevel splitting: cases that come near a failure go on from there again and again.

Cerou and Guyader, Stochastic Analysis and Applications 25 (2007). The score of a case is its
margin, the least of its course. Of a run's cases the share with the largest margins is given up,
and each of these is begun anew as a fork of one that came further: it runs as that one did until
its margin falls below those that were given up, and with other random numbers from there on. The
probability is the product of the shares that were kept, times the share of failures at the end.
It has the right mean whatever the number of cases, ties included (Brehier et al., Annals of Applied
Probability 26, 2016); its error is seen from runs that are independent of each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from conductor.search.intervals import of_logarithms, wilson
from conductor.search.protocol import Array, Estimate, Forks, History, Problem, Streams
from schemas.kinds.sampler import SplittingOptions

Indices = npt.NDArray[np.int64]


@dataclass(slots=True)
class _Run:
    """The cases of one run as they are: those that were given up are replaced."""

    cases: Indices
    """Cases of the history [particles]."""
    u: Array
    """Their coordinates [particles, parameters]."""
    g: Array
    """Their margins [particles]."""
    kept: float = 1.0
    """Product of the shares that were kept."""
    probability: float = -1.0
    """Its estimate; negative: the run goes on."""
    level: float = math.inf
    """Margin that those have, or exceed, which are given up."""

    @property
    def given_up(self) -> Indices:
        """Places of the cases that are given up next."""
        return np.flatnonzero(self.g >= self.level)

    @property
    def left(self) -> Indices:
        """Places of the others."""
        return np.flatnonzero(self.g < self.level)

    def close(self, count: int) -> None:
        """All margins are known: find who is given up, at least ``count``, or end the run."""
        self.level = float(np.sort(self.g)[-count])
        if self.level < 0:
            self.probability = self.kept * float(np.mean(self.g < 0))
        elif not len(self.left):
            self.probability = 0.0  # nobody has come further


class Splitting:
    """Batches of runs side by side, one after the other where an interval is asked for."""

    def __init__(self, options: SplittingOptions, problem: Problem) -> None:
        self._particles, self._runs = options.particles, options.runs
        self._count = max(1, round(options.share * options.particles))
        self._problem = problem

    def propose(self, history: History, streams: Streams) -> Array:
        """All cases of a batch of runs, or those that replace the ones that were given up."""
        dimension = self._problem.dimension
        batches = self._replayed(history)
        runs = [run for run in batches[-1] if run.probability < 0] if batches else []
        if runs:
            proposed = np.concatenate(
                [run.u[parents] for run, parents in self._chosen(runs, history, streams)]
            )
        elif batches and not self._problem.repeats:
            return np.zeros((0, dimension))
        else:
            stream = streams(f"generation {len(history.g)}")
            proposed = stream.standard_normal((self._runs * self._particles, dimension))
        if len(proposed) > self._problem.cases - history.cases:
            return np.zeros((0, dimension))
        return proposed

    def forks(self, history: History, streams: Streams) -> Forks:
        """Parents, drawn evenly from the cases of their run that are left."""
        batches = self._replayed(history)
        runs = [run for run in batches[-1] if run.probability < 0] if batches else []
        if not runs:
            size = self._runs * self._particles
            return Forks(np.full(size, -1, np.int64), np.zeros(size))
        chosen = self._chosen(runs, history, streams)
        parents = np.concatenate([run.cases[parents] for run, parents in chosen])
        margins = np.concatenate([np.full(len(p), run.level) for run, p in chosen])
        return Forks(parents, margins)

    def answer(self, history: History) -> Estimate:
        """The mean of the runs of all batches that are done."""
        batches = [
            runs for runs in self._replayed(history) if all(run.probability >= 0 for run in runs)
        ]
        runs = [run for batch in batches for run in batch]
        method = f"multilevel splitting, {len(runs)} runs of {self._particles} cases"
        if not runs:
            return Estimate(method=f"{method}; no batch of runs is done yet")
        settled = not self._problem.repeats
        each = np.array([run.probability for run in runs])
        mean = float(np.mean(each))
        if mean == 0.0:
            furthest = max(run.kept for run in runs)
            high = furthest * wilson(0, self._particles * len(runs))[1]
            method = f"{method}; none came to a failure"
            return Estimate(method=method, probability=0.0, low=0.0, high=high, settled=settled)
        low, high = of_logarithms(each)
        method = f"{method}; lognormal interval of their mean, by Student's distribution"
        return Estimate(method=method, probability=mean, low=low, high=high, settled=settled)

    def _chosen(
        self, runs: list[_Run], history: History, streams: Streams
    ) -> list[tuple[_Run, Indices]]:
        """Places of the parents of those that are given up, in every run that goes on."""
        stream = streams(f"generation {len(history.g)}")
        chosen = []
        for run in runs:
            left = run.left
            chosen.append((run, left[stream.integers(0, len(left), len(run.given_up))]))
        return chosen

    def _replayed(self, history: History) -> list[list[_Run]]:
        """All batches of runs as they are after ``history``."""
        batches: list[list[_Run]] = []
        begin = 0
        for u, g in zip(history.u, history.g, strict=True):
            cases = np.arange(begin, begin + len(g))
            begin += len(g)
            going = [run for run in batches[-1] if run.probability < 0] if batches else []
            if not going:
                parts = np.split(np.arange(len(g)), self._runs)
                batches.append([_Run(cases[p], u[p], g[p]) for p in parts])
                going = batches[-1]
            else:
                self._replace(going, cases, u, g)
            for run in going:
                run.close(self._count)
        return batches

    def _replace(self, going: list[_Run], cases: Indices, u: Array, g: Array) -> None:
        """The cases that were given up are replaced by those of a generation."""
        at = 0
        for run in going:
            places = run.given_up
            its = slice(at, at + len(places))
            at += len(places)
            run.kept *= 1.0 - len(places) / self._particles
            run.cases[places], run.u[places], run.g[places] = cases[its], u[its], g[its]
