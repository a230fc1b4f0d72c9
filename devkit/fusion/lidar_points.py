"""Points of a LiDAR sweep in the car's axes, and the ground under them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from devkit.fusion.functions import rounded_sine_cosine
from schemas.messages import LidarSite
from schemas.sections.lidar import POINT_COLUMNS

X, _Y, _Z, _TIME = (POINT_COLUMNS.index(name) for name in ("x_m", "y_m", "z_m", "time_s"))
"""Columns of a point; a ray without a return has NaN."""
HALF_WIDTH_M = 36.0
"""Points further aside are left out: who comes from there at 25 m/s is in the path after 1.4 s
[m]."""
NEAR_M = 2.6
"""Points nearer to the rear axle lie on the car itself or behind it [m]."""
CELL_M = 0.5
"""Side of a cell of the grid [m]."""
GROUND_BAND_M = 0.25
"""Points as near to the expected ground belong to it [m]."""
GROUND_FROM_M, GROUND_TO_M = 5.0, 25.0
"""The ground is fitted between these distances [m]."""
GROUND_POINTS_MIN = 30
"""Fewer points fit no ground: it is taken to be flat."""
FIT_ROUNDS = 3
"""Rounds of the ground's fit; each takes the points near the last one's."""
PITCH_MAX = 0.08
"""Steepest ground in the car's axes, its own pitch included [-]."""
FIELD_RAD = 0.72
"""Vertical field of view that the channels are taken to share [rad]."""


@dataclass(frozen=True, slots=True)
class LidarView:
    """One LiDAR as the stack knows it: where it sits, and how dense its rays are."""

    rotation: tuple[tuple[float, float, float], ...]
    position_m: tuple[float, float, float]
    rays_in_cell: float
    """Rays through the front of a cell 1 m away, 1.2 m high; falls with the squared distance."""

    @classmethod
    def of_site(cls, site: LidarSite) -> LidarView:
        """The view of a LiDAR; ``site`` stands in the episode."""
        angles = np.array([math.radians(angle) for angle in site.rotation_deg])
        sines, cosines = rounded_sine_cosine(angles)
        (sr, sp, sy), (cr, cp, cy) = sines.tolist(), cosines.tolist()
        rotation = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        rays = site.columns / (2.0 * math.pi) * site.channels / FIELD_RAD * CELL_M * 1.2
        x_m, y_m, z_m = site.position_m
        return cls(rotation, (x_m, y_m, z_m), rays)


def in_vehicle_axes(
    points: np.ndarray, view: LidarView, speed_mps: float, range_m: float, *, deskewed: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, z of the points ahead, float64 [P] each.

    Args:
        points: float32 [N, K], a sweep.
        view: of the LiDAR.
        speed_mps: of the ego; moves points that are not those of the tick.
        range_m: points further ahead are left out.
        deskewed: whether the points are those of the tick already.
    """
    x = _along(view, 0, points)
    if not deskewed:
        x += speed_mps * points[:, _TIME]
    # Comparisons with NaN, a ray without a return, are false. Most of a sweep lies behind.
    ahead = np.flatnonzero((x > NEAR_M) & (x < range_m))
    points = points.take(ahead, axis=0)  # four times as fast as an index in brackets
    y = _along(view, 1, points, whole=True)
    kept = np.flatnonzero((y < HALF_WIDTH_M) & (y > -HALF_WIDTH_M))
    z = _along(view, 2, points.take(kept, axis=0), whole=True)
    return x.take(ahead.take(kept)), y.take(kept), z


def _along(view: LidarView, axis: int, points: np.ndarray, *, whole: bool = False) -> np.ndarray:
    """Places of points along an axis of the vehicle, float64 [N].

    To read a column of a whole sweep takes longer than all sums with it, so one with a factor of 0
    is left out; with ``whole`` it is not, and a place that has no number along one axis has none.
    """
    first, *others = view.rotation[axis]
    along: np.ndarray = np.multiply(points[:, X], first, dtype=np.float64)
    for factor, column in zip(others, (_Y, _Z), strict=True):
        if factor != 0.0 or whole:
            along += np.multiply(points[:, column], factor, dtype=np.float64)
    along += view.position_m[axis]
    return along


def ground(x_m: np.ndarray, z_m: np.ndarray) -> tuple[float, float]:
    """Height at the rear axle and slope of the road in the car's axes: z = a + b x.

    The car pitches when it brakes: a flat road then rises by 3 m per 100 m, and its points would
    stand as high as obstacles. A least-squares line through the lowest points, three rounds.
    """
    lowest_m, slope = 0.0, 0.0
    near = (x_m > GROUND_FROM_M) & (x_m < GROUND_TO_M)
    x, z = x_m[near], z_m[near]
    band_m = 3.0 * GROUND_BAND_M
    for _ in range(FIT_ROUNDS):
        road = np.abs(z - (lowest_m + slope * x)) < band_m
        n = int(road.sum())
        if n < GROUND_POINTS_MIN:
            break
        u, v = x[road], z[road]
        mean_x, mean_z = float(u.sum()) / n, float(v.sum()) / n
        u = u - mean_x
        spread = float((u * u).sum())
        slope = float((u * v).sum()) / spread if spread > 1.0 else 0.0
        slope = min(max(slope, -PITCH_MAX), PITCH_MAX)
        lowest_m = mean_z - slope * mean_x
        band_m = GROUND_BAND_M
    return lowest_m, slope
