"""Radar detections as objects: grouped by place, as fast as the strongest of them.

A detection has no ends. What stands and what moves is told by the radial speed that a standing
thing would have, minus the car's own along the ray (Kellner et al. 2013).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from devkit.fusion.functions import power_of_ten, rounded_sine_cosine

RANGE, AZIMUTH, ELEVATION, RADIAL, RCS, SNR = range(6)
"""Columns of a detection: range [m], azimuth, positive left [rad], elevation [rad], relative radial
speed, positive away [m/s], radar cross section [dBsm], signal over noise [dB]."""

HIGH_M, LOW_M = 2.5, -1.0
"""Detections above or below these heights are of bridges, manhole covers and mirrors [m]."""
GROUP_M = 2.0
"""Detections nearer to each other are of one object [m]."""
RCS_MIN_DBSM = -5.0
"""Weaker ones are of kerbs and cans, where nothing moves [dBsm]."""
STANDS_MPS = 0.7
"""Slower over ground is standing [m/s]."""
DRIFT_MAX_MPS, DRIFT_ECHOES_MIN = 2.5, 6
"""Weak echoes below this speed tell the error of the car's own, if there are so many [m/s, -]."""
SPEED_SIGMA_MPS, LONE_SIGMA_MPS = 0.3, 0.8
"""Deviation of the speed of several echoes that are equally fast, and of one that moves alone: it
may be of a wheel [m/s]."""
HALF_WIDTH_M = 0.3
"""An object reaches at least so far to both sides of its detections [m]."""
_Point = tuple[float, float, float, float, float]
"""x, y [m], speed over ground along the ray [m/s], RCS [dBsm], sine of the ray's direction."""
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


@dataclass(frozen=True, slots=True)
class EchoGroup:
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


def group_detections(
    detections: np.ndarray,
    view: RadarView,
    speed_mps: float,
    yaw_rate_radps: float,
    dive_rad: float = 0.0,
) -> list[EchoGroup]:
    """Objects of one radar frame, the nearest first and those along the road before those beside.

    Args:
        detections: float32 [N, 6].
        view: of the radar.
        speed_mps: of the ego.
        yaw_rate_radps: likewise.
        dive_rad: its pitch against the road, nose down positive: what is ahead looks higher.
    """
    points = []
    rows = detections.astype(np.float64)
    sines, cosines = rounded_sine_cosine(view.yaw_rad + rows[:, AZIMUTH])
    rises, flats = rounded_sine_cosine(rows[:, ELEVATION])
    for row, sine, cosine, up, flat in zip(
        rows.tolist(), sines, cosines, rises, flats, strict=True
    ):
        if not all(math.isfinite(value) for value in row):
            continue
        flat_m = row[RANGE] * flat
        rise = up - dive_rad
        height_m = view.position_m[2] + row[RANGE] * rise
        if not LOW_M < height_m < HIGH_M:
            continue
        x, y = view.position_m[0] + flat_m * cosine, view.position_m[1] + flat_m * sine
        if x <= 0.0 or abs(y) > SIDE_MAX_M:
            continue
        # The mount moves forward with the car, and aside when it turns.
        mount_vx = speed_mps - yaw_rate_radps * view.position_m[1]
        mount_vy = yaw_rate_radps * view.position_m[0]
        over_ground = row[RADIAL] + mount_vx * cosine + mount_vy * sine
        points.append((x, y, over_ground, row[RCS], sine))
    drift = _drift(points)
    points = [
        (x, y, over_ground - drift, rcs, sine)
        for x, y, over_ground, rcs, sine in points
        if (abs(y) <= ROAD_HALF_M or abs(over_ground - drift) >= CROSSES_MPS)
        and (rcs >= RCS_MIN_DBSM or abs(over_ground - drift) >= STANDS_MPS)
    ]
    points.sort()
    groups: list[list[_Point]] = []
    for point in points:
        for group in groups:
            if any(_together(point, other) for other in group):
                group.append(point)
                break
        else:
            groups.append([point])
    return sorted((_group(group) for group in groups), key=lambda group: group.beside)


def _drift(points: list[_Point]) -> float:
    """Speed over ground of the road and the kerbs, which stand: the error of the car's own speed,
    about 1 m/s when it brakes hard and pitches. The median of weak echoes; 0 if there are few."""
    near = [(v, rcs) for _, y, v, rcs, _ in points if abs(y) <= ROAD_HALF_M]
    weak = sorted(v for v, rcs in near if rcs < RCS_MIN_DBSM and abs(v) < DRIFT_MAX_MPS)
    return weak[len(weak) // 2] if len(weak) >= DRIFT_ECHOES_MIN else 0.0


def _together(a: _Point, b: _Point) -> bool:
    return abs(a[0] - b[0]) < GROUP_M and abs(a[1] - b[1]) < GROUP_M


def _group(points: list[_Point]) -> EchoGroup:
    # Wheels turn and limbs swing: their echoes are slower and faster than the body's, and weaker
    # as a rule. How far they are apart says how sure the speed is.
    strongest = max(points, key=lambda point: (point[3], point[2]))
    speed = strongest[2]
    total, spread = 1e-9, 0.0
    for point in points:  # Python's own sum adds otherwise from version 3.12 on
        weight = round(power_of_ten(0.1 * point[3]), 9)
        total += weight
        spread += weight * (point[2] - speed) * (point[2] - speed)
    least = SPEED_SIGMA_MPS if len(points) > 1 or abs(speed) < STANDS_MPS else LONE_SIGMA_MPS
    ys = [point[1] for point in points]
    sigma = 0.3 + ANGLE_SIGMA_RAD * abs(ys[0])
    return EchoGroup(
        points[0][0],
        sigma,
        min(ys) - HALF_WIDTH_M,
        max(ys) + HALF_WIDTH_M,
        speed,
        least + math.sqrt(spread / total),
        strongest[4],
    )
