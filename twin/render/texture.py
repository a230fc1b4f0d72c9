"""Image textures: every image of a world with its halves in one array, a word per texel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from twin.base.portable.whole import whole_within_f32
from twin.world.meshes.details import CLAMP, DATA, MIRRORED, REPEAT
from twin.world.meshes.srgb import linear, srgb

_REPEAT, _CLAMP, _MIRRORED = (wp.constant(n) for n in (REPEAT, CLAMP, MIRRORED))
_DATA = wp.constant(DATA)


@wp.struct
class TextureImage:
    """Place of an image in the array."""

    first: wp.int32
    """Place of its first texel; the halves follow, each half as wide and high (rounded up)."""
    width: wp.int32
    height: wp.int32
    levels: wp.int32
    kind: wp.int32
    """What it does beyond its borders and what its bytes are, see
    :func:`twin.world.meshes.details.texture_kind`; 0: it repeats and is sRGB."""


@wp.struct
class Textures:
    """All images."""

    images: wp.array(dtype=TextureImage)
    texels: wp.array(dtype=wp.uint32)
    """Red in the lowest byte, then green and blue."""
    linear: wp.array(dtype=wp.float32)
    """Linear light of an sRGB byte [256]; where there are kinds, also the share of 255 of a byte
    that is a number [512]."""


def srgb_to_linear() -> np.ndarray:
    """float32 [256], IEC 61966-2-1."""
    return linear(np.arange(256) / 255.0).astype(np.float32)


def pack_textures(
    textures: Sequence[np.ndarray], device: wp.Device, kinds: Sequence[int] = ()
) -> Textures:
    """Put ``textures``, uint8 [h, w, 3] sRGB with the first row on top, on a device; ``kinds`` of
    each if they are not all usual."""
    values = srgb_to_linear()
    numbers = (np.arange(256) / 255.0).astype(np.float32)
    rows = np.zeros(max(1, len(textures)), TextureImage.numpy_dtype())
    parts: list[np.ndarray] = []
    first = 0
    places: dict[tuple[int, bool], Any] = {}
    for number, (row, texture) in enumerate(zip(rows, textures, strict=False)):
        data = bool(kinds) and bool(kinds[number] & DATA)
        key = (id(texture), data)
        if key in places:  # the same image, which goes on otherwise beyond its borders
            rows[number] = places[key]
            rows[number]["kind"] = kinds[number]
            continue
        row["first"], row["height"], row["width"] = first, *texture.shape[:2]
        row["kind"] = kinds[number] if kinds else 0
        level = texture
        while True:
            row["levels"] += 1
            parts.append(_words(level))
            first += parts[-1].size
            if max(level.shape[:2]) == 1:
                break
            level = _half_numbers(level) if data else _half(level, values)
        places[key] = row.copy()
    packed = Textures()
    packed.images = wp.array(rows, dtype=TextureImage, device=device)
    texels = np.concatenate(parts) if parts else np.zeros(1, np.uint32)
    packed.texels = wp.array(texels, dtype=wp.uint32, device=device)
    if kinds:
        values = np.concatenate([values, numbers])
    packed.linear = wp.array(values, dtype=wp.float32, device=device)
    return packed


def _words(level: np.ndarray) -> np.ndarray:
    """Texels uint8 [h, w, 3] as :attr:`Textures.texels` has them."""
    red, green, blue = level.reshape(-1, 3).T.astype(np.uint32)
    return np.asarray(red | green << np.uint32(8) | blue << np.uint32(16), np.uint32)


def _half(level: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Means of 2x2 texels in linear light; an odd edge stands for itself."""
    return np.round(255.0 * srgb(_means(values[level]))).astype(np.uint8)


def _half_numbers(level: np.ndarray) -> np.ndarray:
    """Means of 2x2 texels that are numbers."""
    return np.round(_means(level.astype(np.float32))).astype(np.uint8)


def _means(light: np.ndarray) -> np.ndarray:
    height, width = light.shape[:2]
    light = np.pad(light, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return light.reshape(light.shape[0] // 2, 2, light.shape[1] // 2, 2, 3).mean(axis=(1, 3))


# Native: an array's index is multiplied by its stride, of which four texels would have sixteen.
_TEXEL = """
    const unsigned word = texels.data[place];
    const float* light = linear.data + table;
    return wp::vec3(light[word & 255u], light[(word >> 8) & 255u], light[(word >> 16) & 255u]);
"""


@wp.func_native(_TEXEL)
def _texel(
    texels: wp.array(dtype=wp.uint32),
    linear: wp.array(dtype=wp.float32),
    place: wp.int32,
    table: wp.int32,
) -> wp.vec3:
    """A texel by the part of ``linear`` that begins at ``table``."""


@wp.func
def _between(
    textures: Textures,
    table: wp.int32,
    upper: wp.int32,
    lower: wp.int32,
    left: wp.int32,
    right: wp.int32,
    a: wp.float32,
    b: wp.float32,
) -> wp.vec3:
    """Bilinear: ``a`` from the column ``left`` to ``right``, ``b`` from the row that begins at
    ``upper`` to that at ``lower``."""
    above = _texel(textures.texels, textures.linear, upper + left, table) * (1.0 - a)
    above += _texel(textures.texels, textures.linear, upper + right, table) * a
    below = _texel(textures.texels, textures.linear, lower + left, table) * (1.0 - a)
    below += _texel(textures.texels, textures.linear, lower + right, table) * a
    return above * (1.0 - b) + below * b


@wp.func
def texture_at(
    textures: Textures, texture: wp.int32, uv: wp.vec2, footprint: wp.float32
) -> wp.vec3:
    """Linear RGB at ``uv`` (0, 0: lower left; repeated), bilinear.

    ``footprint``: width of the pixel in texture coordinates; coarser levels are read when it covers
    several texels.
    """
    image = textures.images[texture]
    width = image.width
    height = image.height
    first = image.first
    texels = footprint * wp.float32(wp.max(width, height))
    level = wp.int32(1)
    while texels > 1.5 and level < image.levels:
        first += width * height
        width = (width + 1) / 2
        height = (height + 1) / 2
        texels = texels * 0.5
        level += 1
    x = (uv[0] - wp.floor(uv[0])) * wp.float32(width) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * wp.float32(height) - 0.5
    i = whole_within_f32(wp.floor(x), -1, width)
    j = whole_within_f32(wp.floor(y), -1, height)
    a = x - wp.float32(i)
    b = y - wp.float32(j)
    left = (i + width) % width
    right = (i + 1) % width
    top = (j + height) % height * width
    bottom = (j + 1) % height * width
    return _between(textures, 0, first + top, first + bottom, left, right, a, b)


@wp.func
def _into(c: wp.float32, mode: wp.int32) -> wp.float32:
    """A texture coordinate brought into 0..1 as the image does beyond its borders."""
    if mode == _CLAMP:
        return wp.clamp(c, 0.0, 1.0)
    if mode == _MIRRORED:
        m = c - 2.0 * wp.floor(0.5 * c)
        return wp.where(m > 1.0, 2.0 - m, m)
    return c - wp.floor(c)


@wp.func
def _neighbour(i: wp.int32, size: wp.int32, mode: wp.int32) -> wp.int32:
    """Texel ``i``, from -1 to ``size``, as the image goes on; division would take most of the time
    of an image."""
    if i < 0:
        return wp.where(mode == _REPEAT, size - 1, 0)
    if i < size:
        return i
    return wp.where(mode == _REPEAT, 0, size - 1)


@wp.func
def sample(textures: Textures, texture: wp.int32, uv: wp.vec2, footprint: wp.float32) -> wp.vec3:
    """What :func:`texture_at` gives, of images of any kind: linear RGB, or numbers 0..1."""
    kind = textures.images[texture].kind
    across = kind & 3
    down = (kind >> 2) & 3
    table = wp.where((kind & _DATA) != 0, 256, 0)
    width = textures.images[texture].width
    height = textures.images[texture].height
    first = textures.images[texture].first
    levels = textures.images[texture].levels
    texels = footprint * wp.float32(wp.max(width, height))
    level = wp.int32(1)
    while texels > 1.5 and level < levels:
        first += width * height
        width = (width + 1) / 2
        height = (height + 1) / 2
        texels = texels * 0.5
        level += 1
    x = _into(uv[0], across) * wp.float32(width) - 0.5
    y = (1.0 - _into(uv[1], down)) * wp.float32(height) - 0.5
    i = whole_within_f32(wp.floor(x), -1, width)
    j = whole_within_f32(wp.floor(y), -1, height)
    a = x - wp.float32(i)
    b = y - wp.float32(j)
    left = _neighbour(i, width, across)
    right = _neighbour(i + 1, width, across)
    top = _neighbour(j, height, down) * width
    bottom = _neighbour(j + 1, height, down) * width
    return _between(textures, table, first + top, first + bottom, left, right, a, b)
