"""Truth of what is in the ego's way: the time to a collision with any body on its road."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.road.opendrive.grid import sine_cosine
from twin.scenario.storyboard.player.columns import Real, Whole

LOOK_S = 60.0
"""What would be met later than this is not in the way [s]."""
_STILL_MPS = 1e-9
"""Slower than this nothing comes nearer [m/s]."""


class RoadBoxes(NamedTuple):
    """Boxes in coordinates of a road [..., N], along it in the direction of s and to the left of
    it."""

    middle_m: tuple[np.ndarray, np.ndarray]
    half_m: tuple[np.ndarray, np.ndarray]
    velocity_mps: tuple[np.ndarray, np.ndarray]


def road_boxes(reals: np.ndarray, half_m: np.ndarray, centre_m: np.ndarray) -> RoadBoxes:
    """Boxes of entities on their road.

    Args:
        reals: columns :class:`~twin.scenario.storyboard.player.columns.Real` [..., N, C].
        half_m: half lengths and half widths [..., N, 2].
        centre_m: from the origins to the middles, forwards and to the left [..., N, 2].
    """
    turn, speed = reals[..., Real.TURN], reals[..., Real.SPEED]
    s, c = sine_cosine(turn)
    ahead, left = centre_m[..., 0], centre_m[..., 1]
    length, width = half_m[..., 0], half_m[..., 1]
    return RoadBoxes(
        (reals[..., Real.S] + ahead * c - left * s, reals[..., Real.T] + ahead * s + left * c),
        (length * np.abs(c) + width * np.abs(s), length * np.abs(s) + width * np.abs(c)),
        (speed * c, speed * s),
    )


def time_to_collision_s(boxes: RoadBoxes, margin_m: float | np.ndarray) -> np.ndarray:
    """Time until the first box overlaps each other one [..., N - 1]; infinite: it does not.

    All go on as fast as now, along the road and across it: a curve of the road is none of their
    ways. Boxes upright to the road's axes stand around the turned ones.

    Args:
        boxes: the ego first.
        margin_m: a gap of this size beside each other counts as an overlap; a number, or [..., 1].
    """
    enters = np.zeros_like(boxes.middle_m[0][..., 1:])
    leaves = np.full_like(enters, np.inf)
    for axis, margin in enumerate((0.0, margin_m)):
        middle, half, velocity = (part[axis] for part in boxes)
        apart = middle[..., 1:] - middle[..., :1]
        reach = half[..., 1:] + half[..., :1] + margin
        speed = velocity[..., 1:] - velocity[..., :1]
        moves = np.abs(speed) > _STILL_MPS
        over = np.where(moves, speed, 1.0)
        first, last = (-reach - apart) / over, (reach - apart) / over
        inside = np.abs(apart) < reach
        enter = np.where(moves, np.minimum(first, last), np.where(inside, -np.inf, np.inf))
        leave = np.where(moves, np.maximum(first, last), np.where(inside, np.inf, -np.inf))
        enters, leaves = np.maximum(enters, enter), np.minimum(leaves, leave)
    return np.where(enters < leaves, enters, np.inf)


def nearest_collision_s(
    reals: np.ndarray,
    wholes: np.ndarray,
    half_m: np.ndarray,
    centre_m: np.ndarray,
    margin_m: float | np.ndarray,
) -> np.ndarray:
    """Least time to a collision of the first entity with one of the others [...]; infinite: with
    none within :data:`LOOK_S`. Leading axes are those of slots, which know nothing of one another.

    Entities on other roads, vanished ones and flat ones (without a half length) are left out.

    Args:
        reals: columns of :class:`~twin.scenario.storyboard.player.columns.Real` [..., N, C].
        wholes: likewise of :class:`~twin.scenario.storyboard.player.columns.Whole` [..., N, C].
        half_m: half lengths and half widths [..., N, 2].
        centre_m: from the origins to the middles, forwards and to the left [..., N, 2].
        margin_m: a gap of this size beside each other counts as a collision; a number, or [..., 1].
    """
    road = wholes[..., Whole.ROAD]
    met = (road == road[..., :1]) & (road[..., :1] >= 0)
    met &= (wholes[..., Whole.PRESENT] != 0) & (half_m[..., 0] > 0.0)
    boxes = road_boxes(reals, half_m, centre_m)
    times = time_to_collision_s(boxes, margin_m)
    # Who comes up from behind, and is faster, looks ahead himself.
    way = np.where(boxes.velocity_mps[0][..., :1] >= 0.0, 1.0, -1.0)
    behind = way * (boxes.middle_m[0][..., 1:] - boxes.middle_m[0][..., :1]) < 0.0
    out = ~met[..., 1:] | behind | (times > LOOK_S)
    nearest: np.ndarray = np.where(out, np.inf, times).min(axis=-1, initial=np.inf)
    return nearest
