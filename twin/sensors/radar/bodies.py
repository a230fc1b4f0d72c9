"""Scatterers of vehicles, people, poles and reflectors: where the bright points of each are.

A body seen by millimetre waves is a few bright points, each with a cross section and a lobe
(vehicles: Schuler, Becker, Wiesbeck 2008, extraction of virtual scattering centres; people: limbs
that swing with the step, after Boulic, Thalmann, Thalmann 1990). Cross sections are inferred so
that the sums agree with published measurements at 76 to 81 GHz: about 10 dBsm of a car from behind
and 20 dBsm from its side, -8 dBsm of a pedestrian, 0 dBsm of a bicycle with its rider.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from schemas.messages import OBJECT_CLASSES
from twin.world.street.build import World

LOBE, SPHERE, PLATE, CYLINDER, TRIHEDRAL = range(5)
"""Shapes: a point with a lobe; and four whose cross sections have closed forms."""

STILL, LIMB, RIM = range(3)
"""Motions: with the body; swinging fore and aft; rolling about a hub."""

TEMPLATE_ROWS = 16
"""Most scatterers of a body."""


@wp.struct
class Scatterer:
    """One bright point. ``at`` plus ``share`` times the body's half length and width is its place
    in the body's axes, x forward, z above the road."""

    shape: wp.int32
    """-1: there is none."""
    motion: wp.int32
    at: wp.vec3d
    """[m]"""
    share: wp.vec2d
    """[-]"""
    normal: wp.vec2d
    """Cosine and sine of where its lobe points, in the body's axes."""
    size: wp.vec3d
    """LOBE: cross section [m^2], width of the lobe [rad]; SPHERE: radius; PLATE: width, height;
    CYLINDER, upright: radius, height; TRIHEDRAL, of square plates: edge [m]."""
    swing: wp.vec3d
    """LIMB: share of the body's speed, way of a stride [m], phase [turns]; RIM: 1, radius [m],
    phase [turns]."""


@dataclass(frozen=True, slots=True)
class Reflector:
    """A target of known cross section that stands in the world, for tests and calibration."""

    shape: int
    position_m: tuple[float, float, float]
    """World x, y; height above the road."""
    facing_rad: float = 0.0
    """Where it faces, from world x to the left."""
    size_m: tuple[float, ...] = (0.1,)
    """See :attr:`Scatterer.size`."""
    velocity_mps: tuple[float, float] = (0.0, 0.0)
    """World; it is measured with that speed but stays where it is."""


def _row(
    shape: int,
    at: tuple[float, float, float],
    size: tuple[float, ...],
    *,
    share: tuple[float, float] = (0.0, 0.0),
    facing_deg: float = 0.0,
    motion: int = STILL,
    swing: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> tuple:
    normal = (math.cos(math.radians(facing_deg)), math.sin(math.radians(facing_deg)))
    return (shape, motion, at, share, normal, (*size, 0.0, 0.0)[:3], swing)


_ALL_ROUND = 100.0


def _vehicle(scale: float, z_m: float, radius_m: float, wheel_share: float) -> list[tuple]:
    """A car, or with larger ``scale`` of its cross sections a truck."""
    rows = []
    for share, facing, m2, lobe in (
        ((-1.0, 0.0), 180.0, 8.0, 0.45),
        ((1.0, 0.0), 0.0, 5.0, 0.45),
        ((0.0, 1.0), 90.0, 60.0, 0.14),
        ((0.0, -1.0), -90.0, 60.0, 0.14),
        ((-0.97, 0.85), 150.0, 2.0, 0.7),
        ((-0.97, -0.85), -150.0, 2.0, 0.7),
        ((0.97, 0.85), 35.0, 1.5, 0.7),
        ((0.97, -0.85), -35.0, 1.5, 0.7),
    ):
        row = _row(LOBE, (0.0, 0.0, z_m), (m2 * scale, lobe), share=share, facing_deg=facing)
        rows.append(row)
    phases = iter((0.05, 0.33, 0.61, 0.87))
    for end in (-wheel_share, wheel_share):
        for side in (-1.0, 1.0):
            swing = (1.0, 0.7 * radius_m, next(phases))
            rows.append(
                _row(
                    LOBE,
                    (0.0, 0.0, radius_m),
                    (0.3, 0.9),
                    share=(end, side),
                    facing_deg=90.0 * side,
                    motion=RIM,
                    swing=swing,
                )
            )
    rows.append(_row(LOBE, (0.0, 0.0, 1.6 * z_m), (0.2 * scale, _ALL_ROUND), share=(0.3, 0.0)))
    return rows


_STRIDE_M = 1.4


def _limb(y_m: float, z_m: float, m2: float, share: float, phase: float) -> tuple:
    swing = (share, _STRIDE_M, phase)
    return _row(LOBE, (0.0, y_m, z_m), (m2, _ALL_ROUND), motion=LIMB, swing=swing)


def _pedestrian() -> list[tuple]:
    rows = [
        _row(LOBE, (0.0, 0.0, 1.20), (0.10, _ALL_ROUND)),
        _row(LOBE, (0.0, 0.0, 1.62), (0.03, _ALL_ROUND)),
    ]
    for side, phase in ((-1.0, 0.0), (1.0, 0.5)):
        rows.append(_limb(0.10 * side, 0.70, 0.03, 0.45, phase))
        rows.append(_limb(0.10 * side, 0.15, 0.02, 1.0, phase))
        rows.append(_limb(0.25 * side, 1.00, 0.015, 0.5, phase + 0.5))
    return rows


def _cyclist() -> list[tuple]:
    rows = [
        _row(LOBE, (-0.1, 0.0, 1.20), (0.15, _ALL_ROUND)),
        _row(LOBE, (0.0, 0.0, 1.60), (0.03, _ALL_ROUND)),
        _row(LOBE, (0.0, 0.0, 0.60), (2.0, 0.35), facing_deg=90.0),
        _row(LOBE, (0.0, 0.0, 0.60), (2.0, 0.35), facing_deg=-90.0),
        _row(LOBE, (-0.6, 0.0, 0.60), (0.3, 0.6), facing_deg=180.0),
    ]
    for end in (-0.53, 0.53):
        for quarter in range(4):
            swing = (1.0, 0.33, 0.25 * quarter + 0.07)
            at = (end, 0.0, 0.34)
            rows.append(_row(LOBE, at, (0.04, _ALL_ROUND), motion=RIM, swing=swing))
    for side, phase in ((-1.0, 0.0), (1.0, 0.5)):
        swing = (0.35, 5.0, phase)
        at = (0.05, 0.1 * side, 0.35)
        rows.append(_row(LOBE, at, (0.02, _ALL_ROUND), motion=LIMB, swing=swing))
    return rows


_TEMPLATES = {
    "car": _vehicle(1.0, 0.6, 0.33, 0.6),
    "truck": _vehicle(6.0, 1.0, 0.5, 0.7),
    "bus": _vehicle(6.0, 1.0, 0.5, 0.6),
    "pedestrian": _pedestrian(),
    "bicycle": _cyclist(),
    "traffic_sign": [],
}


def templates() -> np.ndarray:
    """Scatterers of a body of each class of :data:`schemas.messages.OBJECT_CLASSES`, rows of
    :class:`Scatterer` [classes, :data:`TEMPLATE_ROWS`]."""
    table = np.zeros((len(OBJECT_CLASSES), TEMPLATE_ROWS), Scatterer.numpy_dtype())
    table["shape"] = -1
    for number, name in enumerate(OBJECT_CLASSES):
        rows = _TEMPLATES[name]
        assert len(rows) <= TEMPLATE_ROWS, name
        for i, row in enumerate(rows):
            table[number, i] = row
    return table


_POLE_M = 4.0


def standing(world: World, reflectors: tuple[Reflector, ...] = ()) -> np.ndarray:
    """Scatterers of what stands in ``world``, in its axes, rows of :class:`Scatterer` [N].

    Parked vehicles, poles and signposts by their hulls, then ``reflectors``, whose velocity stands
    in ``swing``. Heights are above the road where the ego is.
    """
    rows = []
    shapes = templates()
    for index, (x, y, yaw, half_length, half_width) in enumerate(world.colliders):
        if index < world.cars:
            sort = world.static_classes[index] if world.static_classes else 0
            rows += _placed(shapes[sort], (x, y, yaw), (half_length, half_width))
        elif index < len(world.things) and world.things[index].kind in ("pole", "traffic_sign"):
            at = (x, y, 0.5 * _POLE_M)
            size = (min(half_length, half_width, 0.15), _POLE_M, 0.0)
            rows.append((CYLINDER, STILL, at, (0.0, 0.0), (1.0, 0.0), size, (0.0, 0.0, 0.0)))
    for item in reflectors:
        normal = (math.cos(item.facing_rad), math.sin(item.facing_rad))
        size = (*item.size_m, 0.0, 0.0)[:3]
        swing = (*item.velocity_mps, 0.0)
        rows.append((item.shape, STILL, item.position_m, (0.0, 0.0), normal, size, swing))
    table = np.zeros(len(rows), Scatterer.numpy_dtype())
    for i, row in enumerate(rows):
        table[i] = row
    return table


def _placed(
    shape: np.ndarray, place: tuple[float, float, float], half: tuple[float, float]
) -> list[tuple]:
    """A template's scatterers in the axes of the world; wheels stand still."""
    x, y, yaw = place
    c, s = math.cos(yaw), math.sin(yaw)
    rows = []
    for row in shape[shape["shape"] >= 0]:
        along = row["at"][0] + row["share"][0] * half[0]
        left = row["at"][1] + row["share"][1] * half[1]
        at = (x + c * along - s * left, y + s * along + c * left, row["at"][2])
        nx, ny = row["normal"]
        normal = (c * nx - s * ny, s * nx + c * ny)
        rows.append(
            (row["shape"], STILL, at, (0.0, 0.0), normal, tuple(row["size"]), (0.0, 0.0, 0.0))
        )
    return rows
