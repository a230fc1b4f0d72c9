"""Image textures: every image of a world with its halves in one array of bytes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from twin.world.meshes.srgb import linear, srgb


@wp.struct
class TextureImage:
    """Place of an image in the array."""

    first: wp.int32
    """Place of its first byte; the halves follow, each half as wide and high (rounded up)."""
    width: wp.int32
    height: wp.int32
    levels: wp.int32


@wp.struct
class Textures:
    """All images."""

    images: wp.array(dtype=TextureImage)
    texels: wp.array(dtype=wp.uint8)
    linear: wp.array(dtype=wp.float32)
    """Linear light of an sRGB byte [256]."""


def srgb_to_linear() -> np.ndarray:
    """float32 [256], IEC 61966-2-1."""
    return linear(np.arange(256) / 255.0).astype(np.float32)


def pack_textures(textures: Sequence[np.ndarray], device: wp.Device) -> Textures:
    """Put ``textures``, uint8 [h, w, 3] sRGB with the first row on top, on a device."""
    values = srgb_to_linear()
    rows = np.zeros(max(1, len(textures)), TextureImage.numpy_dtype())
    parts, first = [], 0
    for row, texture in zip(rows, textures, strict=False):
        row["first"], row["height"], row["width"] = first, *texture.shape[:2]
        level = texture
        while True:
            row["levels"] += 1
            parts.append(level.ravel())
            first += level.size
            if max(level.shape[:2]) == 1:
                break
            level = _half(level, values)
    packed = Textures()
    packed.images = wp.array(rows, dtype=TextureImage, device=device)
    texels = np.concatenate(parts) if parts else np.zeros(3, np.uint8)
    packed.texels = wp.array(texels, dtype=wp.uint8, device=device)
    packed.linear = wp.array(values, dtype=wp.float32, device=device)
    return packed


def _half(level: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Means of 2x2 texels in linear light; an odd edge stands for itself."""
    height, width = level.shape[:2]
    light = values[level]
    light = np.pad(light, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    mean = light.reshape(light.shape[0] // 2, 2, light.shape[1] // 2, 2, 3).mean(axis=(1, 3))
    return np.round(255.0 * srgb(mean)).astype(np.uint8)


@wp.func
def _texel(textures: Textures, place: wp.int32) -> wp.vec3:
    return wp.vec3(
        textures.linear[wp.int32(textures.texels[place])],
        textures.linear[wp.int32(textures.texels[place + 1])],
        textures.linear[wp.int32(textures.texels[place + 2])],
    )


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
        first += width * height * 3
        width = (width + 1) / 2
        height = (height + 1) / 2
        texels = texels * 0.5
        level += 1
    x = (uv[0] - wp.floor(uv[0])) * wp.float32(width) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * wp.float32(height) - 0.5
    i = wp.int32(wp.floor(x))
    j = wp.int32(wp.floor(y))
    a = x - wp.float32(i)
    b = y - wp.float32(j)
    left = (i + width) % width
    right = (i + 1) % width
    top = (j + height) % height * width
    bottom = (j + 1) % height * width
    upper = _texel(textures, first + 3 * (top + left)) * (1.0 - a)
    upper += _texel(textures, first + 3 * (top + right)) * a
    lower = _texel(textures, first + 3 * (bottom + left)) * (1.0 - a)
    lower += _texel(textures, first + 3 * (bottom + right)) * a
    return upper * (1.0 - b) + lower * b
