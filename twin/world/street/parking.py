"""Cars at the kerbs: what is parked where, and the obstacle."""

from __future__ import annotations

import numpy as np

from twin.actors import car_body, heavy_body
from twin.world.meshes.mesh import Color, MeshBuilder
from twin.world.scene import Scene
from twin.world.street.ground import PLACE_M
from twin.world.street.layout import Hull, Layout, generator

PAINTS: tuple[Color, ...] = (
    (0.55, 0.56, 0.58),
    (0.04, 0.045, 0.05),
    (0.75, 0.75, 0.74),
    (0.06, 0.12, 0.30),
    (0.20, 0.21, 0.22),
    (0.10, 0.22, 0.16),
    (0.35, 0.33, 0.28),
    (0.32, 0.05, 0.04),
    (0.50, 0.40, 0.10),
)
"""Colours of cars."""

_MIX = ("hatchback", "hatchback", "saloon", "saloon", "suv", "suv", "van")
_TRUCK_SHARE = 0.04


def add_obstacle(mesh: MeshBuilder, scene: Scene, layout: Layout) -> list[Hull]:
    """Add the broken-down car, instance 0, if the scene has one; its hull."""
    obstacle = scene.obstacle
    if obstacle is None:
        return []
    half = car_body.LENGTH_M / 2
    place = layout.at(obstacle.x_m + half, obstacle.y_m)
    with mesh.place(*place, instance=0), mesh.place(-half, 0.0):
        r, g, b = obstacle.color
        car_body.add_car(mesh, (r, g, b), hazard=obstacle.hazard_lights, wheel_sides=20)
    return [(*place, half, car_body.WIDTH_M / 2)]


def add_parked(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    first: int,
    keep_free: list[tuple[float, float, float]],
) -> tuple[list[Hull], list[str]]:
    """Add the parked vehicles.

    Args:
        first: instance of the first of them.
        keep_free: stretches without parked cars: x from, x to [m], sign of the side; in street
            coordinates.

    Returns:
        Their hulls, and the class of each.
    """
    rng = generator(scene, 3)
    obstacle = scene.obstacle
    if obstacle is not None and obstacle.y_m < -0.8:  # it stands among the parked cars
        keep_free = [*keep_free, (obstacle.x_m - 1.0, obstacle.x_m + car_body.LENGTH_M + 1.0, -1.0)]
    hulls: list[Hull] = []
    classes: list[str] = []
    strip = scene.road.parking_width_m / 2
    for block in layout.blocks:
        start, end = block.parking
        for place in np.arange(start, end - PLACE_M, PLACE_M):
            for kerb, _, sign in layout.rows():
                taken, paint, shape = (
                    rng.random(),
                    rng.integers(len(PAINTS)),
                    rng.integers(len(_MIX)),
                )
                shift, sway, big = rng.uniform(0.3, 0.8), rng.uniform(-0.08, 0.08), rng.random()
                busy = any(s == sign and place < b and place + PLACE_M > a for a, b, s in keep_free)
                if taken >= scene.furniture.parked_cars or busy:
                    continue
                truck = big < _TRUCK_SHARE
                body = car_body.SHAPES[_MIX[shape]]
                length = heavy_body.TRUCK_M[0] if truck else body.length_m
                width = heavy_body.TRUCK_M[1] if truck else body.width_m
                y = kerb - sign * strip + (-sign * sway if truck else sway)
                at = layout.at(place + shift + length / 2, y, 0.0 if sign < 0 else np.pi)
                with mesh.place(*at, instance=first + len(hulls)), mesh.place(-length / 2, 0.0):
                    if truck:
                        heavy_body.add_truck(mesh, PAINTS[paint])
                    else:
                        car_body.add_car(mesh, PAINTS[paint], False, 10, body)
                hulls.append((*at, length / 2, width / 2))
                classes.append("truck" if truck else "car")
    return hulls, classes
