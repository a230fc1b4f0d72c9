"""Speeds across of both ends of what LiDAR sees, arrays [S, T].

Who walks takes both ends of him along. Of a parked car that another one hides more comes into view
sweep after sweep: one end goes aside, the other one stays, and the middle seems to walk.
"""

from __future__ import annotations

import numpy as np

FORGET_SHARE = 0.15
"""Share by which a sweep moves the remembered places to those seen: at 10 Hz they are half a second
old, in which a pedestrian walks further than the rays are apart at 30 m [-]."""
BOTH_SHARE = 0.5
"""Share of the middle's speed that either end has at least [-]."""


class SeenEnds:
    """Where both ends were a while ago, in the axes of now, and how fast they have gone since."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin with nothing seen."""
        self._right_m, self._left_m, self._ago_s, self.both_mps = np.zeros((4, *shape))
        """``both_mps`` is the speed of the slower end, 0 where ends go apart or come together, left
        positive."""

    def begin(
        self, slot: np.ndarray, at: np.ndarray, right_m: np.ndarray, left_m: np.ndarray
    ) -> None:
        """New tracks, each with a slot and its place there."""
        self._right_m[slot, at], self._left_m[slot, at] = right_m, left_m
        self._ago_s[slot, at] = self.both_mps[slot, at] = 0.0

    def move(
        self, period_s: np.ndarray, sine: np.ndarray, cosine: np.ndarray, x_m: np.ndarray
    ) -> None:
        """Turn the axes; ends are ``x_m`` ahead."""
        self._ago_s = self._ago_s + period_s
        self._right_m = cosine * self._right_m - sine * x_m
        self._left_m = cosine * self._left_m - sine * x_m

    def see(
        self, which: np.ndarray, anew: np.ndarray, right_m: np.ndarray, left_m: np.ndarray
    ) -> None:
        """Take a sweep that shows the ends of tracks ``which``, ``anew`` those of other things."""
        right, left = right_m - self._right_m, left_m - self._left_m
        slower = np.where(np.abs(right) < np.abs(left), right, left)
        known = ~anew & (right * left > 0.0) & (self._ago_s > 0.0)
        both = np.where(known, slower / np.where(known, self._ago_s, 1.0), 0.0)
        self.both_mps = np.where(which, both, self.both_mps)
        share = np.where(which, np.where(anew, 1.0, FORGET_SHARE), 0.0)
        self._right_m = self._right_m + share * right
        self._left_m = self._left_m + share * left
        self._ago_s = self._ago_s * (1.0 - share)

    def go_as(self, vy_mps: np.ndarray) -> np.ndarray:
        """bool [S, T]: both ends go across as a track seems to."""
        goes: np.ndarray = self.both_mps * vy_mps > BOTH_SHARE * vy_mps * vy_mps
        return goes
