"""Obstacles in a LiDAR sweep: ground taken away, cells counted, neighbours joined.

One slot at a time and sums along one axis only, so neighbours in the rig change no bit. Nothing
here looks at the kind of a return: a real sensor does not know it. Fog, drops and flakes are told
from surfaces by how thinly they fill the space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from devkit.fusion.functions import rounded_sine_cosine
from devkit.fusion.path import CarPath
from schemas.messages import LidarSite
from schemas.sections.lidar import POINT_COLUMNS

_X, _Y, _Z, _TIME = (POINT_COLUMNS.index(name) for name in ("x_m", "y_m", "z_m", "time_s"))

ROAD_HALF_M = 9.0
"""Half width of what is looked at along the road [m]."""
HALF_WIDTH_M = 36.0
"""Points further aside are left out: who comes from there at 25 m/s is in the path after 1.4 s
[m]."""
BESIDE_POINTS_MIN = 3
"""Fewest points of what is beside the road: a motorcycle has no more at 40 m, and what is there has
to be seen again and again [-]."""
COMPACT_M = 6.5
"""What reaches further, along or across, is no car or motorcycle that crosses [m]."""
CROSSING_S, CROSSING_MIN_M = 2.6, 8.0
"""Who crosses is looked for where the car will be within this time, at least so far ahead
[s, m]."""
CROSSING_MAX_MPS = 25.0
"""Fastest who crosses: what is further aside than he goes until the car is there does not matter
[m/s]."""
NEAR_M = 2.6
"""Points nearer to the rear axle lie on the car itself or behind it [m]."""
CELL_M = 0.5
"""Side of a cell of the grid [m]."""
LOW_M, HIGH_M = 0.3, 2.2
"""Height of obstacles above the ground: above kerbs, below what a car drives under [m]."""
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
FILL_MIN = 0.15
"""Share of the rays through a cell's front, 1.2 m high, that must come back from it [-]."""
EDGE_POINTS = 2
"""Outermost points of an obstacle that are not its edge: mixed pixels."""


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
        (sr, sp, sy), (cr, cp, cy) = rounded_sine_cosine(angles)
        rotation = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        rays = site.columns / (2.0 * math.pi) * site.channels / FIELD_RAD * CELL_M * 1.2
        x_m, y_m, z_m = site.position_m
        return cls(rotation, (x_m, y_m, z_m), rays)


class SweepObjects(NamedTuple):
    """Obstacles of one sweep, the nearest first and those along the road before those beside it, in
    arrays [M]."""

    x_m: np.ndarray
    """Near end."""
    right_m: np.ndarray
    left_m: np.ndarray
    inside: np.ndarray
    """bool: enough points are in the path."""
    path_x_m: np.ndarray
    """Nearest part in the path; ``x_m`` where it is outside."""
    beside: np.ndarray
    """bool: further aside than :data:`ROAD_HALF_M`; these stand last."""
    reach_m: float
    """The furthest one along the road; 0: there is none."""
    free_to_m: float
    """The road in the path is seen up to here [m]."""
    returned: float
    """Share of the rays that came back, of all around the car [-]."""


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
    sensor = points[:, (_X, _Y, _Z)]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = view.rotation
    a, b, c = (sensor[:, axis].astype(np.float64) for axis in range(3))
    x = xx * a + xy * b + xz * c + view.position_m[0]
    if not deskewed:
        x = x + speed_mps * points[:, _TIME]
    y = yx * a + yy * b + yz * c + view.position_m[1]
    # Comparisons with NaN, a ray without a return, are false.
    kept = np.flatnonzero((x > NEAR_M) & (x < range_m) & (y < HALF_WIDTH_M) & (y > -HALF_WIDTH_M))
    z = zx * a[kept] + zy * b[kept] + zz * c[kept] + view.position_m[2]
    return x[kept], y[kept], z


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


def find_objects(
    points: np.ndarray,
    view: LidarView,
    *,
    speed_mps: float,
    path: CarPath,
    corridor_half_m: float,
    range_m: float,
    points_min: int,
    deskewed: bool,
) -> SweepObjects:
    """Obstacles of one sweep.

    Args:
        points: float32 [N, K], :data:`schemas.sections.lidar.POINT_COLUMNS`.
        view: of the LiDAR.
        speed_mps: of the ego.
        path: of the ego.
        corridor_half_m: half width of the path.
        range_m: points further ahead are left out.
        points_min: fewest points of an obstacle.
        deskewed: whether the points are those of the tick already.
    """
    returned = float(np.isfinite(points[:, _X]).sum()) / max(len(points), 1)
    x, y, z = in_vehicle_axes(points, view, speed_mps, range_m, deskewed=deskewed)
    road = np.abs(y) < ROAD_HALF_M
    lowest_m, slope = ground(x[road], z[road])
    height = z - (lowest_m + slope * x)
    low = np.abs(height) < LOW_M
    ways = x[low][np.abs(path.beside_arc_m(x[low], y[low])) < corridor_half_m]
    free_to_m = float(np.partition(ways, -5)[-5]) if len(ways) >= 5 else 0.0
    high = (height > LOW_M) & (height < HIGH_M)
    x, y = x[high], y[high]
    group = _groups(x, y, view, range_m)
    inside = path.holds(x, y, y, corridor_half_m)
    rows = []
    order = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[order], np.arange(1, int(group.max(initial=0)) + 2))
    for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        if last - first < BESIDE_POINTS_MIN:
            continue
        one = order[first:last]
        if np.ptp(x[one]) > COMPACT_M or np.ptp(y[one]) > COMPACT_M:
            one = one[np.abs(y[one]) < ROAD_HALF_M]
            if len(one) < points_min:
                continue
        xs, ys, within = np.sort(x[one]), np.sort(y[one]), np.sort(x[one[inside[one]]])
        skip = EDGE_POINTS if len(one) > 4 * EDGE_POINTS else 0
        into = len(within) >= points_min
        near_m, right_m, left_m = float(xs[skip]), float(ys[skip]), float(ys[-1 - skip])
        beside_m = max(right_m, -left_m)
        beside = beside_m > ROAD_HALF_M
        if len(one) < points_min and not beside:
            continue
        if beside and not _may_cross(near_m, beside_m, speed_mps):
            continue
        path_m = float(within[min(skip, len(within) - 1)]) if into else near_m
        rows.append((beside, near_m, right_m, left_m, into, path_m))
    rows.sort()
    beside, near, right, left, reaches, way = (
        np.array([row[i] for row in rows], bool if i in (0, 4) else float) for i in range(6)
    )
    along = near[~beside]
    reach_m = float(along[-1]) if len(along) else 0.0
    return SweepObjects(near, right, left, reaches, way, beside, reach_m, free_to_m, returned)


def _may_cross(x_m: float, beside_m: float, speed_mps: float) -> bool:
    """Whether what is so far aside could be in the path when the car is there, soon."""
    soon_m = max(CROSSING_S * speed_mps, CROSSING_MIN_M)
    return beside_m / CROSSING_MAX_MPS * speed_mps < x_m - NEAR_M < soon_m


def _groups(x: np.ndarray, y: np.ndarray, view: LidarView, range_m: float) -> np.ndarray:
    """Group of each point, from 1; 0: in a cell too thin to be a surface."""
    rows = math.ceil(range_m / CELL_M)
    columns = math.ceil(2.0 * HALF_WIDTH_M / CELL_M)
    row = np.minimum((x / CELL_M).astype(np.int64), rows - 1)
    column = np.minimum(((y + HALF_WIDTH_M) / CELL_M).astype(np.int64), columns - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns).reshape(rows, columns)
    ahead = np.maximum((np.arange(rows) + 0.5) * CELL_M - view.position_m[0], 1.0)
    aside = np.abs((np.arange(columns) + 0.5) * CELL_M - HALF_WIDTH_M)
    beside = aside > ROAD_HALF_M
    aside = np.where(beside, aside, 0.0)
    square = (ahead * ahead)[:, None] + aside * aside
    least = np.maximum(FILL_MIN * view.rays_in_cell / square, np.where(beside, 0.5, 1.5))
    group: np.ndarray = joined(count > least).reshape(-1)[cell]
    return group


def joined(solid: np.ndarray) -> np.ndarray:
    """Group of each cell, int64 [rows, columns]: 0 where it is not ``solid``, else from 1, the same
    for cells that touch along a side or at a corner.

    Every cell takes the least number around it, then that of the cell with this number, until
    nothing changes: some ten rounds.
    """
    wide = np.pad(solid, 1)  # so that every cell has eight around it
    cells = np.flatnonzero(wide)
    place = np.full(wide.size, len(cells))
    place[cells] = np.arange(len(cells))
    below = wide.shape[1]
    steps = np.array([-below - 1, -below, 1 - below, -1, 1, below - 1, below, below + 1])
    around = place[cells + steps[:, None]]
    number = np.arange(len(cells) + 1)  # the last stands for cells that are not solid
    while True:
        least = np.minimum(number[:-1], number[around].min(axis=0))
        least = least[least]
        if np.array_equal(least, number[:-1]):
            break
        number[:-1] = least
    group = np.zeros(solid.shape, np.int64)
    group[solid] = np.unique(number[:-1], return_inverse=True)[1] + 1
    return group
