"""Ended cases per minute over the last minute. No clock."""

from __future__ import annotations

from collections import deque

WINDOW_S = 60.0
"""Throughput is counted over this long [s]."""


class Throughput:
    """Takes counts as they come; any two windows of one length overlap."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, int]] = deque()

    def count(self, ended: int, now_s: float) -> float | None:
        """Ended cases per minute over the window; None before anything can be said."""
        points = self._points
        if points and ended < points[-1][1]:
            points.clear()  # another conductor, or another folder
        points.append((now_s, ended))
        # One point from before the window stays: the window's left edge.
        while len(points) > 2 and points[1][0] <= now_s - WINDOW_S:
            points.popleft()
        (first_s, first), (last_s, last) = points[0], points[-1]
        return 60 * (last - first) / (last_s - first_s) if last_s > first_s else None
