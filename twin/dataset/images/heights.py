"""Heights of sun and moon on a grid, so that images share the tables of the clear sky."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from twin.world.sky.almanac import Heavens

SUN_STEP_DEG = 0.5
"""[deg]"""
MOON_STEP_DEG = 2.0
"""Step of the moon's height; its sky is faint [deg]."""


def on_steps(bodies: Heavens) -> Heavens:
    """The heavens with both bodies at the nearest height of their grids, in the same direction.

    The sky of one height and haze costs 10 ms; a day holds some hundred heights, and a dataset
    asks for each of them many times. Nothing but the height moves, by half a step at most.
    """
    sun = _raised(bodies.sun, bodies.sun_elevation_rad, SUN_STEP_DEG)
    return replace(
        bodies, sun=sun, moon=_raised(bodies.moon, bodies.moon_elevation_rad, MOON_STEP_DEG)
    )


def _raised(direction: np.ndarray, elevation_rad: float, step_deg: float) -> np.ndarray:
    steps = round(math.degrees(elevation_rad) / step_deg)
    elevation = math.radians(steps * step_deg)
    flat = math.cos(elevation) / max(math.hypot(direction[0], direction[1]), 1e-9)
    return np.array([direction[0] * flat, direction[1] * flat, math.sin(elevation)])
