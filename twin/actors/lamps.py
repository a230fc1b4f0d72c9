"""Lamps of road users that are switched one by one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


class VehicleLamp(IntEnum):
    """Bit of a lamp in :attr:`twin.actors.motion.Placement.lights`, and tag of its faces.

    Faces without a tag have bit 0, which is never on.
    """

    HEAD = 1
    """Front lamps, by day as well: daytime running lamps, or beams that are switched on."""
    TAIL = 2
    """Tail lamps, by day as well."""
    HIGH_BEAM = 3
    """Light thrown far ahead."""
    INDICATOR_LEFT = 4
    INDICATOR_RIGHT = 5
    REVERSING = 6
    FOG_FRONT = 7
    FOG_REAR = 8


AMBER: Color = (0.70, 0.25, 0.03)
RED: Color = (0.42, 0.02, 0.02)
CLEAR: Color = (0.5, 0.5, 0.52)


@dataclass(frozen=True, slots=True)
class LampPlaces:
    """Where a body has its lamps beside head and tail lamps: boxes of its left side, low and high
    corner, x from its rear bumper [m]."""

    indicators: tuple[Box, ...]
    reversing: Box
    fog_rear: Box
    fog_front: Box


def add_switched_lamps(mesh: MeshBuilder, places: LampPlaces) -> None:
    """Add lenses on both sides, each with the tag of its lamp."""
    for sign, indicator in (
        (1.0, VehicleLamp.INDICATOR_LEFT),
        (-1.0, VehicleLamp.INDICATOR_RIGHT),
    ):
        for box in places.indicators:
            _lens(mesh, box, sign, AMBER, indicator)
        _lens(mesh, places.reversing, sign, CLEAR, VehicleLamp.REVERSING)
        _lens(mesh, places.fog_rear, sign, RED, VehicleLamp.FOG_REAR)
        _lens(mesh, places.fog_front, sign, CLEAR, VehicleLamp.FOG_FRONT)


def _lens(mesh: MeshBuilder, box: Box, sign: float, color: Color, lamp: VehicleLamp) -> None:
    (x0, y0, z0), (x1, y1, z1) = box
    low, high = sorted((sign * y0, sign * y1))
    mesh.box((x0, low, z0), (x1, high, z1), materials.VEHICLE_LAMP, color, tag=lamp)
