"""Radar detections as objects: grouped by place and speed over ground.

A detection has no ends. What stands and what moves is told by the radial speed that a standing
thing would have, minus the car's own along the ray (Kellner et al. 2013).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

RANGE, AZIMUTH, ELEVATION, RADIAL, RCS, SNR = range(6)
"""Columns of a detection: range [m], azimuth, positive left [rad], elevation [rad], relative radial
speed, positive away [m/s], radar cross section [dBsm], signal over noise [dB]."""

HIGH_M, LOW_M = 2.5, -1.0
"""Detections above or below these heights are of bridges, manhole covers and mirrors [m]."""
GROUP_M = 2.0
"""Detections nearer to each other are of one object [m]."""
GROUP_MPS = 1.0
"""The same for their speeds [m/s]."""
RCS_MIN_DBSM = -5.0
"""Weaker ones are of kerbs and cans, where nothing moves [dBsm]."""
STANDS_MPS = 0.7
"""Slower over ground is standing [m/s]."""
HALF_WIDTH_M = 0.3
"""An object reaches at least so far to both sides of its detections [m]."""
ANGLE_SIGMA_RAD = 0.02
"""Deviation of an azimuth [rad]."""
SIDE_MAX_M = 12.0
"""Detections further aside are left out [m]."""


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


def group_detections(
    detections: np.ndarray, view: RadarView, speed_mps: float, yaw_rate_radps: float
) -> list[EchoGroup]:
    """Objects of one radar frame, the nearest first.

    Args:
        detections: float32 [N, 6].
        view: of the radar.
        speed_mps: of the ego.
        yaw_rate_radps: likewise.
    """
    points = []
    for row in detections.astype(np.float64).tolist():
        if not all(math.isfinite(value) for value in row):
            continue
        angle = view.yaw_rad + row[AZIMUTH]
        # Rounded: sines of C libraries differ in their last bits.
        cosine, sine = round(math.cos(angle), 9), round(math.sin(angle), 9)
        flat_m = row[RANGE] * round(math.cos(row[ELEVATION]), 9)
        height_m = view.position_m[2] + row[RANGE] * round(math.sin(row[ELEVATION]), 9)
        if not LOW_M < height_m < HIGH_M:
            continue
        x, y = view.position_m[0] + flat_m * cosine, view.position_m[1] + flat_m * sine
        if x <= 0.0 or abs(y) > SIDE_MAX_M:
            continue
        # The mount moves forward with the car, and aside when it turns.
        mount_vx = speed_mps - yaw_rate_radps * view.position_m[1]
        mount_vy = yaw_rate_radps * view.position_m[0]
        over_ground = row[RADIAL] + mount_vx * cosine + mount_vy * sine
        if row[RCS] < RCS_MIN_DBSM and abs(over_ground) < STANDS_MPS:
            continue
        points.append((x, y, over_ground, flat_m))
    points.sort()
    groups: list[list[tuple[float, float, float, float]]] = []
    for point in points:
        for group in groups:
            if any(_together(point, other) for other in group):
                group.append(point)
                break
        else:
            groups.append([point])
    return [_group(group) for group in groups]


def _together(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    near = abs(a[0] - b[0]) < GROUP_M and abs(a[1] - b[1]) < GROUP_M
    return near and abs(a[2] - b[2]) < GROUP_MPS


def _group(points: list[tuple[float, float, float, float]]) -> EchoGroup:
    speeds = sorted(point[2] for point in points)
    ys = [point[1] for point in points]
    sigma = 0.3 + ANGLE_SIGMA_RAD * abs(ys[0])
    return EchoGroup(
        points[0][0],
        sigma,
        min(ys) - HALF_WIDTH_M,
        max(ys) + HALF_WIDTH_M,
        speeds[len(speeds) // 2],
    )
