"""The boundary between cases that hold and cases that fail, in the plane of two parameters."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from conductor.search.contour import Contour
from conductor.search.protocol import (
    Array,
    Crossing,
    Estimate,
    History,
    Problem,
    Streams,
    Traced,
)
from schemas.kinds.boundary import BoundaryOptions, plane_of

EDGE = 0.001
"""Probability that the plane leaves out at each end of a parameter."""


class Boundary:
    """Looks at a grid, then halves every bracket between two of its neighbours of which one holds
    and one fails. All other parameters stay at their medians."""

    def __init__(self, options: BoundaryOptions, problem: Problem) -> None:
        self._options, self._problem = options, problem
        names = list(problem.names)
        self._plane = [names.index(name) for name in plane_of(names, options)]

    def propose(self, history: History, _streams: Streams) -> Array:
        """The grid, then the middles of the brackets that are too wide."""
        count = min(self._problem.generation, self._problem.cases - history.cases)
        return self._coordinates(self._known(history).want(max(0, count)))

    def answer(self, history: History) -> Estimate:
        """No probability; settled when all brackets are narrow enough."""
        contour = self._known(history)
        x, y = (self._problem.names[index] for index in self._plane)
        method = f"boundary in {x} and {y}"
        if not contour.complete:
            return Estimate(method=f"{method}; the grid is not complete")
        if not contour.brackets:
            what = "fail" if contour.fails else "hold"
            return Estimate(method=f"{method}; none: all places of the grid {what}", settled=True)
        count, widest = len(contour.brackets), contour.widest
        method = f"{method}; {count} points, known to {widest:.2g} of its sides"
        return Estimate(method=method, settled=not contour.open)

    def trace(self, history: History) -> Traced:
        """The points of the boundary that are known, and how they hang together."""
        contour = self._known(history)
        points = [
            Crossing(
                holds=bracket.holds[2],
                fails=bracket.fails[2],
                share=bracket.share,
                width=float(np.max(np.abs(places[0] - places[1]))),
            )
            for bracket in contour.brackets
            for places in [[contour.place(bracket, at[0]) for at in (bracket.holds, bracket.fails)]]
        ]
        return Traced(self._plane[0], self._plane[1], points, contour.lines())

    def _known(self, history: History) -> Contour:
        """What the closed generations tell."""
        contour = Contour(self._options.grid, self._options.width)
        for margins in history.g:
            contour.want(len(margins))
            contour.tell(margins)
        return contour

    def _coordinates(self, shares: Array) -> Array:
        """Coordinates of shares of the plane's sides, which are even in the values of most
        distributions."""
        u = np.zeros((len(shares), self._problem.dimension))
        for column, index in enumerate(self._plane):
            share = shares[:, column]
            if self._problem.tails[index]:
                u[:, index] = float(-ndtri(EDGE)) * (2.0 * share - 1.0)
            else:
                u[:, index] = ndtri(EDGE + (1.0 - 2.0 * EDGE) * share)
        return u
