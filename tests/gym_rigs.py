"""Small learning environments, and the campaign file that they are made of."""

from __future__ import annotations

from typing import Any

import numpy as np

SMALL: dict[str, Any] = {
    "campaign": "small-loop",
    "seed": 5,
    "control_hz": 20,
    "scenario": {
        "type": "lane_keeping",
        "scene": "downtown-loop",
        "vehicle": "opencav",
        "ego_speed_mps": 8.0,
        "distance_m": 1000,
        "duration_s": 1.5,
    },
    "camera": {"name": "front_right", "width": 64, "height": 36, "hz": 10, "noise": True},
    "sensors": {"imu": {"hz": 20}, "gnss": {"hz": 10}},
    "matrix": {"weather": ["clear", "light_rain", "heavy_fog"]},
}
"""15 steps of an episode, two ticks each; the IMU reads at every tick, all else at every other."""


def driven(seed: int, steps: int, envs: int = 1) -> np.ndarray:
    """Actions that change with every step and are others in every environment, [steps, envs, 3]."""
    draws = [np.random.default_rng((seed, env)).random((steps, 3)) for env in range(envs)]
    return np.stack(draws, axis=1) * (0.08, 1.0, 0.5) - (0.04, 0.0, 0.0)
