"""A boundary in a plane: a grid, and brackets on those of its edges along which it is crossed.

Marching squares (Lorensen and Cline, Computer Graphics 21, 1987), with every crossing bracketed by
two cases, of which one holds and one fails, and halved until it is narrow enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from conductor.search.protocol import Array


@dataclass(slots=True)
class Bracket:
    """A crossing between two cases on an edge of the grid."""

    low: tuple[int, int]
    """Corner at which the edge begins."""
    along: int
    """0: the edge goes along x; 1: along y."""
    holds: tuple[float, float, int]
    """Place on the edge from 0 to 1, margin, and number of a case that holds."""
    fails: tuple[float, float, int]
    """The same of a case that fails."""

    @property
    def width(self) -> float:
        """Width as a share of the edge."""
        return abs(self.holds[0] - self.fails[0])

    @property
    def share(self) -> float:
        """Where the boundary lies between the two, if margins are linear: 0 at the one that
        holds, 1 at the one that fails."""
        rise = self.holds[1] - self.fails[1]
        return self.holds[1] / rise if rise > 0 else 0.5


class Contour:
    """What is known of a boundary; the cases are told in the order in which they were wanted."""

    def __init__(self, cells: int, width: float) -> None:
        self._cells = cells
        self._width = width * cells
        self._margins = np.full((cells + 1) ** 2, np.nan)
        self._asked: list[tuple[Bracket, float]] = []
        self.brackets: list[Bracket] = []
        """Crossings, in the order of edges."""
        self._cases = 0

    @property
    def complete(self) -> bool:
        """Whether the grid is."""
        return self._cases >= len(self._margins)

    @property
    def open(self) -> list[Bracket]:
        """Brackets that are too wide yet, the widest first."""
        wide = [bracket for bracket in self.brackets if bracket.width > self._width * (1 + 1e-9)]
        return sorted(wide, key=lambda bracket: -bracket.width)

    @property
    def widest(self) -> float:
        """Width of the widest bracket, as a share of the plane's side."""
        return max((bracket.width for bracket in self.brackets), default=0.0) / self._cells

    @property
    def fails(self) -> bool:
        """Whether all places of the grid fail, if there is no crossing."""
        return bool(self._margins[0] < 0)

    def want(self, count: int) -> Array:
        """Up to ``count`` places to look at next, shares of the plane's sides [cases, 2]."""
        self._asked = []
        if not self.complete:
            numbers = np.arange(self._cases, min(self._cases + count, len(self._margins)))
            return self._shares(np.stack(np.divmod(numbers, self._cells + 1), axis=1))
        for bracket in self.open[:count]:
            self._asked.append((bracket, 0.5 * (bracket.holds[0] + bracket.fails[0])))
        return np.array([self.place(b, at) for b, at in self._asked]).reshape(-1, 2)

    def tell(self, margins: Array) -> None:
        """Margins at the places that were wanted last."""
        if not self.complete:
            self._margins[self._cases : self._cases + len(margins)] = margins
            self._cases += len(margins)
            self.brackets = self._crossings() if self._cases == len(self._margins) else []
            return
        for (bracket, at), margin in zip(self._asked, margins.tolist(), strict=True):
            if margin < 0:
                bracket.fails = (at, margin, self._cases)
            else:
                bracket.holds = (at, margin, self._cases)
            self._cases += 1

    def place(self, bracket: Bracket, at: float) -> Array:
        """Shares of x and y at a place of a bracket's edge."""
        corner = np.array(bracket.low, np.float64)
        corner[bracket.along] += at
        return self._shares(corner)

    def lines(self) -> list[list[int]]:
        """Brackets by number along each part of the boundary; a closed part ends where it
        began."""
        neighbours: list[list[int]] = [[] for _ in self.brackets]
        for one, other in self._segments():
            neighbours[one].append(other)
            neighbours[other].append(one)
        left = [list(numbers) for numbers in neighbours]
        ends = [n for n, numbers in enumerate(neighbours) if len(numbers) == 1]
        lines = []
        for start in [*ends, *range(len(neighbours))]:
            line = [start]
            while left[line[-1]]:
                here = line[-1]
                following = left[here].pop(0)
                left[following].remove(here)
                line.append(following)
            if len(line) > 1:
                lines.append(line)
        return lines

    def _shares(self, corners: Array | np.ndarray) -> Array:
        return np.asarray(corners / self._cells, np.float64)

    def _margin(self, i: int, j: int) -> float:
        return float(self._margins[i * (self._cells + 1) + j])

    def _crossings(self) -> list[Bracket]:
        """Edges of which one end holds and the other fails."""
        found = []
        for along in (0, 1):
            for i in range(self._cells + along):
                for j in range(self._cells + 1 - along):
                    ends = []
                    for at, (k, m) in enumerate(((i, j), (i + 1 - along, j + along))):
                        number = k * (self._cells + 1) + m
                        ends.append((float(at), self._margin(k, m), number))
                    failing = [end for end in ends if end[1] < 0]
                    holding = [end for end in ends if not end[1] < 0]
                    if failing and holding:
                        found.append(Bracket((i, j), along, holding[0], failing[0]))
        return found

    def _segments(self) -> list[tuple[int, int]]:
        """Pairs of brackets that a cell joins."""
        numbers = {(*b.low, b.along): n for n, b in enumerate(self.brackets)}
        segments = []
        for i in range(self._cells):
            for j in range(self._cells):
                # Around the cell, from its corner (i, j): below, right, above, left.
                edges = ((i, j, 0), (i + 1, j, 1), (i, j + 1, 0), (i, j, 1))
                crossed = [numbers[edge] for edge in edges if edge in numbers]
                if len(crossed) == 4 and self._parts(i, j):
                    crossed = crossed[1:] + crossed[:1]
                pairs = zip(crossed[::2], crossed[1::2], strict=True)
                segments += list(pairs)
        return segments

    def _parts(self, i: int, j: int) -> bool:
        """Whether the boundary of a cell that is crossed on all sides parts the corner (i, j) from
        the middle, so that the first edge is joined with the last. The middle is taken for the mean
        of the corners."""
        corners = [self._margin(i + k, j + m) for k in (0, 1) for m in (0, 1)]
        return (sum(corners) < 0) != (corners[0] < 0)
