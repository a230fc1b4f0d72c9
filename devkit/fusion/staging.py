"""Stages of the emergency brake: free, partial, full, hold; and the way back from each.

Arrays [S]. No stage is latched: the brake is let go of when nothing was in the way for a while,
also from full braking, and a car that has stopped drives on when its path is free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.parameters import StagingParameters
from devkit.fusion.threats import Threats

FREE, PARTIAL, FULL, HOLD = range(4)
"""Stages, as numbers in arrays."""


class StagePlan(NamedTuple):
    """What the stages ask for, arrays [S]."""

    brake: np.ndarray
    """Brake of the emergency stages, 0: they ask for nothing [-]."""
    aeb: np.ndarray
    """bool: the car brakes for something."""
    warning: np.ndarray
    """bool: the driver is warned."""
    began: np.ndarray
    """bool: the brake begins in this tick."""
    cause: np.ndarray
    """int: the track with the least time to collision among those that count; -1: none."""


class Stages:
    """Stage of S cars."""

    def __init__(self, slots: int, parameters: StagingParameters) -> None:
        """Begin free."""
        self._p = parameters
        self.stage = np.full(slots, FREE)
        self._clear_s = np.zeros(slots)

    def reset(self, slot: int) -> None:
        """A new case begins in ``slot``."""
        self.stage[slot] = FREE
        self._clear_s[slot] = 0.0

    def update(self, threats: Threats, ego: EgoMotion, period_s: np.ndarray) -> StagePlan:
        """One control tick."""
        p = self._p
        near = (threats.agreed & (threats.ttc_s < p.partial_ttc_s)) | (
            threats.single & (threats.ttc_s < p.single_ttc_s)
        )
        near &= threats.needed_mps2 > p.partial_deceleration_mps2
        full_mps2 = np.where(threats.stands, p.standing_deceleration_mps2, p.full_deceleration_mps2)
        late = near & (threats.needed_mps2 > full_mps2)
        keep_m = p.partial_ttc_s * np.maximum(ego.speed_mps, p.cruise_speed_mps)[:, None]
        in_way = near.any(axis=1)
        blocked = in_way | (threats.blocking & (threats.gap_m < keep_m + p.stop_gap_m)).any(axis=1)
        self._clear_s = np.where(blocked, 0.0, self._clear_s + period_s)
        before = self.stage
        wait_s = np.where(before == HOLD, p.restart_s, p.release_s)
        braking = before != FREE
        released = braking & (self._clear_s >= wait_s)
        asked = np.where(late.any(axis=1), FULL, np.where(in_way, PARTIAL, FREE))
        stage = np.where(released, FREE, np.maximum(before, asked))
        stage = np.where((stage != FREE) & ego.still, HOLD, stage)
        # A car that begins at rest has nothing to brake: it may creep up to what is far away.
        stage = np.where((before == FREE) & ego.still & ~in_way, FREE, stage)
        self.stage = stage
        counted = threats.agreed | threats.single
        time = np.where(counted, threats.ttc_s, np.inf)
        cause = np.where(counted.any(axis=1), time.argmin(axis=1), -1)
        warned = (threats.foreseen & (threats.ttc_s < p.warning_ttc_s)).any(axis=1)
        brake = np.where(stage >= FULL, 1.0, np.where(stage == PARTIAL, p.partial_brake, 0.0))
        aeb = stage != FREE
        return StagePlan(brake, aeb, warned | aeb, aeb & (before == FREE), cause)
