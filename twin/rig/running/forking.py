"""Forks of running cases: when the random numbers of a slot become others."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from msgspec import UNSET

from schemas.case import Case
from schemas.sections.fork import Fork
from twin.kpi.recorder import KpiRecorder


@dataclass(slots=True)
class _Coming:
    """Forks of a slot's case that are still to come."""

    forks: deque[Fork]
    taken: int = 0
    """Forks that have come."""
    least: dict[tuple[str, bool, bool, float], float] = field(default_factory=dict)
    """Smallest margin so far, by what it is a margin of."""


class Forking:
    """Slots whose cases fork; all others are in no table and cost nothing."""

    def __init__(self, recorder: KpiRecorder) -> None:
        """``recorder``: has the KPI columns that forks wait for."""
        self._recorder = recorder
        self._coming: dict[int, _Coming] = {}

    def begin(self, slot: int, case: Case) -> None:
        """A case begins; its first name is in force."""
        self._coming.pop(slot, None)
        forks = case.variation.forks
        if forks is not UNSET and len(forks) > 1:
            self._coming[slot] = _Coming(deque(forks[1:]))

    def clear(self, slot: int) -> None:
        """A slot is empty."""
        self._coming.pop(slot, None)

    def watch(self, slots: list[int]) -> None:
        """Look at the rows that have just been recorded of ``slots``."""
        for slot in slots if self._coming else ():
            if slot in self._coming:
                self._look(slot, self._coming[slot])

    def _look(self, slot: int, coming: _Coming) -> None:
        seen = set[tuple[str, bool, bool, float]]()
        for fork in coming.forks:
            key = _watched(fork)
            if not fork.column or key in seen:
                continue
            seen.add(key)
            value = self._recorder.last(slot, fork.column)
            if value is not None:
                margin = fork.margin_of(value)
                coming.least[key] = min(coming.least.get(key, math.inf), margin)

    def due(self, tick: np.ndarray, active: np.ndarray) -> Iterator[tuple[int, str]]:
        """Slots that fork at their ticks [S], and whose numbers they have from now on."""
        if not self._coming:
            return
        for slot, coming in self._coming.items():
            name = ""
            while active[slot] and coming.forks and self._ripe(coming, int(tick[slot])):
                name = coming.forks.popleft().case
                coming.taken += 1
            if name:
                yield slot, name

    def save(self, slot: int) -> dict[str, int]:
        """See :class:`twin.rig.running.saving.Keeps`; what was passed stands in the rows."""
        return {"taken": self._coming[slot].taken if slot in self._coming else 0}

    def restore(self, slot: int, saved: dict[str, int]) -> None:
        """After the recorder."""
        coming = self._coming.get(slot)
        for _ in range(saved["taken"]):
            assert coming is not None
            coming.forks.popleft()
            coming.taken += 1
        if coming is None:
            return
        rows = self._recorder.of(slot)
        for fork in coming.forks:
            if fork.column:
                valid = self._recorder.known(slot, fork.column)
                margins = map(fork.margin_of, rows.column(fork.column)[valid].tolist())
                coming.least[_watched(fork)] = min(margins, default=math.inf)

    @staticmethod
    def _ripe(coming: _Coming, tick: int) -> bool:
        fork = coming.forks[0]
        least = coming.least.get(_watched(fork), math.inf)
        return tick >= fork.tick and (not fork.column or least < fork.margin)


def _watched(fork: Fork) -> tuple[str, bool, bool, float]:
    return fork.column, fork.size, fork.above, fork.limit
