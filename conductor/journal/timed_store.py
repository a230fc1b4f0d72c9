"""A journal with a stop-watch: the engine itself knows no clock."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from conductor.core.facts import Fact
from conductor.serve.engine import FactStore


class TimedStore:
    """Passes everything on and adds up how long appending took."""

    def __init__(self, store: FactStore) -> None:
        self._store = store
        self.wall_s = 0.0
        """Time spent in :meth:`append`, that is mostly waiting for the disk [s]."""

    def append(self, facts: Sequence[Fact]) -> None:
        """See :class:`conductor.serve.engine.FactStore`."""
        started_s = time.perf_counter()
        try:
            self._store.append(facts)
        finally:
            self.wall_s += time.perf_counter() - started_s

    def probe(self) -> None:
        """See :class:`conductor.serve.engine.FactStore`."""
        self._store.probe()

    def fold(self) -> Iterable[Fact]:
        """See :class:`conductor.serve.engine.FactStore`."""
        return self._store.fold()
