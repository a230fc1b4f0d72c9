"""Light through flattened drops, ray by ray: how much of it comes back to where it came from."""

import numpy as np
import pytest

from twin.sensors.lidar import hydrometeors

INDEX = 1.3275
CONE_RAD = np.radians(5.0)
MEETINGS = 8
"""With the surface from within; what is left then is nothing."""


class Spheroid:
    """A drop of width 1 that is seen from the side, lower than wide and a little askew."""

    def __init__(self, axis_ratio: float, tilt_rad: float) -> None:
        turn = np.array([[np.cos(tilt_rad), 0.0, np.sin(tilt_rad)], [0.0, 1.0, 0.0],
                         [-np.sin(tilt_rad), 0.0, np.cos(tilt_rad)]])  # fmt: skip
        self.form = turn @ np.diag([1.0, 1.0, axis_ratio**-2]) @ turn.T

    def meet(self, origin, direction, *, entering):
        """Whether each ray meets the surface, and where."""
        ahead = direction @ self.form
        a = (ahead * direction).sum(axis=1)
        b = (ahead * origin).sum(axis=1)
        c = ((origin @ self.form) * origin).sum(axis=1) - 1.0
        inside = b * b - a * c
        root = np.sqrt(np.maximum(inside, 0.0)) * (-1.0 if entering else 1.0)
        return inside > 0.0, origin + ((-b + root) / a)[:, None] * direction

    def normal(self, point):
        """Outwards."""
        steepest = point @ self.form
        return steepest / np.linalg.norm(steepest, axis=1, keepdims=True)


def fresnel(cosine, before, after):
    """Unpolarised reflectance, and the cosine behind the surface."""
    sine2 = (before / after) ** 2 * (1.0 - cosine**2)
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    s = (before * cosine - after * beyond) / (before * cosine + after * beyond)
    p = (before * beyond - after * cosine) / (before * beyond + after * cosine)
    return np.where(sine2 >= 1.0, 1.0, 0.5 * (s**2 + p**2)), beyond


def backscatter_efficiency(axis_ratio: float, rays: int = 400_000) -> float:
    """Q_b of a drop that is canted by 5 degrees, from what leaves it within a cone."""
    drop = Spheroid(axis_ratio, np.radians(5.0))
    rng = np.random.default_rng(1)
    origin = np.column_stack([np.full(rays, -3.0), rng.uniform(-1.0, 1.0, (rays, 2))])
    direction = np.tile([1.0, 0.0, 0.0], (rays, 1))
    hit, point = drop.meet(origin, direction, entering=True)
    point, direction = point[hit], direction[hit]
    returned = 0.0

    def leaves(towards, weight):
        return float(weight[-towards[:, 0] > np.cos(CONE_RAD)].sum())

    normal = drop.normal(point)
    cosine = -(direction * normal).sum(axis=1)
    share, beyond = fresnel(cosine, 1.0, INDEX)
    returned += leaves(direction + 2.0 * cosine[:, None] * normal, share)
    weight = 1.0 - share
    direction = direction / INDEX + (cosine / INDEX - beyond)[:, None] * normal
    for _ in range(MEETINGS):
        _, point = drop.meet(point + 1e-9 * direction, direction, entering=False)
        normal = drop.normal(point)
        cosine = np.clip((direction * normal).sum(axis=1), 0.0, 1.0)
        share, beyond = fresnel(cosine, INDEX, 1.0)
        out = INDEX * direction + (beyond - INDEX * cosine)[:, None] * normal
        returned += leaves(out, weight * (1.0 - share))
        weight = weight * share
        direction = direction - 2.0 * cosine[:, None] * normal
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(CONE_RAD))
    return 4.0 * np.pi * returned / hit.sum() / solid_angle


@pytest.mark.parametrize(
    ("diameter_mm", "within"), [(0.4, 0.05), (1.5, 0.1), (2.9, 0.1), (3.7, 0.15), (5.0, 0.4)]
)
def test_flat_drops_send_back_what_rays_say(diameter_mm, within):
    axis_ratio = min(1.0, 1.03 - 0.062 * diameter_mm)
    found = 4.0 * hydrometeors.drop_reflectance(np.array([diameter_mm]), long_wave=False)[0]
    assert found == pytest.approx(backscatter_efficiency(axis_ratio), rel=within)
