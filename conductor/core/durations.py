"""How long cases take: a histogram that never grows, and the estimate learned from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

_UNIT_S = 0.001
_PER_DOUBLING = 4
BUCKET_MAX = 120
"""About 12 days; longer cases are counted here."""


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
