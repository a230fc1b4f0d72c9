"""Places of the parts of a generated street: lines across, blocks along, side streets.

Street coordinates: x along the street from ``road.start_m`` on, y to the left of the ego's lane. Of
a straight street they are the world's; a road with a path bends them along its lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.road.lane import LanePath
from twin.world.scene import Scene

SIDE_WALK_M = 2.6
"""Width of the sidewalks of side streets [m]."""
SIDE_REACH_M = 74.0
"""Side streets end this far from the axis of the street [m]."""
CORNER_M = 6.5
"""Nothing is parked or planted this close to a side street [m]."""

STREET_ENDS_M = 12.0
"""A straight street goes on this far behind its ends, up to the houses that close it [m]."""
SQUARE_RADIUS_M = 20.0
"""Inside of a curve whose walls would lie as near as this to its centre is a square [m]."""
PARKING_RADIUS_M = 45.0
"""Nobody parks in tighter curves [m]."""
_CLEAR_M = 0.3
_SAGITTA_M = 0.008
"""Lines along curves are drawn to this [m]."""

Hull = tuple[float, float, float, float, float]
"""Centre x, y [m], yaw [rad], half length, half width [m]."""


@dataclass(frozen=True, slots=True)
class StreetBlock:
    """A stretch of the street between two side streets, or a piece of a path; x [m]."""

    start: float
    end: float
    opens: bool
    """A side street lies before it."""
    closes: bool
    """A side street lies behind it."""
    curvature: float = 0.0
    """Curvature of the lane, to the left [1/m]."""

    @property
    def walls(self) -> tuple[float, float]:
        """Beginning and end of its rows of buildings, behind the sidewalks of the side streets."""
        return (
            self.start + SIDE_WALK_M * self.opens,
            self.end - SIDE_WALK_M * self.closes,
        )

    @property
    def parking(self) -> tuple[float, float]:
        """Beginning and end of parking places: clear of crossings and tight curves."""
        if abs(self.curvature) * PARKING_RADIUS_M > 1.0:
            return self.start, self.start
        return self.start + CORNER_M, self.end - CORNER_M


@dataclass(frozen=True, slots=True)
class Layout:
    """Lines across the street, y [m], and its blocks; all in street coordinates."""

    lane: LanePath
    start: float
    """Beginning of the street, x [m]."""
    end: float
    ends: float
    """The street goes on this far before its start and behind its end [m]."""
    kerb_right: float
    kerb_left: float
    wall_right: float
    wall_left: float
    middle: float
    """Between the two lanes."""
    blocks: tuple[StreetBlock, ...]
    sides: tuple[float, ...]
    """Centres of the side streets, x [m]."""
    half_side: float
    """Half the width of a side street's roadway [m]."""

    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """Kerb, wall and the sign of the way outwards, right side first."""
        return (
            (self.kerb_right, self.wall_right, -1.0),
            (self.kerb_left, self.wall_left, 1.0),
        )

    def at(self, x: float, y: float, yaw: float = 0.0) -> tuple[float, float, float]:
        """World x, y [m] and yaw [rad] of a place on the street."""
        if not self.lane.closed:
            return x, y, yaw
        pose = self.lane.at(x - self.start, y)
        return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad) + yaw

    def on_street(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether world points lie between the walls of a closed street."""
        lateral = self.lane.locate(x, y).lateral_m
        return (lateral > self.wall_right - _CLEAR_M) & (lateral < self.wall_left + _CLEAR_M)

    def centre_distance(self, block: StreetBlock, y: float) -> float:
        """Distance from the centre of a curved block to its line at ``y`` [m]."""
        return abs(1.0 / block.curvature - y)

    def has_square(self, block: StreetBlock, sign: float) -> bool:
        """Whether the curve ``block`` has a square, not buildings, on the side ``sign``."""
        wall = self.wall_left if sign > 0 else self.wall_right
        inside = block.curvature * sign > 0.0
        return inside and self.centre_distance(block, wall) < SQUARE_RADIUS_M

    def square_beside(self, block: StreetBlock, step: int, sign: float) -> bool:
        """Whether the block after (``step`` 1) or before (-1) has a square on the side ``sign``."""
        if not self.lane.closed:
            return False
        other = (self.blocks.index(block) + step) % len(self.blocks)
        return self.has_square(self.blocks[other], sign)

    @property
    def bend(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Moves points [n, 3] from street coordinates into the world; None: they are the same."""
        return self._bent if self.lane.closed else None

    def _bent(self, points: np.ndarray) -> np.ndarray:
        pose = self.lane.at(points[:, 0] - self.start, points[:, 1])
        return np.stack([pose.x_m, pose.y_m, points[:, 2]], axis=1)

    def cuts(self, x0: float, x1: float, count: int) -> np.ndarray:
        """Places at which to cut what lies along the street from ``x0`` to ``x1``.

        In ``count`` equal pieces where the street is straight. In a curve at the same places
        whatever is cut, so that edges of neighbours meet, and as finely as lines need it.
        """
        if not self.lane.closed:
            return np.linspace(x0, x1, count + 1)
        pitch = (x1 - x0) / count
        inside = [np.array([x0, x1])]
        for block in self.blocks:
            low, high = max(x0, block.start), min(x1, block.end)
            if high - low < 1e-6:
                continue
            if block.curvature == 0.0:
                inside.append(np.linspace(low, high, max(1, math.ceil((high - low) / pitch)) + 1))
                continue
            widest = 1.0 / abs(block.curvature) + max(self.wall_left, -self.wall_right)
            steps = math.ceil(
                (block.end - block.start)
                * abs(block.curvature)
                * math.sqrt(widest / _SAGITTA_M / 8)
            )
            fixed = np.linspace(block.start, block.end, steps + 1)
            inside.append(fixed[(fixed > low - 1e-6) & (fixed < high + 1e-6)])
        cuts = np.sort(np.concatenate(inside))
        return cuts[np.append(True, np.diff(cuts) > 1e-6)]


def lay_out(scene: Scene) -> Layout:
    """The lines of the scene's street."""
    road = scene.road
    right = -road.lane_width_m / 2 - road.parking_width_m
    left = 1.5 * road.lane_width_m + road.parking_width_m
    half = road.cross_street_width_m / 2
    lane = road.lane()
    sides = tuple(sorted(road.cross_streets_m))
    if lane.closed:
        edges = [*(road.start_m + lane.station_m).tolist(), road.start_m + lane.length_m]
        blocks = tuple(
            StreetBlock(a, b, False, False, bend)
            for (a, b), bend in zip(pairwise(edges), lane.curvature.tolist(), strict=True)
        )
    else:
        edges = [road.start_m]
        for centre in sides:
            edges += [centre - half, centre + half]
        edges.append(road.end_m)
        pairs = list(zip(edges[::2], edges[1::2], strict=True))
        blocks = tuple(
            StreetBlock(a, b, i > 0, i < len(pairs) - 1)
            for i, (a, b) in enumerate(pairs)
            if b - a > 4.0
        )
    return Layout(
        lane,
        edges[0],
        edges[-1],
        0.0 if lane.closed else STREET_ENDS_M,
        right,
        left,
        right - road.sidewalk_width_m,
        left + road.sidewalk_width_m,
        road.lane_width_m / 2,
        blocks,
        sides,
        half,
    )


def generator(scene: Scene, part: int) -> np.random.Generator:
    """Random numbers of one part of the street: changing a part leaves the others as they are."""
    return np.random.default_rng([scene.seed, part])
