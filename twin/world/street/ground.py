"""Roadways, sidewalks, kerbs and markings of the street and its side streets."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import DECAL, Color, MeshBuilder
from twin.world.scene import Scene
from twin.world.street.layout import SIDE_REACH_M, SIDE_WALK_M, Layout, StreetBlock, generator

ASPHALT: Color = (0.09, 0.09, 0.095)
_PARKING: Color = (0.105, 0.10, 0.098)
_CONCRETE: Color = (0.30, 0.29, 0.27)
_STONE: Color = (0.40, 0.40, 0.39)
_PAINT: Color = (0.70, 0.70, 0.67)
_IRON: Color = (0.055, 0.05, 0.048)
PLACE_M = 6.6
"""Length of one parking place [m]."""
_KERB_M = 0.18
_PITCH_M = 3.2  # fine enough for the shade at the foot of a wall
_MARK_Z = 0.006
DASH_PITCH_M = 7.5
"""Distance from the beginning of one dash of the middle line to that of the next [m]."""
_GRASS: Color = (0.09, 0.13, 0.045)
_MARGIN_M = 60.0
_APRON_M = 1.6
"""Sidewalks of curves reach this far behind the wall's line, because fronts are straight [m]."""


def add_ground(mesh: MeshBuilder, scene: Scene, layout: Layout) -> None:
    """Add everything that is walked or driven on."""
    x = (layout.start - layout.ends, layout.end + layout.ends)
    reach = SIDE_REACH_M + 6.0
    if layout.lane.closed:
        _meadow(mesh, layout)
    with mesh.label("road"):
        if not layout.lane.closed:
            y = (layout.middle - reach - 20.0, layout.middle + reach + 20.0)
            base = (x[0] - 30.0, x[1] + 30.0)
            mesh.floor(base, y, -0.03, materials.ASPHALT, ASPHALT, pitch_m=24.0)
        lane = scene.road.lane_width_m / 2
        edges = (layout.kerb_right, -lane - 0.1, 3 * lane + 0.1, layout.kerb_left)
        for i, color in enumerate((_PARKING, ASPHALT, _PARKING)):
            strip = (edges[i], edges[i + 1])
            strip_floor(mesh, layout, x, strip, 0.0, materials.ASPHALT, color, 4.4)
        for centre in layout.sides:
            side = (centre - layout.half_side, centre + layout.half_side)
            for kerb, _, sign in layout.rows():
                arm = _sorted(kerb, layout.middle + sign * reach)
                mesh.floor(side, arm, 0.0, materials.ASPHALT, ASPHALT, pitch_m=4.0)
    with mesh.label("sidewalk"):
        for block in layout.blocks:
            for row in layout.rows():
                _sidewalk(mesh, scene, layout, block, row)
    _markings(mesh, scene, layout)


def _meadow(mesh: MeshBuilder, layout: Layout) -> None:
    """Grass around and inside a closed road."""
    lane = layout.lane.at(np.arange(0.0, layout.lane.length_m, 5.0))
    x = (float(lane.x_m.min()) - _MARGIN_M, float(lane.x_m.max()) + _MARGIN_M)
    y = (float(lane.y_m.min()) - _MARGIN_M, float(lane.y_m.max()) + _MARGIN_M)
    with mesh.label("terrain"):
        mesh.floor(x, y, -0.03, materials.GRASS, _GRASS, pitch_m=24.0)


def strip_floor(
    mesh: MeshBuilder,
    layout: Layout,
    x_m: tuple[float, float],
    y_m: tuple[float, float],
    z_m: float,
    material: int,
    color: Color,
    pitch_m: float,
) -> None:
    """A level strip along the street, in pieces of about ``pitch_m``."""
    columns = max(1, math.ceil((x_m[1] - x_m[0]) / pitch_m))
    rows = max(1, math.ceil((y_m[1] - y_m[0]) / pitch_m))
    with mesh.bent(layout.bend):
        ys = np.linspace(*y_m, rows + 1)
        mesh.grid(layout.cuts(*x_m, columns), ys, z_m, material, color)


def _sorted(a: float, b: float) -> tuple[float, float]:
    return (min(a, b), max(a, b))


def _sidewalk(
    mesh: MeshBuilder,
    scene: Scene,
    layout: Layout,
    block: StreetBlock,
    row: tuple[float, float, float],
) -> None:
    """The sidewalk before one row of buildings, and its arms along the side streets."""
    kerb, wall, sign = row
    z = scene.road.kerb_height_m
    far = layout.middle + sign * (SIDE_REACH_M + 6.0)
    start = block.start if block.opens else block.start - layout.ends
    end = block.end if block.closes else block.end + layout.ends
    inner = kerb + sign * _KERB_M
    cuts = layout.cuts(start, end, max(1, round((end - start) / 4.0)))
    with mesh.bent(layout.bend):
        _kerb(mesh, np.stack([cuts, np.full(len(cuts), kerb)], 1), (0.0, sign), z)
    walk = (start + _KERB_M * block.opens, end - _KERB_M * block.closes)
    apron = _APRON_M if block.curvature and not layout.has_square(block, sign) else 0.0
    across = _sorted(inner, wall + sign * apron)
    strip_floor(mesh, layout, walk, across, z, materials.PAVING, _CONCRETE, _PITCH_M)
    for edge, way, there in ((block.start, 1.0, block.opens), (block.end, -1.0, block.closes)):
        if not there:
            continue
        cuts = np.linspace(inner, far, max(1, round(abs(far - inner) / 4.0)) + 1)
        _kerb(mesh, np.stack([np.full(len(cuts), edge), cuts], 1), (way, 0.0), z)
        arm = _sorted(edge + way * _KERB_M, edge + way * SIDE_WALK_M)
        mesh.floor(arm, _sorted(wall, far), z, materials.PAVING, _CONCRETE, _PITCH_M)


def _kerb(mesh: MeshBuilder, line: np.ndarray, out: tuple[float, float], z_m: float) -> None:
    """A kerb stone along ``line`` [n, 2]; ``out``: unit vector off the roadway."""
    back = line + np.array(out) * _KERB_M
    low, high = np.full((len(line), 1), -0.02), np.full((len(line), 1), z_m)
    foot, lip, rear = (np.hstack(pair) for pair in ((line, low), (line, high), (back, high)))
    face = np.stack([foot[:-1], foot[1:], lip[1:], lip[:-1]], axis=1)
    top = np.stack([lip[:-1], lip[1:], rear[1:], rear[:-1]], axis=1)
    if np.cross(top[0, 1] - top[0, 0], top[0, 2] - top[0, 0])[2] < 0:
        face, top = face[:, ::-1], top[:, ::-1]
    mesh.quads(np.concatenate([face, top]), materials.PLAIN, _STONE)


class _Stripes:
    """Collects painted rectangles; those along a curve are cut."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.rows: list[tuple[float, float, float, float]] = []

    def add(self, x0: float, x1: float, y0: float, y1: float) -> None:
        for a, b in pairwise(self._layout.cuts(*_sorted(x0, x1), 1).tolist()):
            self.rows.append((a, b, *_sorted(y0, y1)))

    def quads(self) -> np.ndarray:
        x0, x1, y0, y1 = np.array(self.rows).T
        z = np.full_like(x0, _MARK_Z)
        corners = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        return np.stack([np.stack(c, axis=-1) for c in corners], axis=1)


def _markings(mesh: MeshBuilder, scene: Scene, layout: Layout) -> None:
    stripes = _Stripes(layout)
    if layout.lane.closed:
        _lane_lines(stripes, scene, layout, (layout.start, layout.end))
    for block in layout.blocks:
        _block_markings(stripes, scene, layout, block)
    for centre in layout.sides:
        for kerb, wall, sign in layout.rows():
            _side_markings(stripes, layout, centre, (kerb, wall, sign))
    with mesh.label("marking"), mesh.bent(layout.bend):
        mesh.quads(stripes.quads(), materials.PAINT, _PAINT, DECAL)
    with mesh.label("road"), mesh.bent(layout.bend):
        _manholes(mesh, scene, layout)


def _lane_lines(stripes: _Stripes, scene: Scene, layout: Layout, x_m: tuple[float, float]) -> None:
    """The dashed middle line and both edge lines."""
    lane = scene.road.lane_width_m
    start, end = x_m
    pitch = DASH_PITCH_M
    if layout.lane.closed:  # the last dash is as far from the first as the others are
        pitch = (end - start) / round((end - start) / pitch)
    for x in np.arange(start, end - 3.0, pitch):
        stripes.add(x, x + 3.0, layout.middle - 0.07, layout.middle + 0.07)
    for y in (-lane / 2 - 0.05, 1.5 * lane + 0.05):
        for x in np.arange(start, end, 6.0):
            stripes.add(x, min(x + 6.0, end), y - 0.05, y + 0.05)


def _block_markings(stripes: _Stripes, scene: Scene, layout: Layout, block: StreetBlock) -> None:
    lane = scene.road.lane_width_m
    start = block.start + (6.5 if block.opens else -layout.ends + 1.0)
    end = block.end - (6.5 if block.closes else -layout.ends + 1.0)
    if layout.lane.closed:
        start, end = block.parking
    else:
        _lane_lines(stripes, scene, layout, (start, end))
    for x in np.arange(start + PLACE_M, end, PLACE_M):
        stripes.add(x - 0.05, x + 0.05, layout.kerb_right, layout.kerb_right + 2.0)
        stripes.add(x - 0.05, x + 0.05, layout.kerb_left - 2.0, layout.kerb_left)
    for edge, there in ((block.start + 1.0, block.opens), (block.end - 4.0, block.closes)):
        if there:
            for y in np.arange(layout.kerb_right + 0.5, layout.kerb_left - 0.6, 1.1):
                stripes.add(edge, edge + 3.0, y, y + 0.55)
    if block.closes:  # stop line of the ego's lane
        stripes.add(block.end - 5.4, block.end - 5.0, -lane / 2 + 0.1, lane / 2 - 0.1)
    if block.opens:
        stripes.add(block.start + 5.0, block.start + 5.4, lane / 2 + 0.1, 1.5 * lane - 0.1)


def _side_markings(
    stripes: _Stripes, layout: Layout, centre: float, row: tuple[float, float, float]
) -> None:
    """A zebra crossing at the corner, the stop line behind it, and the middle line."""
    kerb, wall, sign = row
    half = layout.half_side
    for x in np.arange(centre - half + 0.5, centre + half - 0.6, 1.1):
        stripes.add(x, x + 0.55, kerb + sign * 0.9, kerb + sign * 3.7)
    # Traffic keeps right: from +y one drives to -y on the side x < centre.
    lane = (centre - sign * 0.1, centre - sign * (half - 0.3))
    stripes.add(*lane, wall + sign * 0.3, wall + sign * 0.7)
    far = layout.middle + sign * (SIDE_REACH_M + 2.0)
    for y in np.arange(wall + sign * 3.0, far, sign * 7.5):
        stripes.add(centre - 0.06, centre + 0.06, y, y + sign * 3.0)


def _manholes(mesh: MeshBuilder, scene: Scene, layout: Layout) -> None:
    """Iron lids and gullies; they lie flush and are no ground of their own."""
    rng = generator(scene, 2)
    angle = 2.0 * np.pi * np.arange(12) / 12
    ring = np.stack([0.33 * np.cos(angle), 0.33 * np.sin(angle), np.zeros(12)], axis=1)
    fan = np.array([(0, i, i + 1) for i in range(1, 11)])
    for x in np.arange(layout.start + 8.0, layout.end, 23.0):
        at = (x + rng.uniform(-4, 4), layout.middle + rng.choice((-1.9, 1.6)), 0.004)
        mesh.add(ring + at, fan, materials.PAINT, _IRON, DECAL)
        for y in (layout.kerb_right + 0.02, layout.kerb_left - 0.42):
            gully = [(at[0], y, 0.004), (at[0] + 0.5, y, 0.004)]
            gully += [(at[0] + 0.5, y + 0.4, 0.004), (at[0], y + 0.4, 0.004)]
            mesh.quad(gully, materials.PAINT, _IRON, DECAL)
