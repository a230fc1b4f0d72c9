"""How old pictures of rigs are, whose clocks are others than ours. No I/O, no clock.

A rig that is asked for its clock reads it between the question and the answer. So what its clock is
ahead of ours lies between two bounds, as far apart as the round trip took; of several round trips
what all agree on counts. Clocks that drift apart widen the bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

RIGS_MAX = 4096
"""Rigs whose clocks are remembered, at most; beyond that all are asked anew."""
DRIFT = 2e-4
"""How much faster one clock may run than another; quartz is within a tenth of this [-]."""


@dataclass(frozen=True, slots=True)
class PictureAge:
    """How old something is."""

    age_s: float
    within_s: float
    """How far that may be off [s]."""


@dataclass(frozen=True, slots=True)
class _Bounds:
    """What a clock is ahead of ours."""

    low_s: float
    high_s: float
    read_s: float
    """When that was found, by our clock [s]."""

    def at(self, now_s: float) -> tuple[float, float]:
        """The bounds at another time of ours."""
        drift_s = DRIFT * max(0.0, now_s - self.read_s)
        return self.low_s - drift_s, self.high_s + drift_s


class RigClocks:
    """Clocks by rig, each as far ahead of ours as its round trips say."""

    def __init__(self) -> None:
        self._bounds: dict[str, _Bounds] = {}

    def knows(self, rig: str) -> bool:
        """Whether its clock has been read."""
        return rig in self._bounds

    def read(self, rig: str, clock_s: float, asked_s: float, answered_s: float) -> None:
        """A rig has read its clock.

        Args:
            rig: its name.
            clock_s: what its clock said [s].
            asked_s: when it was asked, by our clock [s].
            answered_s: when the answer was there, by our clock [s].
        """
        low_s, high_s = clock_s - answered_s, clock_s - asked_s
        if not math.isfinite(clock_s):
            return
        known = self._bounds.get(rig)
        if known is not None:
            known_low_s, known_high_s = known.at(answered_s)
            if known_low_s <= high_s and low_s <= known_high_s:
                low_s, high_s = max(low_s, known_low_s), min(high_s, known_high_s)
            # Else it is another clock: its host slept, or the name went to another rig.
        elif len(self._bounds) >= RIGS_MAX:
            self._bounds.clear()
        self._bounds[rig] = _Bounds(low_s, high_s, answered_s)

    def age(self, rig: str, at_s: float, now_s: float) -> PictureAge | None:
        """How old something is that was made when its rig's clock said ``at_s``; None: nobody has
        read that clock."""
        known = self._bounds.get(rig)
        if known is None or not math.isfinite(at_s):
            return None
        low_s, high_s = known.at(now_s)
        age_s = now_s - at_s + (low_s + high_s) / 2
        return PictureAge(max(0.0, age_s), (high_s - low_s) / 2)
