"""Radar detections as objects: grouped by place, as fast as the strongest of them.

A detection has no ends. What stands and what moves is told by the radial speed that a standing
thing would have, minus the car's own along the ray (Kellner et al. 2013).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from devkit.fusion.functions import powers_of_ten, rounded, rounded_sine_cosine

RANGE, AZIMUTH, ELEVATION, RADIAL, RCS, SNR = range(6)
"""Columns of a detection: range [m], azimuth, positive left [rad], elevation [rad], relative radial
speed, positive away [m/s], radar cross section [dBsm], signal over noise [dB]."""

HIGH_M, LOW_M = 2.5, -1.0
"""Detections above or below these heights are of bridges, manhole covers and mirrors [m]."""
GROUP_M = 2.0
"""Detections nearer to each other are of one object [m]."""
RCS_MIN_DBSM, RCS_MOVES_DBSM = -5.0, -25.0
"""Weaker ones are of kerbs and cans, where nothing moves, and of no person where something does
[dBsm]."""
STANDS_MPS = 0.7
"""Slower over ground is standing [m/s]."""
DRIFT_MAX_MPS, DRIFT_PLACES_MIN = 2.5, 6
"""Weak echoes below this speed tell the error of the car's own, if they come from so many metres of
road [m/s, -]."""
SPEED_SIGMA_MPS, LONE_SIGMA_MPS = 0.3, 0.8
"""Deviation of the speed of several echoes that are equally fast, and of one that moves alone: it
may be of a wheel [m/s]."""
HALF_WIDTH_M = 0.3
"""An object reaches at least so far to both sides of its detections [m]."""
_Point = tuple[float, float, float, float, float, float]
"""x, y [m], speed over ground along the ray [m/s], RCS [dBsm], sine of the ray's direction, and the
RCS as an area [m^2]."""
ANGLE_SIGMA_RAD = 0.02
"""Deviation of an azimuth [rad]."""
ROAD_HALF_M = 12.0
"""Detections further aside are left out where nothing moves [m]."""
SIDE_MAX_M, CROSSES_MPS = 36.0, 2.0
"""Those of what moves so fast are looked at up to here [m, m/s]."""


@dataclass(frozen=True, slots=True)
class RadarView:
    """Where the radar sits."""

    position_m: tuple[float, float, float]
    yaw_rad: float


class EchoGroup(NamedTuple):
    """Detections of one object."""

    x_m: float
    sigma_m: float
    right_m: float
    left_m: float
    over_ground_mps: float
    """Radial speed over ground, positive: away."""
    speed_sigma_mps: float
    """Its deviation."""
    ray_y: float
    """Sine of its ray's direction, left positive [-]."""

    @property
    def beside(self) -> bool:
        """Whether it is further aside than :data:`ROAD_HALF_M`."""
        return max(self.right_m, -self.left_m) > ROAD_HALF_M


@dataclass(frozen=True, slots=True, eq=False)
class Mounts:
    """Motion of the cars that radars are mounted on, arrays [F] of as many frames."""

    speed_mps: np.ndarray
    """Speed of the ego."""
    yaw_rate_radps: np.ndarray
    """Yaw rate of the ego, left positive."""
    dive_rad: np.ndarray
    """Pitch of the ego against the road, nose down positive: what is ahead looks higher."""


def group_frames(
    frames: Sequence[np.ndarray], view: RadarView, mounts: Mounts
) -> list[list[EchoGroup]]:
    """Objects of F radar frames, the nearest first and those along the road before those beside.

    Places and speeds are computed for all frames at once, element by element, so no number of a
    frame depends on another.

    Args:
        frames: float32 [N, 6] each.
        view: of the radars.
        mounts: of the cars.
    """
    counts = [len(frame) for frame in frames]
    rows = np.concatenate(frames).astype(np.float64)
    frame = np.repeat(np.arange(len(counts)), counts)
    kept = np.flatnonzero(np.isfinite(rows).all(axis=1))
    rows, frame = rows[kept], frame[kept]
    x, y, over_ground, ray_y, seen = _placed(rows, frame, view, mounts)
    rcs = rows[:, RCS]
    drift = _drifts(x, y, over_ground, rcs, np.where(seen, frame, -1), len(counts))
    over_ground = over_ground - drift[frame]
    speed = np.abs(over_ground)
    seen &= ((np.abs(y) <= ROAD_HALF_M) | (speed >= CROSSES_MPS)) & (
        (rcs >= RCS_MIN_DBSM) | ((speed >= STANDS_MPS) & (rcs >= RCS_MOVES_DBSM))
    )
    weight = rounded(powers_of_ten(0.1 * rcs[seen]))
    columns = (
        *(values[seen].tolist() for values in (x, y, over_ground, rcs, ray_y)),
        weight.tolist(),
    )
    points = list(zip(*columns, strict=True))
    bounds = np.searchsorted(frame[seen], np.arange(len(counts) + 1)).tolist()
    return [_grouped(sorted(points[first:last])) for first, last in pairwise(bounds)]


def _placed(
    rows: np.ndarray, frame: np.ndarray, view: RadarView, mounts: Mounts
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x, y [m], speed over ground along the ray [m/s], sine of the ray's direction of detections,
    and whether one is where objects are looked for; ``frame``: number of its frame."""
    sine, cosine = rounded_sine_cosine(view.yaw_rad + rows[:, AZIMUTH])
    up, flat = rounded_sine_cosine(rows[:, ELEVATION])
    height_m = view.position_m[2] + rows[:, RANGE] * (up - mounts.dive_rad[frame])
    flat_m = rows[:, RANGE] * flat
    x, y = view.position_m[0] + flat_m * cosine, view.position_m[1] + flat_m * sine
    # The mount moves forward with the car, and aside when it turns.
    forward = mounts.speed_mps - mounts.yaw_rate_radps * view.position_m[1]
    aside = mounts.yaw_rate_radps * view.position_m[0]
    over_ground = rows[:, RADIAL] + forward[frame] * cosine + aside[frame] * sine
    seen = (height_m > LOW_M) & (height_m < HIGH_M) & (x > 0.0) & (np.abs(y) <= SIDE_MAX_M)
    return x, y, over_ground, sine, seen


def _drifts(
    x: np.ndarray,
    y: np.ndarray,
    over_ground: np.ndarray,
    rcs: np.ndarray,
    frame: np.ndarray,
    frames: int,
) -> np.ndarray:
    """Speed over ground of the road and the kerbs of each frame, which stand: the error of the
    car's own speed, about 1 m/s when it brakes hard and pitches. The median of weak echoes, one of
    each metre ahead, since who walks on the footway has a dozen of them; 0 if there are few."""
    weak = (np.abs(y) <= ROAD_HALF_M) & (rcs < RCS_MIN_DBSM) & (np.abs(over_ground) < DRIFT_MAX_MPS)
    speeds, metre, frame = over_ground[weak], np.floor(x[weak]), frame[weak]
    drifts = np.zeros(frames)
    for index in range(frames):
        here = frame == index
        of_frame, at = speeds[here], metre[here]
        order = np.lexsort((of_frame, at))
        _, first, count = np.unique(at[order], return_index=True, return_counts=True)
        if len(first) >= DRIFT_PLACES_MIN:
            middles = np.sort(of_frame[order][first + count // 2])
            drifts[index] = middles[len(middles) // 2]
    return drifts


def _grouped(points: list[_Point]) -> list[EchoGroup]:
    """Groups of one frame's points, which come sorted: each joins the first group that has one near
    it."""
    if not points:
        return []
    x, y, speed = np.array([point[:3] for point in points]).T
    near = (np.abs(x[:, None] - x) < GROUP_M) & (np.abs(y[:, None] - y) < GROUP_M)
    # What comes is not what drives ahead beside it, though wheels and limbs are slow and fast.
    near &= ~((speed[:, None] > STANDS_MPS) & (speed < -STANDS_MPS))
    near &= near.T
    groups: list[list[_Point]] = []
    group_of: list[int] = []
    later, earlier = np.nonzero(np.tril(near, -1))
    pairs = iter(zip(later.tolist(), earlier.tolist(), strict=True))
    pair = next(pairs, None)
    for index, point in enumerate(points):
        least = len(groups)
        while pair is not None and pair[0] == index:
            least = min(least, group_of[pair[1]])
            pair = next(pairs, None)
        if least == len(groups):
            groups.append([])
        groups[least].append(point)
        group_of.append(least)
    return sorted((_group(group) for group in groups), key=lambda group: group.beside)


def _group(points: list[_Point]) -> EchoGroup:
    if len(points) == 1:
        ((x, y, speed, _, ray_y, _),) = points
        speed_sigma = SPEED_SIGMA_MPS if abs(speed) < STANDS_MPS else LONE_SIGMA_MPS
        ends = y - HALF_WIDTH_M, y + HALF_WIDTH_M
        return EchoGroup(x, 0.3 + ANGLE_SIGMA_RAD * abs(y), *ends, speed, speed_sigma, ray_y)
    # Wheels turn and limbs swing: their echoes are slower and faster than the body's, and weaker
    # as a rule. How far they are apart says how sure the speed is.
    strongest = max(points, key=lambda point: (point[3], point[2]))
    speed = strongest[2]
    total, spread = 1e-9, 0.0
    for _, _, over_ground, _, _, weight in points:  # Python's own sum adds otherwise from 3.12 on
        total += weight
        spread += weight * (over_ground - speed) * (over_ground - speed)
    ys = [point[1] for point in points]
    return EchoGroup(
        points[0][0],
        0.3 + ANGLE_SIGMA_RAD * abs(ys[0]),
        min(ys) - HALF_WIDTH_M,
        max(ys) + HALF_WIDTH_M,
        speed,
        SPEED_SIGMA_MPS + math.sqrt(spread / total),
        strongest[4],
    )
