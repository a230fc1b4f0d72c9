"""Running numbers of one attempt: what arrived, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Sequence:
    """Counts the samples of an attempt as they arrive, in order."""

    received: int = 0
    lost: int = 0
    _next: int = 0

    def take(self, seq: int, count: int = 1) -> bool:
        """Note ``count`` samples from ``seq`` on; False: an old one that is not to be used."""
        if seq < self._next:
            return False
        self.lost += seq - self._next
        self.received += count
        self._next = seq + count
        return True

    @property
    def complete(self) -> bool:
        """Nothing is missing so far."""
        return self.lost == 0
