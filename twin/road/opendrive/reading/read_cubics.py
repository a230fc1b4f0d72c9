"""Reading of polynomials along a road, and their extremes."""

from __future__ import annotations

import math

from twin.road.opendrive.reading.node import Node
from twin.road.opendrive.records import Cubic


def read_cubics(nodes: list[Node], key: str = "s") -> tuple[Cubic, ...]:
    """Polynomials in the order of their starts, which must not go back."""
    cubics: list[Cubic] = []
    for node in nodes:
        start = node.number(key, low=0.0)
        if cubics and start < cubics[-1].start_m:
            node.refuse(
                f"{key}={start:g} lies before that of the one before, {cubics[-1].start_m:g}"
            )
        cubics.append(Cubic(start, *(node.number(letter) for letter in "abcd")))
    return tuple(cubics)


def lowest(cubic: Cubic, from_m: float, to_m: float) -> float:
    """The least value between two distances from the beginning of ``cubic``, exactly."""
    places = [from_m, to_m]
    # Where the derivative b + 2 c d + 3 d d^2 is zero.
    if cubic.d == 0.0:
        if cubic.c != 0.0:
            places.append(-cubic.b / (2.0 * cubic.c))
    else:
        square = cubic.c * cubic.c - 3.0 * cubic.b * cubic.d
        if square >= 0.0:
            root = math.sqrt(square)
            places += [(-cubic.c + sign * root) / (3.0 * cubic.d) for sign in (-1.0, 1.0)]
    return min(value(cubic, d) for d in places if from_m <= d <= to_m)


def value(cubic: Cubic, distance_m: float) -> float:
    """Value of the polynomial at a distance from its beginning."""
    d = distance_m
    return cubic.a + d * (cubic.b + d * (cubic.c + d * cubic.d))
