"""Fronts of buildings with real relief: window reveals, sills, balconies, shopfronts, cornices.

A front lies in its own axes: it runs along +x from 0, looks to -y and stands on z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.world.meshes import materials
from twin.world.meshes.mesh import Color, MeshBuilder

SHOP_HEIGHT_M = 4.2
"""Height of a ground floor [m]."""

_PANE: Color = (0.028, 0.034, 0.040)
_FRAMES: tuple[Color, ...] = ((0.62, 0.61, 0.58), (0.10, 0.10, 0.10), (0.20, 0.13, 0.08))
_IRON: Color = (0.045, 0.047, 0.05)
_DOORS: tuple[Color, ...] = ((0.12, 0.05, 0.03), (0.03, 0.07, 0.06), (0.05, 0.06, 0.12))
_BOARDS: tuple[Color, ...] = (
    (0.30, 0.04, 0.03),
    (0.03, 0.12, 0.09),
    (0.04, 0.07, 0.20),
    (0.45, 0.34, 0.06),
    (0.06, 0.06, 0.065),
    (0.42, 0.40, 0.36),
)
_CLOTHS: tuple[Color, ...] = (
    (0.36, 0.05, 0.05),
    (0.05, 0.20, 0.12),
    (0.06, 0.10, 0.30),
    (0.55, 0.50, 0.40),
)


@dataclass(frozen=True, slots=True)
class Style:
    """Looks of a building."""

    material: int
    color: Color
    trim: Color
    frame: Color
    pitch_m: float
    """Wanted distance of window axes [m]."""
    storey_m: float
    broad: float
    """Window width over the pitch [-]."""
    tall: float
    """Window height over the storey [-]."""
    recess_m: float
    balconies: int
    """Every n-th window axis has balconies; 0: none."""
    lintels: bool
    tag: int


def random_style(rng: np.random.Generator) -> Style:
    """One of four kinds of building, with its own measures and colours."""
    kind = rng.integers(4)
    shade = rng.uniform(0.82, 1.15)
    frame = _FRAMES[rng.integers(len(_FRAMES))]
    tag = int(rng.integers(1, 2**30))
    u = rng.random(4)
    if kind == 0:  # brick
        base = ((0.40, 0.19, 0.13), (0.30, 0.16, 0.12), (0.46, 0.27, 0.18))[rng.integers(3)]
        values = (3.1 + 0.7 * u[0], 3.3 + 0.4 * u[1], 0.38 + 0.08 * u[2], 0.54, 0.20, 0)
        return _style(materials.BRICK, base, shade, 1.25, frame, values, True, tag)
    if kind == 1:  # rendered, with balconies
        base = ((0.58, 0.53, 0.44), (0.55, 0.45, 0.34), (0.50, 0.50, 0.47))[rng.integers(3)]
        values = (3.3 + 0.8 * u[0], 3.2 + 0.3 * u[1], 0.42 + 0.1 * u[2], 0.60, 0.16, 3)
        return _style(materials.PLASTER, base, shade, 0.72, frame, values, False, tag)
    if kind == 2:  # stone
        base = ((0.46, 0.42, 0.35), (0.40, 0.38, 0.35), (0.52, 0.47, 0.38))[rng.integers(3)]
        values = (3.0 + 0.6 * u[0], 3.6 + 0.4 * u[1], 0.40 + 0.06 * u[2], 0.58, 0.26, 0)
        return _style(materials.PLASTER, base, shade, 1.18, frame, values, True, tag)
    base = ((0.30, 0.31, 0.33), (0.56, 0.56, 0.55), (0.22, 0.24, 0.27))[rng.integers(3)]
    values = (3.9 + 0.9 * u[0], 3.4 + 0.3 * u[1], 0.82, 0.58, 0.12, 0)  # bands of glass
    return _style(materials.PLASTER, base, shade, 0.8, (0.10, 0.10, 0.11), values, False, tag)


def _style(
    material: int,
    base: Color,
    shade: float,
    trim: float,
    frame: Color,
    values: tuple[float, ...],
    lintels: bool,
    tag: int,
) -> Style:
    color = (base[0] * shade, base[1] * shade, base[2] * shade)
    edge = (color[0] * trim, color[1] * trim, color[2] * trim)
    pitch, storey, broad, tall, recess, balconies = values
    return Style(
        material, color, edge, frame, pitch, storey, broad, tall, recess, int(balconies),
        lintels, tag,
    )  # fmt: skip


def upright(x0: np.ndarray, x1: np.ndarray, y: float, z0: np.ndarray, z1: np.ndarray) -> np.ndarray:
    """Quads [n, 4, 3] in the plane ``y`` that look to -y; arguments are broadcast."""
    x0, x1, z0, z1 = (a.ravel() for a in np.broadcast_arrays(x0, x1, z0, z1))
    depth = np.full_like(x0, y)
    corners = [(x0, depth, z0), (x1, depth, z0), (x1, depth, z1), (x0, depth, z1)]
    return np.stack([np.stack(c, axis=-1) for c in corners], axis=1)


def level(x0: np.ndarray, x1: np.ndarray, y0: float, y1: float, z: np.ndarray) -> np.ndarray:
    """Quads [n, 4, 3] at height ``z`` between ``y0`` and ``y1``; y0 < y1 looks up, else down."""
    x0, x1, z = (a.ravel() for a in np.broadcast_arrays(x0, x1, z))
    low, high = np.full_like(x0, y0), np.full_like(x0, y1)
    corners = [(x0, low, z), (x1, low, z), (x1, high, z), (x0, high, z)]
    return np.stack([np.stack(c, axis=-1) for c in corners], axis=1)


def beam(
    mesh: MeshBuilder,
    x_m: tuple[float, float],
    out_m: float,
    z_m: tuple[float, float],
    color: Color,
    material: int = materials.PLAIN,
    pitch_m: float = 13.0,
) -> None:
    """A ledge before the front: face, top, underside and ends."""
    cuts = np.linspace(*x_m, max(1, round((x_m[1] - x_m[0]) / pitch_m)) + 1)
    a, b = cuts[:-1], cuts[1:]
    low, high = np.full_like(a, z_m[0]), np.full_like(a, z_m[1])
    ends = []
    for x, near, far in ((x_m[0], 0.0, -out_m), (x_m[1], -out_m, 0.0)):
        ends.append([(x, near, z_m[0]), (x, far, z_m[0]), (x, far, z_m[1]), (x, near, z_m[1])])
    quads = [upright(a, b, -out_m, low, high), level(a, b, -out_m, 0.0, high)]
    quads += [level(a, b, 0.0, -out_m, low), np.array(ends, float)]
    mesh.quads(np.concatenate(quads), material, color)


def add_storeys(mesh: MeshBuilder, width_m: float, z_m: tuple[float, float], style: Style) -> None:
    """The windows and walls of a front from ``z_m[0]`` to ``z_m[1]``."""
    columns = max(1, round((width_m - 1.0) / style.pitch_m))
    rows = max(1, int((z_m[1] - z_m[0] - 0.8) / style.storey_m))
    storey = (z_m[1] - z_m[0] - 0.8) / rows
    pitch = (width_m - 0.8) / columns
    centre = 0.4 + pitch * (np.arange(columns) + 0.5)
    x0, x1 = centre - 0.5 * style.broad * pitch, centre + 0.5 * style.broad * pitch
    z0 = z_m[0] + storey * np.arange(rows) + 0.28 * storey
    z1 = z0 + style.tall * storey
    # Wall: bands between the rows of windows, piers between the windows.
    # Corners of bands lie between windows, never in a sill.
    bottom, top = np.append(z_m[0], z1), np.append(z0, z_m[1])
    inner = 0.4 + pitch * np.arange(1, columns)[2::3]
    cuts = np.concatenate([[0.0], inner, [width_m]])
    bands = upright(cuts[:-1, None], cuts[1:, None], 0.0, bottom, top)
    piers = upright(np.append(0.0, x1)[:, None], np.append(x0, width_m)[:, None], 0.0, z0, z1)
    mesh.quads(np.concatenate([bands, piers]), style.material, style.color, style.tag)
    a, b = np.repeat(x0, rows), np.repeat(x1, rows)
    low, high = np.tile(z0, columns), np.tile(z1, columns)
    depth = style.recess_m
    tags = style.tag + 7 * np.arange(len(a)) + 1
    mesh.quads(upright(a, b, depth, low, high), materials.WINDOW, _PANE, tags)
    reveal: Color = (style.color[0] * 0.9, style.color[1] * 0.9, style.color[2] * 0.9)
    mesh.quads(_reveals(a, b, depth, low, high), materials.PLAIN, reveal)
    _sills(mesh, a, b, depth, low, style)
    middle, half = (a + b) / 2, 0.035
    bars = upright(middle - half, middle + half, depth - 0.03, low, high)
    mesh.quads(bars, materials.PLAIN, style.frame)
    if style.lintels:
        mesh.quads(
            upright(a - 0.12, b + 0.12, -0.03, high, high + 0.22), materials.PLAIN, style.trim
        )
    if style.balconies:
        for column in range(1, columns - 1, style.balconies):
            for row in range(1, rows):
                _balcony(mesh, centre[column], 0.46 * pitch, z0[row] - 0.12, style)


def _reveals(
    a: np.ndarray, b: np.ndarray, depth: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Left, right and upper side of window openings [n, 4, 3]."""
    zero, back = np.zeros_like(a), np.full_like(a, depth)

    def quads(corners: list[tuple[np.ndarray, ...]]) -> np.ndarray:
        return np.stack([np.stack(c, axis=-1) for c in corners], axis=1)

    left = quads([(a, zero, low), (a, back, low), (a, back, high), (a, zero, high)])
    right = quads([(b, back, low), (b, zero, low), (b, zero, high), (b, back, high)])
    return np.concatenate([left, right, level(a, b, depth, 0.0, high)])


def _sills(
    mesh: MeshBuilder, a: np.ndarray, b: np.ndarray, depth: float, low: np.ndarray, style: Style
) -> None:
    a, b = a - 0.06, b + 0.06
    quads = [level(a, b, -0.09, depth, low), upright(a, b, -0.09, low - 0.09, low)]
    mesh.quads(np.concatenate(quads), materials.PLAIN, style.trim)


def _balcony(mesh: MeshBuilder, x_m: float, half_m: float, z_m: float, style: Style) -> None:
    out, rail = 1.05, 0.98
    x0, x1 = x_m - half_m, x_m + half_m
    beam(mesh, (x0, x1), out, (z_m - 0.16, z_m), style.trim)
    top, one = z_m + rail, np.ones(1)
    posts = np.linspace(x0 + 0.02, x1 - 0.02, 7)
    quads = [upright(posts - 0.015, posts + 0.015, -out + 0.04, z_m * one, top * one)]
    quads.append(upright(x0 * one, x1 * one, -out + 0.03, (top - 0.06) * one, top * one))
    for x in (x0 + 0.02, x1 - 0.02):  # side panels
        near, far = -0.02, -out + 0.04
        quads.append(np.array([[(x, near, z_m), (x, far, z_m), (x, far, top), (x, near, top)]]))
    mesh.quads(np.concatenate(quads), materials.PLAIN, _IRON)


def add_flat(mesh: MeshBuilder, width_m: float, top_m: float, style: Style) -> None:
    """A front without relief, for what is only seen from afar: its windows are painted on."""
    cuts = np.linspace(0.0, width_m, max(1, round(width_m / 10.0)) + 1)
    a, b, one = cuts[:-1], cuts[1:], np.ones(len(cuts) - 1)
    low = upright(a, b, 0.0, 0.0 * one, SHOP_HEIGHT_M * one)
    mesh.quads(low, materials.SHOPFRONT, (0.34, 0.32, 0.30), style.tag)
    high = upright(a, b, 0.0, SHOP_HEIGHT_M * one, top_m * one)
    mesh.quads(high, materials.FACADE, style.color, style.tag)


def add_shop(mesh: MeshBuilder, width_m: float, style: Style, rng: np.random.Generator) -> None:
    """A ground floor: piers, panes above a low wall, doors, a board and perhaps awnings."""
    height = SHOP_HEIGHT_M
    bays = max(1, round(width_m / 5.0))
    pitch = width_m / bays
    stone: Color = (0.30, 0.29, 0.27) if rng.random() < 0.6 else style.trim
    pier, depth, door_bay = 0.30, 0.35, int(rng.integers(bays))
    edges, one = pitch * np.arange(bays + 1), np.ones(bays)
    frieze = upright(edges[:-1], edges[1:], 0.0, 3.7 * one, height * one)
    mesh.quads(frieze, materials.PLASTER, stone, style.tag)
    for bay in range(bays):
        x0, x1 = pitch * bay + pier, pitch * (bay + 1) - pier
        piers = upright(
            np.array([x0 - pier, x1]), np.array([x0, x1 + pier]), 0.0, np.array(0.0), np.array(3.7)
        )
        mesh.quads(piers, materials.PLASTER, stone, style.tag)
        opening = _reveals(np.array([x0]), np.array([x1]), depth, np.array([0.0]), np.array([3.7]))
        mesh.quads(opening, materials.PLAIN, stone)
        split = x0 + 1.15 if bay == door_bay else x0
        if bay == door_bay:
            _door(mesh, (x0, split), depth, _DOORS[rng.integers(len(_DOORS))], style.tag + bay)
        _shop_panes(mesh, (split, x1), depth, style, stone, style.tag + 31 * bay + 5)
        board = _BOARDS[rng.integers(len(_BOARDS))]
        if rng.random() < 0.75:
            beam(mesh, (x0 - 0.1, x1 + 0.1), 0.14, (3.02, 3.62), board, pitch_m=20.0)
        if rng.random() < 0.28:
            _awning(mesh, (x0, x1), _CLOTHS[rng.integers(len(_CLOTHS))])


def _door(
    mesh: MeshBuilder, x_m: tuple[float, float], depth: float, color: Color, tag: int
) -> None:
    x0, x1 = x_m
    back = depth + 0.25
    one = np.ones(1)
    leaf = upright(x0 * one, x1 * one, back, 0.0 * one, 2.3 * one)
    mesh.quads(leaf, materials.PLAIN, color)
    glass = upright((x0 + 0.2) * one, (x1 - 0.2) * one, back - 0.02, 0.9 * one, 2.1 * one)
    glass = np.concatenate([glass, upright(x0 * one, x1 * one, back, 2.3 * one, 3.7 * one)])
    mesh.quads(glass, materials.WINDOW, _PANE, tag)
    handle = upright((x1 - 0.14) * one, (x1 - 0.10) * one, back - 0.06, 0.95 * one, 1.25 * one)
    mesh.quads(handle, materials.PLAIN, (0.5, 0.48, 0.42))


def _shop_panes(
    mesh: MeshBuilder, x_m: tuple[float, float], depth: float, style: Style, stone: Color, tag: int
) -> None:
    x0, x1 = x_m
    panes = max(1, round((x1 - x0) / 1.8))
    cuts = np.linspace(x0, x1, panes + 1)
    a, b = cuts[:-1], cuts[1:]
    low = np.full(panes, 0.55)
    mesh.quads(upright(a, b, depth, low, low + 3.15), materials.WINDOW, _PANE, tag)
    mesh.quads(upright(a, b, depth - 0.04, low - 0.55, low), materials.PLAIN, stone)
    mesh.quads(level(a, b, depth - 0.04, depth, low), materials.PLAIN, style.frame)
    bars = cuts[1:-1]
    posts = upright(bars - 0.04, bars + 0.04, depth - 0.03, np.array(0.55), np.array(3.7))
    one = np.ones(1)
    transom = upright(x0 * one, x1 * one, depth - 0.03, 2.75 * one, 2.83 * one)
    mesh.quads(np.concatenate([posts, transom]), materials.PLAIN, style.frame)


def _awning(mesh: MeshBuilder, x_m: tuple[float, float], cloth: Color) -> None:
    (a, b), out = x_m, 1.45
    top, low, hem = 3.0, 2.5, 2.24
    sheet = [
        [(a, 0, top), (a, -out, low), (b, -out, low), (b, 0, top)],
        [(a, -out, hem), (b, -out, hem), (b, -out, low), (a, -out, low)],
    ]
    mesh.quads(np.array(sheet, float), materials.PLAIN, cloth)
