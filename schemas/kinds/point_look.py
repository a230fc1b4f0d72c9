"""Rows of a sensor as coloured points, by the look that its declaration gives them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schemas.kinds.sensor import PointsLook

AT_BEGINNING, AT_ZERO, AT_END = (240, 84, 84), (120, 126, 138), (76, 139, 245)
"""Colours of the ends of a look's span and of 0, RGB."""


def places(look: PointsLook, named: Mapping[str, np.ndarray]) -> np.ndarray:
    """Points in the sensor's axes, float64 [N, 3], of columns by name."""
    distance, azimuth = named[look.range_m], named[look.azimuth_rad]
    elevation = named.get(look.elevation_rad, np.zeros_like(distance))
    level = distance * np.cos(elevation)
    ahead, left = level * np.cos(azimuth), level * np.sin(azimuth)
    return np.stack([ahead, left, distance * np.sin(elevation)], axis=1)


def colors(look: PointsLook, named: Mapping[str, np.ndarray]) -> np.ndarray:
    """uint8 [N, 3] RGB: from red over grey at 0 to blue."""
    low, high = look.span
    stops = np.array([low, 0.0, high])
    tones = np.array([AT_BEGINNING, AT_ZERO, AT_END], float)
    mixed = [np.interp(named[look.color], stops, tones[:, i]) for i in range(3)]
    return np.asarray(np.rint(np.stack(mixed, axis=1)), np.uint8)
