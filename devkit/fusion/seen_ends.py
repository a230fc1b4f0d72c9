"""Ends of what LiDAR sees, and whether both go across, arrays [S, T].

Who walks takes both ends of him along. Of a parked car that another one hides more comes into view
sweep after sweep: one end goes aside, the other one stays, and the middle seems to walk.
"""

from __future__ import annotations

import numpy as np

FORGET_SHARE = 0.3
"""Share by which a sweep moves the remembered places to those seen: at 10 Hz they are a quarter of
a second old, in which a pedestrian walks further than the rays are apart at 30 m [-]."""
BOTH_SHARE = 0.5
"""Share of the middle's speed that either end has at least [-]."""
SAY_SHARE, SAYS_FIRST, SAYS_MIN = 0.4, 0.35, 0.6
"""Share by which one sweep changes whether both ends go along, what that begins with, so that the
first sweep decides, and how much sweeps have to say so [-, -, -]."""


class SeenEnds:
    """Where both ends were a while ago, in the axes of now, and whether they have gone since."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin with nothing seen."""
        self._right_m, self._left_m, self._ago_s = np.zeros((3, *shape))
        self.along = np.zeros(shape)
        """How much sweeps say that both ends go as the middle seems to, 0 to 1."""
        self.sweeps = np.zeros(shape)
        """Sweeps on end in which LiDAR saw the same part of the same thing."""

    def begin(
        self,
        slot: np.ndarray,
        at: np.ndarray,
        right_m: np.ndarray,
        left_m: np.ndarray,
        swept: bool,
    ) -> None:
        """New tracks, each with a slot and its place there; ``swept``: by LiDAR."""
        self.sweeps[slot, at] = float(swept)
        self._right_m[slot, at], self._left_m[slot, at] = right_m, left_m
        self._ago_s[slot, at], self.along[slot, at] = 0.0, SAYS_FIRST

    def move(
        self, period_s: np.ndarray, sine: np.ndarray, cosine: np.ndarray, x_m: np.ndarray
    ) -> None:
        """Turn the axes; ends are ``x_m`` ahead."""
        self._ago_s = self._ago_s + period_s
        self._right_m = cosine * self._right_m - sine * x_m
        self._left_m = cosine * self._left_m - sine * x_m

    def count(self, which: np.ndarray, anew: np.ndarray) -> None:
        """Count a sweep that shows tracks ``which``, ``anew`` those of other things."""
        sweeps = np.where(anew, 1.0, self.sweeps + 1.0)
        self.sweeps = np.where(which, sweeps, self.sweeps)

    def see(
        self,
        which: np.ndarray,
        anew: np.ndarray,
        right_m: np.ndarray,
        left_m: np.ndarray,
        vy_mps: np.ndarray,
    ) -> None:
        """Take a sweep that shows the ends of tracks ``which``, ``anew`` those of other things;
        their middles seem to be as fast as ``vy_mps``."""
        right, left = right_m - self._right_m, left_m - self._left_m
        least_m = BOTH_SHARE * np.abs(vy_mps) * self._ago_s
        goes = np.where(vy_mps > 0.0, np.minimum(right, left), -np.maximum(right, left))
        says = self.along + SAY_SHARE * ((goes > least_m) - self.along)
        self.along = np.where(which, np.where(anew, SAYS_FIRST, says), self.along)
        share = np.where(which, np.where(anew, 1.0, FORGET_SHARE), 0.0)
        self._right_m = self._right_m + share * right
        self._left_m = self._left_m + share * left
        self._ago_s = self._ago_s * (1.0 - share)

    def go_along(self) -> np.ndarray:
        """bool [S, T]: both ends go across as the middle seems to."""
        result: np.ndarray = self.along > SAYS_MIN
        return result
