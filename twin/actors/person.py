"""Meshes of walking people: phases of a step, made of tapering limbs; and a cyclist.

Own axes: x forward, z up, origin on the ground below the hips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder

PHASES = 8
"""Meshes of one stride; one more shows the person standing."""

_SKINS: tuple[Color, ...] = (
    (0.50, 0.30, 0.21),
    (0.30, 0.16, 0.10),
    (0.60, 0.40, 0.30),
    (0.14, 0.08, 0.05),
)
_HAIRS: tuple[Color, ...] = (
    (0.03, 0.02, 0.015),
    (0.10, 0.05, 0.02),
    (0.30, 0.22, 0.10),
    (0.25, 0.25, 0.25),
)
_COATS: tuple[Color, ...] = (
    (0.28, 0.03, 0.03),
    (0.03, 0.07, 0.20),
    (0.40, 0.33, 0.20),
    (0.05, 0.05, 0.055),
    (0.05, 0.17, 0.11),
    (0.55, 0.52, 0.48),
    (0.45, 0.26, 0.03),
)  # fmt: skip
_TROUSERS: tuple[Color, ...] = (
    (0.03, 0.04, 0.08),
    (0.04, 0.04, 0.042),
    (0.20, 0.17, 0.12),
    (0.11, 0.11, 0.12),
)
_SHOE: Color = (0.025, 0.022, 0.02)


@dataclass(frozen=True, slots=True)
class Looks:
    """What one person looks like."""

    height_m: float
    girth: float
    """Width relative to the average [-]."""
    coat: Color
    trousers: Color
    skin: Color
    hair: Color
    skirt: bool
    bag: bool

    @property
    def stride_m(self) -> float:
        """Way of a full stride, two steps [m]."""
        return 0.82 * self.height_m


def random_looks(seed: int, coat: Color | None = None) -> Looks:
    """The looks that belong to ``seed``."""
    rng = np.random.default_rng([seed, 77])
    picks = rng.integers(0, 1 << 16, 4)
    return Looks(
        height_m=rng.uniform(1.56, 1.88),
        girth=rng.uniform(0.92, 1.12),
        coat=coat or _COATS[picks[0] % len(_COATS)],
        trousers=_TROUSERS[picks[1] % len(_TROUSERS)],
        skin=_SKINS[picks[2] % len(_SKINS)],
        hair=_HAIRS[picks[3] % len(_HAIRS)],
        skirt=bool(rng.random() < 0.25),
        bag=bool(rng.random() < 0.35),
    )


def _loft(mesh: MeshBuilder, rings: list[tuple[float, float, float, float]], color: Color) -> None:
    """A closed body of upright ellipses: x, z, half depth, half width, from below."""
    sides = 10
    angle = 2.0 * np.pi * np.arange(sides) / sides
    points = [
        np.stack([x + a * np.cos(angle), b * np.sin(angle), np.full(sides, z)], axis=1)
        for x, z, a, b in rings
    ]
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = []
    for k in range(len(rings) - 1):
        low, high = k * sides, (k + 1) * sides
        faces.append(np.stack([low + i, low + j, high + j], axis=1))
        faces.append(np.stack([low + i, high + j, high + i], axis=1))
    last = (len(rings) - 1) * sides
    faces.append(np.array([(last, last + k, last + k + 1) for k in range(1, sides - 1)]))
    faces.append(np.array([(0, k + 1, k) for k in range(1, sides - 1)]))
    mesh.add(np.concatenate(points), np.concatenate(faces), materials.PLAIN, color)


def _limb(
    mesh: MeshBuilder, start: np.ndarray, angle: float, length: float, radii: tuple[float, float],
    color: Color,
) -> np.ndarray:  # fmt: skip
    """A tapering limb that hangs from ``start``, swung forward by ``angle`` [rad]; its end."""
    end = start + length * np.array((np.sin(angle), 0.0, -np.cos(angle)))
    mesh.tube(start, end, radii, 7, materials.PLAIN, color)
    return end


def add_person(mesh: MeshBuilder, looks: Looks, phase: float | None) -> None:
    """Add a person, ``phase`` of the stride in 0 to 1, or standing (None)."""
    with mesh.label("pedestrian"):
        swing = 0.0 if phase is None else np.sin(2.0 * np.pi * phase)
        walking = phase is not None
        size = looks.height_m / 1.75
        angles = []
        for side in (1.0, -1.0):
            thigh = 0.46 * swing * side
            # The knee bends while the leg comes forward.
            ahead = 0.0 if phase is None else max(0.0, np.cos(2.0 * np.pi * phase) * side)
            shin = thigh - 0.06 - 0.85 * ahead - 0.12 * abs(min(0.0, thigh)) if walking else -0.03
            angles.append((thigh, shin))
        # The hips are as high as the leg that stands on the ground allows.
        legs = [0.43 * np.cos(t) + 0.43 * np.cos(s) for t, s in angles]
        hip = (max(legs) + 0.07) * size
        _legs(mesh, looks, size, hip, angles)
        _torso(mesh, looks, size, hip)
        for side in (1.0, -1.0):
            arm = (-0.40 * swing * side) if walking else 0.04 * side
            at = np.array((0.0, side * 0.215 * looks.girth, 0.0)) * size + (0, 0, hip + 0.50 * size)
            cap = (0.010, 0.058)
            mesh.tube(at + np.array((0, 0, 0.045)), at, cap, 7, materials.PLAIN, looks.coat)
            elbow = _limb(mesh, at, arm, 0.29 * size, (0.058, 0.048), looks.coat)
            bend = arm + (0.28 if walking else 0.12)
            wrist = _limb(mesh, elbow, bend, 0.25 * size, (0.047, 0.036), looks.coat)
            _limb(mesh, wrist, bend, 0.13 * size, (0.040, 0.028), looks.skin)
            if looks.bag and side > 0:
                x, y, z = wrist + np.array((0.0, 0.03, -0.12))
                mesh.box(
                    (x - 0.17, y - 0.05, z - 0.34), (x + 0.17, y + 0.05, z), materials.PLAIN, _SHOE
                )
        _head(mesh, looks, size, hip)
    add_foot_shade(mesh, 0.28, 0.22)


def _legs(
    mesh: MeshBuilder, looks: Looks, size: float, hip: float, angles: list[tuple[float, float]]
) -> None:
    for side, (thigh, shin) in zip((1.0, -1.0), angles, strict=True):
        start = np.array((0.0, side * 0.095 * looks.girth * size, hip))
        color = looks.skin if looks.skirt else looks.trousers
        knee = _limb(mesh, start, thigh, 0.43 * size, (0.088 * looks.girth, 0.060), color)
        ankle = _limb(mesh, knee, shin, 0.43 * size, (0.060, 0.042), color)
        with mesh.place(ankle[0], ankle[1], 0.0, z_m=ankle[2] - 0.07 * size):
            mesh.box((-0.07, -0.045, 0.0), (0.19, 0.045, 0.085), materials.PLAIN, _SHOE)


def _torso(mesh: MeshBuilder, looks: Looks, size: float, hip: float) -> None:
    wide = looks.girth
    if looks.skirt:
        rings = [(0.0, -0.42, 0.20, 0.24), (0.0, -0.10, 0.16, 0.20), (0.0, 0.06, 0.115, 0.15)]
        _loft(
            mesh, [(x, hip + z * size, a * wide, b * wide) for x, z, a, b in rings], looks.trousers
        )
    rings = [
        (0.0, -0.10, 0.125, 0.180),
        (0.0, 0.04, 0.128, 0.178),
        (0.0, 0.18, 0.112, 0.158),
        (0.005, 0.38, 0.128, 0.190),
        (0.0, 0.50, 0.105, 0.205),
        (-0.005, 0.565, 0.062, 0.110),
    ]
    _loft(mesh, [(x, hip + z * size, a * wide, b * wide) for x, z, a, b in rings], looks.coat)


def _head(mesh: MeshBuilder, looks: Looks, size: float, hip: float) -> None:
    neck = hip + 0.55 * size
    rings = [
        (0.0, 0.0, 0.052, 0.052),
        (0.005, 0.07, 0.055, 0.055),
        (0.025, 0.10, 0.082, 0.066),
        (0.022, 0.18, 0.098, 0.076),
        (0.015, 0.25, 0.092, 0.074),
    ]
    _loft(mesh, [(x, neck + z * size, a, b) for x, z, a, b in rings], looks.skin)
    rings = [
        (-0.022, 0.12, 0.078, 0.079),
        (-0.004, 0.20, 0.102, 0.083),
        (0.008, 0.262, 0.100, 0.080),
        (0.0, 0.300, 0.062, 0.052),
    ]
    _loft(mesh, [(x, neck + z * size, a, b) for x, z, a, b in rings], looks.hair)


def add_foot_shade(mesh: MeshBuilder, half_length_m: float, half_width_m: float) -> None:
    """A dark patch on the ground below someone."""
    with mesh.label("road", instance=-1):
        for step, (grow, shade) in enumerate(((0.10, 0.72), (-0.06, 0.45))):
            a, b, z = half_length_m + grow, half_width_m + grow, 0.008 + 0.004 * step
            angle = 2.0 * np.pi * np.arange(8) / 8
            ring = np.stack([a * np.cos(angle), b * np.sin(angle), np.full(8, z)], axis=1)
            fan = np.array([(0, i, i + 1) for i in range(1, 7)])
            mesh.add(
                ring, fan, materials.ASPHALT, (0.12 * shade, 0.12 * shade, 0.12 * shade), DECAL
            )
