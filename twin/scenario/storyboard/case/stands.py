"""Where the bodies of all slots stand: what vehicles may hit, and what pictures begin with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.road.opendrive.grid import settled, sine_cosine
from twin.scenario.storyboard.case.bodies import SlotBodies
from twin.scenario.storyboard.player.columns import Real

_GRAPHICS = 1
"""Bit of what can be seen."""
_HULL_PLACE, _HULL_HALF, _HULL_MOTION = (0, 1, 2), slice(3, 5), (5, 6, 7)
"""Columns of :data:`twin.vehicle.kernel.MOVER_COLUMNS`."""


class BodyStands(NamedTuple):
    """Where bodies are [S, M]; what stands in rooms without a body counts for nothing."""

    real: np.ndarray
    """Columns of :class:`~twin.scenario.storyboard.player.columns.Real` [S, M, C]."""
    seen: np.ndarray
    """bool: there is such a body, and it can be seen."""
    place_m: tuple[np.ndarray, np.ndarray]
    """World x, y of the middles of their boxes."""
    height_m: np.ndarray
    """World z of these, on the ground."""
    velocity_mps: tuple[np.ndarray, np.ndarray]
    """World x, y, of the middles."""
    up: tuple[np.ndarray, np.ndarray, np.ndarray]
    """World x, y and z of their upward axes."""

    @classmethod
    def of(
        cls,
        bodies: SlotBodies,
        real: np.ndarray,
        visible: np.ndarray,
        yaw_rate_radps: np.ndarray,
        away: Sequence[tuple[int, int]],
    ) -> BodyStands:
        """Where bodies are.

        Args:
            bodies: what they are.
            real: columns ``Real`` of their entities [S, M, C].
            visible: bits of who sees them [S, M].
            yaw_rate_radps: how fast they turn [S, M].
            away: slots and bodies that an intervention has taken away.
        """
        seen = bodies.there & (visible & _GRAPHICS != 0)
        for body in away:
            seen[body] = False
        ahead, aside = bodies.centre_m[..., 0], bodies.centre_m[..., 1]
        axes = _axes(real[..., Real.HEADING], real[..., Real.PITCH], real[..., Real.ROLL])
        # The middle of a box stands on the slope that its origin stands on.
        off_x, off_y, off_z = (ahead * along + aside * across for along, across, _ in axes)
        rate = yaw_rate_radps
        return cls(
            real,
            seen,
            (settled(real[..., Real.X] + off_x), settled(real[..., Real.Y] + off_y)),
            real[..., Real.Z] + settled(off_z),
            (real[..., Real.VX] - rate * off_y, real[..., Real.VY] + rate * off_x),
            (axes[0][2], axes[1][2], axes[2][2]),
        )

    def hulls(self, bodies: SlotBodies, yaw_rate_radps: np.ndarray) -> np.ndarray:
        """What vehicles may hit of them [S, M, 8], the numbers of
        :meth:`twin.actors.motion.Placement.hulls`."""
        hulls = np.zeros((*bodies.there.shape, 8))
        place = (*self.place_m, self.real[..., Real.HEADING])
        motion = (*self.velocity_mps, yaw_rate_radps)
        columns = (*_HULL_PLACE, *_HULL_MOTION)
        for column, part in zip(columns, (*place, *motion), strict=True):
            hulls[..., column] = np.where(bodies.there, part, 0.0)
        hulls[..., _HULL_HALF] = bodies.half_m * self.seen[..., None]
        return hulls


def _axes(
    heading_rad: np.ndarray, pitch_rad: np.ndarray, roll_rad: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """World x, y and z of bodies' forward, left and upward axes: the rows of the rotation about z
    by the heading, then y by the pitch, then x by the roll."""
    # In one call: a step of a scenario has few bodies, and each call takes as long as one of many.
    (s, sp, sr), (c, cp, cr) = sine_cosine(np.stack([heading_rad, pitch_rad, roll_rad]))
    return (
        (c * cp, c * sp * sr - s * cr, c * sp * cr + s * sr),
        (s * cp, s * sp * sr + c * cr, s * sp * cr - c * sr),
        (-sp, cp * sr, cp * cr),
    )
