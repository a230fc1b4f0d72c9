"""Durations of cases.

:class:`Durations` are wall times: a histogram that never grows, and the estimate learned from it.

:class:`CaseLengths` are simulated times, so that the longest cases begin first and the tail is
short. What is known is the length of the same cases in an earlier run, and of the cases that this
run has committed. Of the others it is estimated by the values of their axes: a mean, and for each
value what cases with it take longer or shorter. As long as nothing is known, one case of every
value is the pilot that the estimate begins with. Nothing but the order of leases follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from conductor.core.case_table import CaseTable

_UNIT_S = 0.001
_PER_DOUBLING = 4
BUCKET_MAX = 120
"""About 12 days; longer cases are counted here."""

VALUES_MAX = 64
"""Most values of an axis that are told apart; one with more is left out."""
FITTED_MAX = 4096
"""Most known cases that an estimate is made of."""
PILOT_SHARE = 4
"""A campaign has a pilot if it has at least so many times as many cases."""
CANDIDATES_MAX = 256
"""Most cases with a value that are looked at for the pilot, from all over the campaign."""
_GROWTH = 1.25
"""The estimate is made anew when so many times as many cases are known."""
_SWEEPS = 6
"""Passes over the axes of an estimate."""
_DOUBT = 1.0
"""A value's effect is drawn to none as if so many more cases with it had been of the mean."""


@dataclass(slots=True)
class Durations:
    """Wall times of finished cases, in buckets a quarter of a doubling wide."""

    counts: dict[int, int] = field(default_factory=dict)
    total: int = 0

    def add(self, wall_s: float) -> None:
        """A case took ``wall_s``; what is no time counts as none."""
        bucket = 0
        if wall_s > _UNIT_S:
            bucket = math.ceil(min(_PER_DOUBLING * math.log2(wall_s / _UNIT_S), BUCKET_MAX))
        self.counts[bucket] = self.counts.get(bucket, 0) + 1
        self.total += 1

    def p95_s(self) -> float | None:
        """The wall time that 95 of 100 cases stay within, at most 19 % too long; None: unknown."""
        if not self.total:
            return None
        missing = math.ceil(0.95 * self.total)
        for bucket in sorted(self.counts):
            missing -= self.counts[bucket]
            if missing <= 0:
                break
        return _UNIT_S * math.pow(2.0, bucket / _PER_DOUBLING)


@dataclass(slots=True)
class CaseLengths:
    """Expected lengths of the cases of a campaign, by their positions [s of simulated time]."""

    axes: list[list[int]] = field(default_factory=list)
    """Per axis the number of each case's value."""
    known: dict[int, float] = field(default_factory=dict)
    """Position -> measured length, of an earlier run or this one."""
    pilot: list[int] = field(default_factory=list)
    """Positions of one case of every value, ascending; empty: they would be too many, or an earlier
    run says more."""
    enough: int = 0
    """So many cases have to be known before others are told apart: one of every value."""
    earlier: bool = False
    """Cases of an earlier run are known: they are told apart by their own lengths, without axes."""
    _mean: float = 0.0
    _effects: list[dict[int, float]] = field(default_factory=list)
    _fitted: int = 0
    _estimated: dict[int, float] = field(default_factory=dict)

    @classmethod
    def of_table(
        cls, table: CaseTable, names: Sequence[str], before: Mapping[str, float]
    ) -> CaseLengths:
        """Durations of cases as they were submitted.

        Args:
            table: the cases; columns with few different values are axes.
            names: of the cases, by position.
            before: length of cases in an earlier run, by name [s].
        """
        axes = [
            column.index
            for column in table.columns.values()
            if column.index and 1 < len(column.values) <= VALUES_MAX
        ]
        known = {k: before[name] for k, name in enumerate(names) if name in before}
        chosen = _pilot(axes, len(names))
        pilot = [] if known or len(chosen) * PILOT_SHARE > len(names) else chosen
        return cls(axes, known, pilot, len(chosen), bool(known))

    def add(self, position: int, length_s: float) -> None:
        """A case was as long as that."""
        self.known[position] = length_s

    @property
    def told(self) -> bool:
        """Whether enough is known to tell cases apart."""
        return bool(self.axes or self.earlier) and len(self.known) >= max(2, self.enough)

    def expected_s(self, position: int) -> float:
        """Length of a case: as measured, or estimated; 0 as long as nothing is known."""
        if position in self.known:
            return self.known[position]
        if len(self.known) >= max(2.0, _GROWTH * self._fitted) and self._fitted < FITTED_MAX:
            self._fit()
        if (estimate := self._estimated.get(position)) is None:
            effects = zip(self.axes, self._effects, strict=False)
            estimate = self._estimated[position] = self._mean + sum(
                effect.get(axis[position], 0.0) for axis, effect in effects if position < len(axis)
            )
        return estimate

    def _fit(self) -> None:
        """Backfitting: every axis explains what the others leave, several times over."""
        rows = [row for row in self.known.items() if all(row[0] < len(a) for a in self.axes)]
        rows = rows[:FITTED_MAX]
        self._fitted = len(self.known)
        self._estimated.clear()
        if not rows:
            return
        self._mean = sum(length for _, length in rows) / len(rows)
        self._effects = [{} for _ in self.axes]
        left = [length - self._mean for _, length in rows]
        for _ in range(_SWEEPS):
            for axis, effects in zip(self.axes, self._effects, strict=True):
                sums: dict[int, list[float]] = {}
                for (position, _), rest in zip(rows, left, strict=True):
                    entry = sums.setdefault(axis[position], [0.0, 0.0])
                    entry[0] += rest + effects.get(axis[position], 0.0)
                    entry[1] += 1.0
                new = {value: total / (n + _DOUBT) for value, (total, n) in sums.items()}
                for k, (position, _) in enumerate(rows):
                    left[k] += effects.get(axis[position], 0.0) - new[axis[position]]
                effects.clear()
                effects.update(new)


def _pilot(axes: Sequence[list[int]], count: int) -> list[int]:
    """Positions that together have every value of every axis, ascending.

    Again and again a case with a value that is still missing, of the axis that misses most: the one
    with most missing values, among these the one whose values were chosen least, then the first.
    """
    axes = [axis for axis in axes if len(axis) == count]
    with_value: list[dict[int, list[int]]] = [{} for _ in axes]
    for axis, lists in zip(axes, with_value, strict=True):
        for position, value in enumerate(axis):
            lists.setdefault(value, []).append(position)
    uses: list[dict[int, int]] = [dict.fromkeys(axis, 0) for axis in axes]
    missing = [set(axis) for axis in axes]
    chosen: list[int] = []
    while any(missing):
        wanted = max(range(len(axes)), key=lambda k: len(missing[k]))
        value = min(missing[wanted])

        def worth(position: int) -> tuple[int, int, int]:
            values = [axis[position] for axis in axes]
            new = sum(v in m for v, m in zip(values, missing, strict=True))
            used = sum(u[v] for v, u in zip(values, uses, strict=True))
            return new, -used, -position

        candidates = with_value[wanted][value]
        best = max(candidates[:: -(-len(candidates) // CANDIDATES_MAX)], key=worth)
        chosen.append(best)
        for axis, values, used in zip(axes, missing, uses, strict=True):
            values.discard(axis[best])
            used[axis[best]] += 1
    return sorted(chosen)
