"""Heights of those who walk or ride along a line: who leaves a footway steps down from its kerb."""

from __future__ import annotations

import itertools
import math

import numpy as np
from msgspec.structs import replace

from twin.road.thinning import kept_points
from twin.scenario.storyboard.native.ground import ScenarioGround
from twin.scenario.storyboard.program.places import FixedPosition

_SAMPLES_MAX = 4000
_SAMPLE_M = 0.05
_REACH = 5
"""A height is the mean over so many samples on either side: a kerb takes half a metre, as of one
foot before the other, or of two wheels."""
_CLOSE_M = 0.005
"""The straight lines from one point to the next keep within this of the heights [m]."""
_GRID = 1e6


def footed(points: list[FixedPosition], ground: ScenarioGround) -> list[FixedPosition]:
    """The points of a line, and between them those where the ground begins to rise or fall.

    Where no road lies below, heights change evenly between two points. Lines over level ground stay
    as they are. Points in between have places in the world alone.
    """
    found = points[:1]
    for one, other in itertools.pairwise(points):
        found += [*_between(one, other, ground), other]
    return found


def _between(
    one: FixedPosition, other: FixedPosition, ground: ScenarioGround
) -> list[FixedPosition]:
    ahead, aside = other.x_m - one.x_m, other.y_m - one.y_m
    length = math.sqrt(ahead * ahead + aside * aside)
    count = int(min(max(length / _SAMPLE_M, 2.0), _SAMPLES_MAX))
    share = np.arange(count + 1) / count
    x, y, z = (a + share * (b - a) for a, b in zip(_xyz(one), _xyz(other), strict=True))
    heights = _softened(_surface(x, y, z, ground))
    heights[0], heights[-1] = one.z_m, other.z_m
    rows = kept_points(share, heights[:, None, None], _CLOSE_M)[1:-1].tolist()
    return [replace(one, x_m=float(x[k]), y_m=float(y[k]), z_m=float(heights[k])) for k in rows]


def _xyz(place: FixedPosition) -> tuple[float, float, float]:
    return place.x_m, place.y_m, place.z_m


def _surface(x: np.ndarray, y: np.ndarray, z: np.ndarray, ground: ScenarioGround) -> np.ndarray:
    """Heights of the lanes below points [N] [m], with kerbs; ``z`` where there is no lane."""
    under = ground.roads.lane_under(x, y, z)
    heights = z.copy()
    for road in np.unique(under.road[under.road >= 0]).tolist():
        frame, on_road = ground.frame(road), under.road == road
        section = np.where(on_road, frame.section_at(np.where(on_road, under.s_m, 0.0)), -1)
        parts = np.stack([section, under.lane])[:, on_road]
        for k, lane in np.unique(parts, axis=1).T.tolist():
            here = on_road & (section == k) & (under.lane == lane)
            s_m = under.s_m[here]
            middle = frame.sections[k].centre(lane, s_m)[0]
            heights[here] = frame.lane_pose(lane, s_m, under.t_m[here] - middle).z_m
    return heights


def _softened(heights: np.ndarray) -> np.ndarray:
    """Means over neighbours, added in one order whatever the processor."""
    padded = np.pad(heights, _REACH, mode="edge")
    total = np.zeros(len(heights))
    for k in range(2 * _REACH + 1):
        total = total + padded[k : k + len(heights)]
    return np.rint(total / (2 * _REACH + 1) * _GRID) / _GRID
