"""A scene file -> the world: one static mesh, colliders and object instances."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.world import car_body, materials, plants
from twin.world.mesh import Color, Mesh, MeshBuilder
from twin.world.motion import Motion, ObjectKind, Still
from twin.world.scene import Scene

_ASPHALT: Color = (0.09, 0.09, 0.095)
_CONCRETE: Color = (0.30, 0.29, 0.27)
_PAINT: Color = (0.70, 0.70, 0.67)
_WALLS: tuple[Color, ...] = (
    (0.42, 0.20, 0.14),
    (0.50, 0.44, 0.36),
    (0.33, 0.33, 0.35),
    (0.56, 0.50, 0.42),
    (0.30, 0.17, 0.13),
    (0.44, 0.42, 0.40),
    (0.58, 0.55, 0.50),
)
_CARS: tuple[Color, ...] = (
    (0.55, 0.56, 0.58),
    (0.04, 0.045, 0.05),
    (0.75, 0.75, 0.74),
    (0.06, 0.12, 0.30),
    (0.20, 0.21, 0.22),
    (0.10, 0.22, 0.16),
    (0.35, 0.33, 0.28),
)
_PLACE_M = 6.6  # length of one parking place
_POST: Color = (0.06, 0.065, 0.06)


@dataclass(frozen=True, slots=True)
class World:
    """Everything of a scene that does not change."""

    mesh: Mesh
    colliders: np.ndarray
    """float64 [K, 5]: centre x, y [m], yaw [rad], half length and width [m]; obstacle first."""
    instances: int
    """Number of static objects the box sensor reports; the obstacle is 0."""
    lamps_right: tuple[float, float]
    """World x of one right-hand lamp and world y of the row [m]."""
    lamps_left: tuple[float, float]
    """World x of one left-hand lamp and world y of the row [m]."""
    kinds: tuple[ObjectKind, ...] = ()
    """Meshes of movable objects."""
    motion: Motion = field(default_factory=Still)
    """Where the movable objects are."""
    textures: tuple[np.ndarray, ...] = ()
    """Images uint8 [h, w, 3], sRGB."""
    static_classes: tuple[int, ...] = ()
    """Class of each static instance, index into :data:`schemas.messages.OBJECT_CLASSES`; by default
    all are cars."""
    mover_classes: tuple[int, ...] = ()
    """Class of each movable object."""

    @property
    def first_mover(self) -> int:
        """Instance of the first movable object; the static ones come before."""
        return self.instances

    @property
    def classes(self) -> np.ndarray:
        """int32 [I]: class of every instance."""
        static = self.static_classes or (0,) * self.instances
        return np.array([*static, *self.mover_classes], np.int32)

    @property
    def obstacle_rear_m(self) -> float:
        """World x of the obstacle's rear bumper [m]."""
        return float(self.colliders[0, 0] - self.colliders[0, 3])


@dataclass(frozen=True, slots=True)
class _Layout:
    """Borders of the street across, world y [m]."""

    kerb_right: float
    kerb_left: float
    wall_right: float
    wall_left: float
    middle: float


def build_world(scene: Scene) -> World:
    """Generate the street of ``scene``; the same file gives the same arrays."""
    rng = np.random.default_rng(scene.seed)
    mesh = MeshBuilder()
    road = scene.road
    right = -road.lane_width_m / 2 - road.parking_width_m
    left = 1.5 * road.lane_width_m + road.parking_width_m
    layout = _Layout(
        right,
        left,
        right - road.sidewalk_width_m,
        left + road.sidewalk_width_m,
        road.lane_width_m / 2,
    )
    obstacle = scene.obstacle
    with mesh.place(obstacle.x_m, obstacle.y_m, 0.0, instance=0):
        r, g, b = obstacle.color
        car_body.add_car(mesh, (r, g, b), hazard=obstacle.hazard_lights, wheel_sides=16)
    colliders = [_car_hull(obstacle.x_m, obstacle.y_m, forward=True)]
    blocks = _blocks(scene)
    _ground(mesh, scene, layout, blocks)
    _markings(mesh, scene, layout, blocks)
    colliders += _parked_cars(mesh, scene, layout, blocks, rng)
    cars = len(colliders)
    colliders += _buildings(mesh, scene, layout, blocks, rng)
    colliders += _trees(mesh, scene, layout, blocks, rng)
    lamps_right, lamps_left, posts = _street_lamps(mesh, scene, layout)
    colliders += posts
    return World(mesh.build(), np.array(colliders), cars, lamps_right, lamps_left)


def _car_hull(rear_m: float, y_m: float, forward: bool) -> tuple[float, ...]:
    half = car_body.LENGTH_M / 2
    centre = rear_m + half if forward else rear_m - half
    return (centre, y_m, 0.0 if forward else np.pi, half, car_body.WIDTH_M / 2)


def _blocks(scene: Scene) -> list[tuple[float, float]]:
    """Stretches of the street between side streets, world x [m]."""
    half = scene.road.cross_street_width_m / 2
    edges = [scene.road.start_m]
    for centre in sorted(scene.road.cross_streets_m):
        edges += [centre - half, centre + half]
    edges.append(scene.road.end_m)
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 4.0]


def _ground(
    mesh: MeshBuilder, scene: Scene, layout: _Layout, blocks: list[tuple[float, float]]
) -> None:
    road = scene.road
    x = (road.start_m - 30.0, road.end_m + 14.0)
    mesh.floor(x, (layout.kerb_right, layout.kerb_left), 0.0, materials.ASPHALT, _ASPHALT)
    for y in ((-90.0, layout.kerb_right), (layout.kerb_left, 100.0)):
        mesh.floor(x, y, -0.01, materials.ASPHALT, _ASPHALT, pitch_m=24.0)
    z, k = road.kerb_height_m, 0.18
    stone: Color = (0.40, 0.40, 0.39)
    for a, b in blocks:
        for inner, outer, sign in (
            (layout.kerb_right, layout.wall_right - 1.0, -1.0),
            (layout.kerb_left, layout.wall_left + 1.0, 1.0),
        ):
            y0, y1 = sorted((inner, inner + sign * k))
            for start in np.arange(a, b, 20.0):
                end = min(start + 20.0, b)
                mesh.box((start, y0, -0.01), (end, y1, z), materials.PLAIN, stone)
            y0, y1 = sorted((inner + sign * k, outer))
            mesh.floor((a, b), (y0, y1), z, materials.PAVING, _CONCRETE)
            for edge in (a, b):  # low walls where the sidewalk ends
                corners = [(edge, y0, -0.01), (edge, y1, -0.01), (edge, y1, z), (edge, y0, z)]
                mesh.quad(corners, materials.PLAIN, stone)


def _markings(
    mesh: MeshBuilder, scene: Scene, layout: _Layout, blocks: list[tuple[float, float]]
) -> None:
    z = 0.006
    lane = scene.road.lane_width_m

    def stripe(x0: float, x1: float, y0: float, y1: float) -> None:
        mesh.quad([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], materials.PAINT, _PAINT)

    ends = (scene.road.start_m, scene.road.end_m)
    for a, b in blocks:
        a_line = a + 1.0 if a == ends[0] else a + 6.5
        b_line = b - 1.0 if b == ends[1] else b - 6.5
        for start in np.arange(a_line, b_line - 3.0, 7.5):
            stripe(start, start + 3.0, layout.middle - 0.07, layout.middle + 0.07)
        for y in (-lane / 2 - 0.05, 1.5 * lane + 0.05):
            for start in np.arange(a_line, b_line, 12.0):
                stripe(start, min(start + 12.0, b_line), y - 0.05, y + 0.05)
        for start in np.arange(a_line + _PLACE_M, b_line, _PLACE_M):
            stripe(start - 0.05, start + 0.05, layout.kerb_right, layout.kerb_right + 2.0)
            stripe(start - 0.05, start + 0.05, layout.kerb_left - 2.0, layout.kerb_left)
        for edge in (a + 1.0, b - 4.0):  # zebra crossings
            if edge < ends[0] + 2.0 or edge > ends[1] - 5.0:
                continue
            for y in np.arange(layout.kerb_right + 0.5, layout.kerb_left - 0.6, 1.1):
                stripe(edge, edge + 3.0, y, y + 0.55)
        if b != ends[1]:  # stop line of the ego's lane
            stripe(b - 5.4, b - 5.0, -lane / 2 + 0.1, lane / 2 - 0.1)
        if a != ends[0]:
            stripe(a + 5.0, a + 5.4, lane / 2 + 0.1, 1.5 * lane - 0.1)


def _parked_cars(
    mesh: MeshBuilder,
    scene: Scene,
    layout: _Layout,
    blocks: list[tuple[float, float]],
    rng: np.random.Generator,
) -> list[tuple[float, ...]]:
    hulls = []
    half_strip = scene.road.parking_width_m / 2
    for a, b in blocks:
        for start in np.arange(a + 6.5, b - 6.5 - _PLACE_M, _PLACE_M):
            for y, forward in (
                (layout.kerb_right + half_strip, True),
                (layout.kerb_left - half_strip, False),
            ):
                taken, color, shift = rng.random(), rng.integers(len(_CARS)), rng.uniform(0.7, 1.4)
                sway = rng.uniform(-0.08, 0.08)
                if taken >= scene.furniture.parked_cars:
                    continue
                rear = start + shift if forward else start + shift + car_body.LENGTH_M
                yaw = 0.0 if forward else np.pi
                with mesh.place(rear, y + sway, yaw, instance=len(hulls) + 1):
                    car_body.add_car(mesh, _CARS[color], hazard=False, wheel_sides=8)
                hulls.append(_car_hull(rear, y + sway, forward))
    return hulls


def _buildings(
    mesh: MeshBuilder,
    scene: Scene,
    layout: _Layout,
    blocks: list[tuple[float, float]],
    rng: np.random.Generator,
) -> list[tuple[float, ...]]:
    hulls = []
    low, high = scene.buildings.width_m
    for a, b in blocks:
        for front, sign in ((layout.wall_right, -1.0), (layout.wall_left, 1.0)):
            x = a
            while x < b - 0.5:
                width = rng.uniform(low, high)
                end = b if b - x - width < low else x + width
                y0 = front + sign * rng.uniform(0.0, 0.5)
                y1 = front + sign * scene.buildings.depth_m
                height = rng.uniform(*scene.buildings.height_m)
                _building(mesh, (x, end), (y0, y1), height, rng)
                hulls.append(_box_hull(x, end, y0, y1))
                x = end
    # Rows behind the side streets and a tall building that closes the view.
    for centre in scene.road.cross_streets_m:
        for y0, y1 in ((-70.0, -84.0), (78.0, 92.0)):
            _building(mesh, (centre - 16, centre + 16), (y0, y1), rng.uniform(12, 26), rng)
    end = scene.road.end_m + 12.0
    for y0, y1 in ((-34.0, -12.0), (-12.0, 14.0), (14.0, 38.0)):
        _building(mesh, (end, end + 14.0), (y0, y1), rng.uniform(16, 34), rng)
        hulls.append(_box_hull(end, end + 14.0, y0, y1))
    return hulls


def _box_hull(x0: float, x1: float, y0: float, y1: float) -> tuple[float, ...]:
    return ((x0 + x1) / 2, (y0 + y1) / 2, 0.0, abs(x1 - x0) / 2, abs(y1 - y0) / 2)


def _building(
    mesh: MeshBuilder,
    x_m: tuple[float, float],
    y_m: tuple[float, float],
    height_m: float,
    rng: np.random.Generator,
) -> None:
    """One building; ``y_m``: its street front and its back."""
    color = _WALLS[rng.integers(len(_WALLS))]
    shade = rng.uniform(0.8, 1.15)
    color = (color[0] * shade, color[1] * shade, color[2] * shade)
    tag = int(rng.integers(1, 2**30))
    front, back = y_m
    sign = 1.0 if back > front else -1.0
    y0, y1 = sorted((front, back))
    roof: tuple[int, Color] = (materials.PLAIN, (0.20, 0.19, 0.18))
    shop = 4.2
    stone: Color = (0.34, 0.32, 0.30)
    mesh.box((x_m[0], y0, 0.0), (x_m[1], y1, shop), materials.SHOPFRONT, stone, tag)
    mesh.box((x_m[0], y0, shop), (x_m[1], y1, height_m), materials.FACADE, color, tag, roof)
    trim: Color = (color[0] * 0.7, color[1] * 0.7, color[2] * 0.7)
    for z, depth, thick in ((shop, 0.25, 0.35), (height_m - 0.3, 0.40, 0.7)):
        low, high = sorted((front - sign * depth, front + sign * 0.2))
        mesh.box((x_m[0], low, z), (x_m[1], high, z + thick), materials.PLAIN, trim)
        # A cornice is seen from below: give it an underside.
        corners = [(x_m[0], low, z), (x_m[0], high, z), (x_m[1], high, z), (x_m[1], low, z)]
        mesh.quad(corners, materials.PLAIN, trim)
    if rng.random() < 0.6:  # awning over the shop
        a = x_m[0] + rng.uniform(0.5, 2.0)
        b = min(x_m[1] - 0.5, a + rng.uniform(4.0, 8.0))
        cloth: Color = ((0.35, 0.05, 0.05), (0.05, 0.20, 0.12), (0.06, 0.10, 0.30))[rng.integers(3)]
        out = front - sign * 1.5
        slope = [(a, front, 3.6), (b, front, 3.6), (b, out, 2.9), (a, out, 2.9)]
        mesh.quad(slope, materials.PLAIN, cloth)
        mesh.quad(
            [(a, out, 2.9), (b, out, 2.9), (b, out, 2.6), (a, out, 2.6)], materials.PLAIN, cloth
        )


def _trees(
    mesh: MeshBuilder,
    scene: Scene,
    layout: _Layout,
    blocks: list[tuple[float, float]],
    rng: np.random.Generator,
) -> list[tuple[float, ...]]:
    hulls = []
    for a, b in blocks:
        for y in (layout.kerb_right - 1.1, layout.kerb_left + 1.1):
            for x in np.arange(
                a + 5.0 + rng.uniform(0, 6), b - 4.0, scene.furniture.tree_spacing_m
            ):
                plants.add_tree(mesh, x, y, scene.road.kerb_height_m, rng)
                hulls.append((x, y, 0.0, 0.16, 0.16))
    return hulls


def _street_lamps(
    mesh: MeshBuilder, scene: Scene, layout: _Layout
) -> tuple[tuple[float, float], tuple[float, float], list[tuple[float, ...]]]:
    spacing, height = scene.furniture.lamp_spacing_m, scene.furniture.lamp_height_m
    rows = []
    hulls = []
    for y, sign, shift in (
        (layout.kerb_right - 0.6, 1.0, 0.0),
        (layout.kerb_left + 0.6, -1.0, 0.5),
    ):
        first = scene.road.start_m + 9.0 + shift * spacing
        for x in np.arange(first, scene.road.end_m, spacing):
            top = (x, y, height)
            head = (x, y + sign * 1.6, height + 0.15)
            mesh.tube((x, y, 0.0), top, (0.09, 0.06), 6, materials.PLAIN, _POST)
            mesh.tube(top, head, (0.05, 0.05), 5, materials.PLAIN, _POST)
            low, high = sorted((head[1] - sign * 0.1, head[1] + sign * 0.7))
            z = head[2]
            mesh.box((x - 0.16, low, z - 0.05), (x + 0.16, high, z + 0.08), materials.PLAIN, _POST)
            face = [(x - 0.13, low, z - 0.06), (x - 0.13, high, z - 0.06)]
            face += [(x + 0.13, high, z - 0.06), (x + 0.13, low, z - 0.06)]
            mesh.quad(face, materials.STREET_LAMP, (0.8, 0.8, 0.75))
            hulls.append((x, y, 0.0, 0.1, 0.1))
        rows.append((first, y + sign * 1.9))
    return rows[0], rows[1], hulls
