"""Shortest ways between the ends of roads."""

from __future__ import annotations

import numpy as np

from twin.road.tables.road_ways import RoadWays

ROADS_MAX = 512
"""Most roads of a network that gets the table, of 8 MiB; it takes some seconds to make."""


def way_lengths(ways: RoadWays, lengths_m: np.ndarray) -> np.ndarray:
    """How long the roads between are if one leaves a road through an end and enters another.

    Element [2 r + e, 2 q + f]: from leaving road r through its end e (0 beginning, 1 end) to
    entering road q at its end f, along the reference lines; 0 where they touch, infinite where no
    way leads there. Found by Floyd's and Warshall's algorithm, so in a fixed order.

    Args:
        ways: of the network.
        lengths_m: of the roads [R].

    Returns:
        float64 [2 R, 2 R], or [0, 0] above :data:`ROADS_MAX` roads.
    """
    count = len(lengths_m)
    if count > ROADS_MAX:
        return np.zeros((0, 0))
    # From one leaving to the next: through a road that is entered at f one leaves at 1 - f.
    leaving = np.full((2 * count, 2 * count), np.inf)
    touching = np.full((2 * count, 2 * count), np.inf)
    for end in range(2 * count):
        for road, contact, _, _ in ways.ways[ways.first[end] : ways.first[end + 1]].tolist():
            touching[end, 2 * road + contact] = 0.0
            out = 2 * road + 1 - contact
            leaving[end, out] = min(leaving[end, out], float(lengths_m[road]))
    for middle in range(2 * count):
        np.minimum(leaving, leaving[:, middle : middle + 1] + leaving[middle], out=leaving)
    np.fill_diagonal(leaving, np.minimum(np.diag(leaving), 0.0))
    entering = np.full((2 * count, 2 * count), np.inf)
    for end in range(2 * count):
        for road, contact, _, _ in ways.ways[ways.first[end] : ways.first[end + 1]].tolist():
            reached = 2 * road + contact
            entering[:, reached] = np.minimum(entering[:, reached], leaving[:, end])
    shortest: np.ndarray = np.minimum(entering, touching)
    return shortest
