"""Where the parts of a generated street lie: lines across, blocks along, side streets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.world.scene import Scene

SIDE_WALK_M = 2.6
"""Width of the sidewalks of side streets [m]."""
SIDE_REACH_M = 74.0
"""Side streets end this far from the axis of the street [m]."""
CORNER_M = 6.5
"""Nothing is parked or planted this close to a side street [m]."""

Hull = tuple[float, float, float, float, float]
"""Centre x, y [m], yaw [rad], half length, half width [m]."""


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of the street between two side streets, world x [m]."""

    start: float
    end: float
    opens: bool
    """A side street lies before it."""
    closes: bool
    """A side street lies behind it."""

    @property
    def walls(self) -> tuple[float, float]:
        """Where its rows of buildings begin and end, behind the sidewalks of the side streets."""
        return (
            self.start + SIDE_WALK_M * self.opens,
            self.end - SIDE_WALK_M * self.closes,
        )

    @property
    def parking(self) -> tuple[float, float]:
        """Where parking places begin and end: clear of crossings."""
        return self.start + CORNER_M, self.end - CORNER_M


@dataclass(frozen=True, slots=True)
class Layout:
    """Lines across the street, world y [m], and its blocks."""

    kerb_right: float
    kerb_left: float
    wall_right: float
    wall_left: float
    middle: float
    """Between the two lanes."""
    blocks: tuple[Block, ...]
    sides: tuple[float, ...]
    """Centres of the side streets, world x [m]."""
    half_side: float
    """Half the width of a side street's roadway [m]."""

    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """Kerb, wall and the sign of the way outwards, right side first."""
        return (
            (self.kerb_right, self.wall_right, -1.0),
            (self.kerb_left, self.wall_left, 1.0),
        )


def lay_out(scene: Scene) -> Layout:
    """The lines of the scene's street."""
    road = scene.road
    right = -road.lane_width_m / 2 - road.parking_width_m
    left = 1.5 * road.lane_width_m + road.parking_width_m
    half = road.cross_street_width_m / 2
    sides = tuple(sorted(road.cross_streets_m))
    edges = [road.start_m]
    for centre in sides:
        edges += [centre - half, centre + half]
    edges.append(road.end_m)
    pairs = list(zip(edges[::2], edges[1::2], strict=True))
    blocks = tuple(
        Block(a, b, i > 0, i < len(pairs) - 1) for i, (a, b) in enumerate(pairs) if b - a > 4.0
    )
    return Layout(
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
