"""Vehicles that stand in a scene, and which of them stand in one another."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from twin.actors.objects import hull_size
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import Scene
from twin.world.street import sidewalks
from twin.world.street.layout import Hull, lay_out
from twin.world.street.parking import add_obstacle, add_parked


@dataclass(frozen=True, slots=True)
class _Vehicle:
    name: str
    """Name in messages."""
    hull: Hull
    placed: bool
    """The scene file says where it stands; False: the street was generated so."""


def overlaps(scene: Scene) -> list[str]:
    """One line for each pair of standing vehicles that overlap, if the scene file places one."""
    vehicles = _standing(scene)
    return [
        f"{_at(a)} overlaps {_at(b)}; move it"
        + ("" if a.placed and b.placed else ", or lower furniture.parked_cars")
        for a, b in combinations(vehicles, 2)
        if (a.placed or b.placed) and _overlap(a.hull, b.hull)
    ]


def _standing(scene: Scene) -> list[_Vehicle]:
    """Vehicles placed by the file first."""
    layout, mesh = lay_out(scene), MeshBuilder()
    vehicles = [_Vehicle("obstacle", hull, True) for hull in add_obstacle(mesh, scene, layout)]
    for number, item in enumerate(scene.objects):
        if len(item.waypoints) > 1 or item.kind == "pedestrian":
            continue
        x_m, y_m = item.waypoints[0][:2]
        label = f"objects[{number}] ({item.kind}{f' {item.name!r}' if item.name else ''})"
        hull = (x_m, y_m, math.radians(item.yaw_deg), *hull_size(item))
        vehicles.append(_Vehicle(label, hull, True))
    if scene.street:
        stop = sidewalks.bus_stop(layout)
        parked, _ = add_parked(mesh, scene, layout, 0, [(*stop, 1.0)] if stop else [])
        vehicles += [_Vehicle("a parked car of the street", hull, False) for hull in parked]
    return vehicles


def _at(vehicle: _Vehicle) -> str:
    return f"{vehicle.name} at ({vehicle.hull[0]:.1f}, {vehicle.hull[1]:.1f})"


def _overlap(a: Hull, b: Hull) -> bool:
    """Whether two rectangles overlap: no axis of either separates them."""
    apart = np.array([b[0] - a[0], b[1] - a[1]])
    axes = [_axes(a[2]), _axes(b[2])]
    for own in axes:
        for axis in own:
            reach = sum(
                half * abs(float(side @ axis))
                for hull, sides in zip((a, b), axes, strict=True)
                for half, side in zip(hull[3:], sides, strict=True)
            )
            if abs(float(apart @ axis)) >= reach:
                return False
    return True


def _axes(yaw_rad: float) -> np.ndarray:
    """Unit vectors along and across [2, 2]."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[cosine, sine], [-sine, cosine]])
