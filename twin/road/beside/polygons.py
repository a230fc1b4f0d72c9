"""Polygons in the plane: their turn, triangles and the part of one that lies in a band."""

from __future__ import annotations

import numpy as np


def signed_area(ring: np.ndarray) -> float:
    """Area of a polygon [N, 2], above 0 if it turns counterclockwise [m^2]."""
    ahead = np.roll(ring, -1, axis=0)
    return float(0.5 * (ring[:, 0] * ahead[:, 1] - ahead[:, 0] * ring[:, 1]).sum())


def triangles_of(ring: np.ndarray) -> np.ndarray:
    """Triangles of a simple polygon [N, 2], counterclockwise, int [N - 2, 3].

    Ears are cut off one after another (Meisters, Polygons have ears, 1975). Of a polygon that
    crosses itself something comes out as well.
    """
    order = list(range(len(ring)))
    if signed_area(ring) < 0.0:
        order.reverse()
    faces = []
    while len(order) > 3:
        cut = next((k for k in range(len(order)) if _is_ear(ring, order, k)), 0)
        faces.append((order[cut - 1], order[cut], order[(cut + 1) % len(order)]))
        del order[cut]
    if len(order) == 3:
        faces.append((order[0], order[1], order[2]))
    return np.array(faces, np.int32).reshape(-1, 3)


def _is_ear(ring: np.ndarray, order: list[int], k: int) -> bool:
    a, b, c = ring[order[k - 1]], ring[order[k]], ring[order[(k + 1) % len(order)]]
    if _cross(a, b, c) <= 0.0:
        return False
    corners = {order[k - 1], order[k], order[(k + 1) % len(order)]}
    others = ring[[index for index in order if index not in corners]]
    inside = (
        (_cross(a, b, others.T) >= 0.0)
        & (_cross(b, c, others.T) >= 0.0)
        & (_cross(c, a, others.T) >= 0.0)
    )
    return not bool(np.any(inside))


def _cross(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Above 0 where p lies to the left of the line from a to b; p is [2] or [2, N]."""
    side: np.ndarray = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return side


def band_of(ring: np.ndarray, low: float, high: float) -> np.ndarray:
    """The part of a convex polygon [N, 2] whose second coordinate is between two values [M, 2].

    Half planes are cut off one after another (Sutherland and Hodgman, Reentrant polygon clipping,
    1974). Of one that is not convex parts may be joined by edges along the band's border.
    """
    for sign, bound in ((1.0, low), (-1.0, high)):
        kept = []
        depth = sign * (ring[:, 1] - bound)
        for index in range(len(ring)):
            there = (index + 1) % len(ring)
            if depth[index] >= 0.0:
                kept.append(ring[index])
            if (depth[index] > 0.0) != (depth[there] > 0.0) and depth[index] != depth[there]:
                share = depth[index] / (depth[index] - depth[there])
                if 0.0 < share < 1.0:
                    kept.append(ring[index] + share * (ring[there] - ring[index]))
        if len(kept) < 3:
            return np.zeros((0, 2))
        ring = np.array(kept)
    return ring
