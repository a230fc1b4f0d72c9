"""Where a loop spends its wall time: laps that add up to the whole, for benches and never a KPI."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass(slots=True)
class Stopwatch:
    """One running clock: what passed since the last lap is charged to a name."""

    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time by name [s]."""
    mark_s: float = field(default_factory=lambda: time.perf_counter())
    """Time at which the last lap ended [s]."""

    def lap(self, name: str) -> float:
        """Charge the time since the last lap; returns it [s]."""
        now_s = time.perf_counter()
        spent_s = now_s - self.mark_s
        self.mark_s = now_s
        self.seconds[name] = self.seconds.get(name, 0.0) + spent_s
        return spent_s

    def lap_with(self, name: str, shares: dict[str, float]) -> float:
        """Charge the time since the last lap to ``shares`` [s], and the rest of it to ``name``.

        Shares come from another process; together they are never more than the lap.
        """
        whole_s = self.lap(name)
        left_s = whole_s
        for share, asked_s in shares.items():
            taken_s = min(asked_s, left_s) if asked_s > 0.0 else 0.0  # NaN is none either
            left_s -= taken_s
            self.seconds[share] = self.seconds.get(share, 0.0) + taken_s
        self.seconds[name] -= whole_s - left_s
        return whole_s
