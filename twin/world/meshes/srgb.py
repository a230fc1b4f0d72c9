"""The transfer function of sRGB (IEC 61966-2-1), both ways."""

from __future__ import annotations

import numpy as np


def linear(srgb_values: np.ndarray) -> np.ndarray:
    """sRGB values 0..1 -> linear light."""
    v = np.clip(srgb_values, 0.0, 1.0)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def srgb(linear_values: np.ndarray) -> np.ndarray:
    """Linear light 0..1 -> sRGB values."""
    v = np.clip(linear_values, 0.0, 1.0)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
