"""The effects of the post-processing once more in NumPy, straight from their definitions."""

from __future__ import annotations

import numpy as np

from twin.render.post.focus import ThinLens, taps, turns
from twin.render.post.motion import Shutter
from twin.render.tone import TABLE_LEN, tone_table

HALF = np.float16
F32 = np.float32


def tone(signal: np.ndarray) -> np.ndarray:
    """8-bit values of a linear signal."""
    x = np.maximum(signal, 0.0)
    return tone_table()[(x / (1.0 + x) * (TABLE_LEN - 1) + 0.5).astype(np.int64)]


def signal_of(values: np.ndarray) -> np.ndarray:
    """The linear signal in the middle of those that give an 8-bit value; 0 of 0."""
    table = tone_table().astype(int)
    u = np.array([np.flatnonzero(table == v).mean() for v in range(256)]) / (TABLE_LEN - 1)
    u[0] = 0.0
    return (u / (1.0 - u))[values]


def bilinear(image: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values of ``image`` [H, W, ...] between pixel centres, the edge repeated outside."""
    height, width = image.shape[:2]
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, across = (row - top)[..., None], (column - left)[..., None]
    rows = np.clip([top, top + 1], 0, height - 1)
    columns = np.clip([left, left + 1], 0, width - 1)
    upper = image[rows[0], columns[0]] * (1 - across) + image[rows[0], columns[1]] * across
    lower = image[rows[1], columns[0]] * (1 - across) + image[rows[1], columns[1]] * across
    return upper * (1 - down) + lower * down


def around(tiles: np.ndarray) -> np.ndarray:
    """Values [9, rows, columns, ...] of every tile and its neighbours, row by row."""
    rows, columns = tiles.shape[:2]
    near = np.pad(tiles, ((1, 1), (1, 1)) + ((0, 0),) * (tiles.ndim - 2), mode="edge")
    return np.stack([near[i : i + rows, j : j + columns] for i in range(3) for j in range(3)])


def tiled(values: np.ndarray, side: int) -> np.ndarray:
    """Values [side * side, rows, columns, ...] of every tile, its pixels row by row."""
    height, width = values.shape[:2]
    pad = ((0, -height % side), (0, -width % side)) + ((0, 0),) * (values.ndim - 2)
    full = np.pad(values, pad, mode="edge")
    shape = (full.shape[0] // side, side, full.shape[1] // side, side, *full.shape[2:])
    blocks = np.moveaxis(full.reshape(shape), (1, 3), (0, 1))
    return blocks.reshape(side * side, *blocks.shape[2:])


def untiled(tiles: np.ndarray, side: int, height: int, width: int) -> np.ndarray:
    """The value of its tile for every pixel."""
    return tiles.repeat(side, axis=0).repeat(side, axis=1)[:height, :width]


def _longest(ways: np.ndarray) -> np.ndarray:
    """The longest of ways [N, rows, columns, 2], the first of equal ones."""
    best = np.argmax((ways**2).sum(axis=-1), axis=0)
    return np.take_along_axis(ways, best[None, ..., None], axis=0)[0]


def motion(image: np.ndarray, flow: np.ndarray, depth: np.ndarray, shutter: Shutter) -> np.ndarray:
    """Eight taps along the own way, and along the longest nearby for what passes."""
    height, width, _ = image.shape
    rows, columns = np.mgrid[:height, :width]
    ways = flow.astype(F32) * F32(-shutter.share)
    length = np.sqrt((ways**2).sum(axis=-1))
    long = length > shutter.longest
    ways[long] *= (F32(shutter.longest) / length[long])[:, None]
    length = np.sqrt((ways**2).sum(axis=-1))
    nearby = _longest(around(_longest(tiled(ways, shutter.tile))))
    nearby = untiled(nearby, shutter.tile, height, width)
    faster = 1.5 * length + 1.0

    own, passing, count = np.zeros(image.shape), np.zeros(image.shape), np.zeros(length.shape)
    for i in range(8):
        u = F32((i + 0.5) / 8 - 0.5)
        x, y = (
            np.floor(a + ways[..., k] * u + F32(0.5)).astype(int)
            for k, a in enumerate((columns, rows))
        )
        own += image[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)] / 8
        x, y = (
            np.floor(a + nearby[..., k] * u + F32(0.5)).astype(int)
            for k, a in enumerate((columns, rows))
        )
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        other, way = ways[y, x], np.maximum(length[y, x], 1e-9)
        along = np.abs(other[..., 0] * (x - columns) + other[..., 1] * (y - rows)) / way
        beside = np.abs(other[..., 0] * (y - rows) - other[..., 1] * (x - columns)) / way
        covers = inside & (way > faster) & (along <= 0.5 * way) & (beside <= 1.5)
        covers &= (depth[y, x] <= depth) & (np.sqrt((nearby**2).sum(axis=-1)) > faster)
        passing += image[y, x] * covers[..., None]
        count += covers
    found = np.where((length > 0.5)[..., None], own, image)
    return (passing + found * (8 - count)[..., None]) / 8


def scattered(image: np.ndarray, sizes: list[tuple[int, int]], wider: float) -> np.ndarray:
    """The light that bloom mixes in, at half the size of ``image``, from even sizes."""
    height, width, _ = image.shape
    levels = [image.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))]
    for _ in sizes[1:]:
        fine = np.pad(levels[-1], ((1, 1), (1, 1), (0, 0)), mode="edge")
        weights = (0.125, 0.375, 0.375, 0.125)
        down = sum(w * fine[i : fine.shape[0] - 3 + i : 2] for i, w in enumerate(weights))
        level = sum(w * down[:, i : down.shape[1] - 3 + i : 2] for i, w in enumerate(weights))
        levels.append(level)
    found = levels.pop()
    while levels:
        fine = levels.pop()
        rows, columns = np.mgrid[: fine.shape[0], : fine.shape[1]]
        found = (
            fine * (1 - wider) + bilinear(found, 0.5 * rows - 0.25, 0.5 * columns - 0.25) * wider
        )
    return found


def focus(image: np.ndarray, depth: np.ndarray, lens: ThinLens) -> np.ndarray:
    """Depth of field by gathering: every sample is a disc of its own or of the pixel's size."""
    height, width = depth.shape
    size = lens.tile
    discs = np.minimum(np.abs(lens.inverse_m - 1.0 / depth) * lens.strength, lens.radius_max)
    near = np.where(depth * lens.inverse_m < 1.0, discs, 0.0)
    widened = untiled(around(tiled(near, size).max(axis=0)).max(axis=0), size, height, width)
    reach = np.maximum(discs, widened).astype(F32)

    rows, columns = np.mgrid[:height, :width]
    turn = turns()[(rows & 3) * 4 + (columns & 3)]
    area = reach**2 / len(taps())
    behind_weight = np.minimum(1.0, area / np.maximum(discs, 0.5) ** 2)
    behind = image * behind_weight[..., None]
    before, before_weight = np.zeros(image.shape), np.zeros(depth.shape)
    for tap in taps():
        sample = tap * reach[..., None]
        x = columns + np.floor(
            turn[..., 0] * sample[..., 0] - turn[..., 1] * sample[..., 1] + F32(0.5)
        ).astype(int)
        y = rows + np.floor(
            turn[..., 1] * sample[..., 0] + turn[..., 0] * sample[..., 1] + F32(0.5)
        ).astype(int)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        disc = np.where(depth[y, x] < depth, discs[y, x], discs)
        cover = np.clip(disc - sample[..., 2] + 0.5, 0.0, 1.0) * inside
        weight = cover * area / np.maximum(disc, 0.5) ** 2
        covers = disc > discs
        before += image[y, x] * (weight * covers)[..., None]
        before_weight += weight * covers
        behind += image[y, x] * (weight * ~covers)[..., None]
        behind_weight += weight * ~covers
    share = np.minimum(before_weight, 1.0)[..., None]
    mean = before / np.where(before_weight > 0.0, before_weight, 1.0)[..., None]
    rest = behind / np.where(behind_weight > 0.0, behind_weight, 1.0)[..., None]
    found = rest * (1.0 - share) + mean * share
    return np.where((reach < 0.5)[..., None], image, found)


def mix64(x: np.ndarray) -> np.ndarray:
    """SplitMix's finaliser."""
    with np.errstate(over="ignore"):
        a = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        b = (a ^ (a >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return b ^ (b >> np.uint64(31))


def normals(key: int, tick: int, elements: np.ndarray) -> np.ndarray:
    """Nearly normal numbers of a stream."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        start = mix64(np.array([key], np.uint64) + golden * np.uint64(tick + 1))
        bits = mix64(start + golden * (elements.astype(np.uint64) + np.uint64(1)))
    parts = [(bits >> np.uint64(s)) & np.uint64(1023) for s in (0, 10, 20, 30)]
    return (sum(p.astype(float) for p in parts) - 2046.0) / 591.20685
