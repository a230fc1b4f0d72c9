"""Objects of a road file as faces and hulls of a world."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from twin.road.beside.bodies import (
    OutlineBody,
    RoadsideBody,
    StandingBody,
    SweptBody,
    body_axes,
)
from twin.road.beside.paint import PAINTED, object_paint
from twin.road.beside.placing import roadside_bodies
from twin.road.opendrive.grid import angle_of
from twin.road.opendrive.road_map import RoadMap
from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder
from twin.world.roadside.looks import CONCRETE, STEEL, ObjectLook, look_of
from twin.world.roadside.solids import add_band, add_box, add_cylinder, add_prism, add_walls
from twin.world.street.furniture import add_lamp
from twin.world.street.layout import Hull
from twin.world.street.plants import KINDS, add_shrub, add_tree
from twin.world.things import Thing, named

POINTS_MAX = 6_000_000
"""Most corners of the faces that a world has when objects, signals and scenery stand in it."""
CLEAR_M = 2.5
"""What hangs so far above the road is driven under [m]."""
FLAT_M = 0.25
"""What is lower is driven over [m]."""
_PAINT: Color = (0.70, 0.70, 0.67)
_ROOF: Color = (0.17, 0.165, 0.16)
_TREE_M, _LAMP_M, _POLE_M = 6.0, 7.5, 3.0
_POLE_RADIUS_M = 0.06
_TRUNK_M = 0.2
LUMINAIRE_M = 1.9
"""From the post of a street lamp to the middle of its luminaire [m]."""
_SHRUB_M = 1.2
_RAIL_M = 0.31
"""Height of the beam of a guard rail (EN 1317 rails are 0.31 m high) [m]."""
_RAIL_POST_M = 4.0
_THIN_M = 0.1


@dataclass(slots=True)
class RoadsideHulls:
    """Hulls that stand beside roads, and what they belong to."""

    hulls: list[Hull] = field(default_factory=list)
    things: list[Thing] = field(default_factory=list)
    lamps_m: list[tuple[float, float]] = field(default_factory=list)
    """World x, y of luminaires."""

    def add(self, name: str, kind: str, hulls: list[Hull]) -> None:
        """The hulls of one thing."""
        count = len(hulls)
        self.hulls += hulls
        self.things += [replace(named(name, kind), hull=i + 1, hulls=count) for i in range(count)]


def add_objects(mesh: MeshBuilder, roads: RoadMap) -> RoadsideHulls:
    """Add all objects of a road file; the hulls of solid ones.

    Raises:
        ValueError: there are too many; one line.
    """
    standing = RoadsideHulls()
    for number, body in enumerate(roadside_bodies(roads)):
        look = look_of(body.thing)
        if look is None:
            continue
        if body.thing.type in PAINTED:
            _add_paint(mesh, roads, body)
            continue
        if isinstance(body, StandingBody) and body.thing.type == "streetLamp":
            standing.lamps_m.append(_luminaire(body))
        with mesh.label(look.semantic):
            hulls = _add_body(mesh, body, look, number)
        if look.solid and body.above_m < CLEAR_M:
            name = body.thing.name or f"{body.thing.type} {body.thing.id}"
            standing.add(name, look.semantic, hulls)
        check_points(mesh, roads.network.file)
    return standing


def check_points(mesh: MeshBuilder, file: str) -> None:
    """Refuse a mesh with too many points.

    Raises:
        ValueError: the world has become too large; one line.
    """
    if mesh.count > POINTS_MAX:
        raise ValueError(
            f"{file}: what stands beside its roads has more than {POINTS_MAX} corners; "
            "use a part of it"
        )


def _add_paint(mesh: MeshBuilder, roads: RoadMap, body: RoadsideBody) -> None:
    with mesh.label("marking"):
        for patch in object_paint(roads, body):
            mesh.add(patch.points_m, patch.faces, materials.PAINT, _PAINT, DECAL)


def _add_body(mesh: MeshBuilder, body: RoadsideBody, look: ObjectLook, number: int) -> list[Hull]:
    if isinstance(body, SweptBody):
        return _add_swept(mesh, body, look)
    if isinstance(body, OutlineBody):
        return _add_outline(mesh, body, look, number)
    if body.thing.type == "tree":
        return _add_tree(mesh, body, number)
    if body.thing.type == "streetLamp":
        return _add_street_lamp(mesh, body)
    if body.thing.type == "gantry":
        return _add_gantry(mesh, body)
    return _add_standing(mesh, body, look, number)


def _rectangle(body: StandingBody, half_m: tuple[float, float]) -> Hull:
    x, y, _ = body.position_m
    return x, y, body.heading_rad, *half_m


def _add_standing(
    mesh: MeshBuilder, body: StandingBody, look: ObjectLook, number: int
) -> list[Hull]:
    length, width, height = body.size_m
    radius = body.radius_m
    if body.thing.type == "pole":
        height = height or _POLE_M
        radius = radius or 0.5 * min(length, width) or _POLE_RADIUS_M
    axes = body_axes(body.heading_rad, body.pitch_rad, body.roll_rad)
    foot = np.array(body.position_m)
    if radius > 0.0 and height > 0.0:
        if body.thing.type == "vegetation" and height <= _SHRUB_M:
            add_shrub(mesh, *body.position_m, np.random.default_rng([number, 1]))
        else:
            add_cylinder(mesh, foot, axes[2], radius, height, look.material, look.color)
        return [_rectangle(body, (radius, radius))] if height > FLAT_M else []
    if not length or not width or not height:
        return []
    tilted = body.pitch_rad != 0.0 or body.roll_rad != 0.0
    if look.material in materials.WALLS and not tilted:
        # Patterns of walls run along them only in axes of their own.
        x, y, z = body.position_m
        half = 0.5 * length, 0.5 * width
        with mesh.place(x, y, body.heading_rad, z_m=z):
            low, high = (-half[0], -half[1], 0.0), (*half, height)
            roof = materials.PLAIN, _ROOF
            mesh.box(low, high, look.material, look.color, number + 1, top=roof)
    else:
        add_box(mesh, foot, axes, (length, width, height), look.material, look.color, number + 1)
    return [_rectangle(body, (0.5 * length, 0.5 * width))] if height > FLAT_M else []


def _add_tree(mesh: MeshBuilder, body: StandingBody, number: int) -> list[Hull]:
    rng = np.random.default_rng([number, 0])
    kind = KINDS[number % len(KINDS)]
    height = body.size_m[2] or _TREE_M
    crown = body.radius_m or 0.5 * max(body.size_m[:2])
    share = min(max(crown / height, 0.05), 0.6) if crown > 0.0 else kind.crown
    shape = replace(kind, height_m=(height, height), crown=share)
    add_tree(mesh, *body.position_m, shape, rng)
    return [_rectangle(body, (_TRUNK_M, _TRUNK_M))]


def _add_street_lamp(mesh: MeshBuilder, body: StandingBody) -> list[Hull]:
    x, y, z = body.position_m
    # The arm of the lamp reaches along its -y axis.
    with mesh.place(x, y, body.inward_rad + 0.5 * np.pi, z_m=z):
        add_lamp(mesh, max(body.size_m[2] or _LAMP_M, 1.5))
    return [_rectangle(body, (_THIN_M, _THIN_M))]


def _luminaire(body: StandingBody) -> tuple[float, float]:
    """World x, y of the middle of a street lamp's luminaire."""
    x, y, _ = body.position_m
    direction = body_axes(body.inward_rad, 0.0, 0.0)[0]
    return x + LUMINAIRE_M * float(direction[0]), y + LUMINAIRE_M * float(direction[1])


def _add_gantry(mesh: MeshBuilder, body: StandingBody) -> list[Hull]:
    """A beam across the road on two posts."""
    length, width, height = body.size_m
    if not width or not height:
        return []
    axes = body_axes(body.heading_rad, 0.0, 0.0)
    foot, thick = np.array(body.position_m), max(min(length, 1.0), 0.3)
    up = np.array((0.0, 0.0, 1.0))
    deep = min(1.0, 0.3 * height)
    beam = (thick, width, deep)
    add_box(mesh, foot + (height - deep) * up, axes, beam, materials.PLAIN, STEEL)
    hulls: list[Hull] = []
    for side in (-0.5, 0.5):
        post = foot + side * (width - thick) * axes[1]
        add_box(mesh, post, axes, (thick, thick, height - deep), materials.PLAIN, STEEL)
        hulls.append((float(post[0]), float(post[1]), body.heading_rad, 0.5 * thick, 0.5 * thick))
    return hulls


def _add_outline(mesh: MeshBuilder, body: OutlineBody, look: ObjectLook, number: int) -> list[Hull]:
    base, height = body.base_m, body.height_m
    following = np.arange(1, len(base))
    if body.closed:
        top = (materials.PLAIN, _ROOF) if look.material in materials.WALLS else None
        add_prism(mesh, base, height, look.material, look.color, number + 1, top)
        following = np.append(following, 0)
    elif height.max() > 0.0:
        lifted = base + height[:, None] * np.array((0.0, 0.0, 1.0))
        add_walls(mesh, base, lifted, following, look.material, look.color, number + 1)
    if height.max() <= FLAT_M:
        return []
    return _edges(base, base[following % len(base)], _THIN_M)


def _edges(begins: np.ndarray, ends: np.ndarray, width_m: float | np.ndarray) -> list[Hull]:
    """Hulls along lines; ``width_m`` of all or of each."""
    widths = np.broadcast_to(width_m, (len(ends),)).tolist()
    hulls: list[Hull] = []
    for a, b, width in zip(begins, ends, widths, strict=False):
        way = (b - a)[:2]
        length = float(np.sqrt((way * way).sum()))
        if length > 1e-6:
            middle = 0.5 * (a + b)
            yaw = float(angle_of(way[1], way[0]))
            hulls.append((float(middle[0]), float(middle[1]), yaw, 0.5 * length, 0.5 * width))
    return hulls


def _add_swept(mesh: MeshBuilder, body: SweptBody, look: ObjectLook) -> list[Hull]:
    left, right, height = body.left_m, body.right_m, body.height_m
    if height.max() <= 0.0:
        return []
    if body.thing.type == "barrier" and body.thing.subtype == "guardRail":
        _add_guard_rail(mesh, body, look)
    else:
        add_band(mesh, left, right, height, look.material, look.color)
    middle = 0.5 * (left + right)
    widths = np.sqrt(((left - right)[:, :2] ** 2).sum(axis=1))
    if height.max() <= FLAT_M:
        return []
    return _edges(middle[:-1], middle[1:], 0.5 * (widths[:-1] + widths[1:]))


def _add_guard_rail(mesh: MeshBuilder, body: SweptBody, look: ObjectLook) -> None:
    """A beam at the top, and posts."""
    up = np.array((0.0, 0.0, 1.0))
    beam = np.minimum(body.height_m, _RAIL_M)
    lift = (body.height_m - beam)[:, None] * up
    add_band(mesh, body.left_m + lift, body.right_m + lift, beam, look.material, look.color)
    middle = 0.5 * (body.left_m + body.right_m)
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(middle[:, :2], axis=0).T)))
    posts = np.arange(0.5 * _RAIL_POST_M, way[-1], _RAIL_POST_M)
    rows = np.column_stack([middle, body.height_m - beam])
    for at in posts.tolist():
        x, y, z, tall = (float(np.interp(at, way, column)) for column in rows.T)
        if tall > 0.0:
            with mesh.place(x, y, z_m=z):
                size = (-0.05, -0.05, 0.0), (0.05, 0.05, tall)
                mesh.box(*size, materials.PLAIN, CONCRETE)
