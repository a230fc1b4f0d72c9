"""Throughput and remaining time from what has ended lately. No clock: the time comes in."""

from __future__ import annotations

from collections import deque

WINDOW_S = 60.0
"""Throughput is counted over this long [s]."""


class Pace:
    """Ended cases over a sliding window."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, int]] = deque()

    def saw(self, ended: int, now_s: float) -> None:
        """``ended`` cases have ended in all, as of ``now_s``."""
        if self._points and ended < self._points[-1][1]:
            self._points.clear()  # another conductor, or another folder
        self._points.append((now_s, ended))
        # One point from before the window stays: the window's left edge.
        while len(self._points) > 2 and self._points[1][0] <= now_s - WINDOW_S:
            self._points.popleft()

    @property
    def per_s(self) -> float | None:
        """Cases per second; None before anything can be said."""
        if len(self._points) < 2:
            return None
        (first_s, first), (last_s, last) = self._points[0], self._points[-1]
        return (last - first) / (last_s - first_s) if last_s > first_s else None

    def eta_s(self, left: int) -> float | None:
        """Time until ``left`` cases have ended at this pace; None: unknown [s]."""
        if not left:
            return 0.0
        return left / self.per_s if self.per_s else None


def shown_time(seconds: float | None) -> str:
    """``42 s``, ``3 min 05 s``, ``2 h 10 min``; ``-`` for unknown."""
    if seconds is None:
        return "-"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
