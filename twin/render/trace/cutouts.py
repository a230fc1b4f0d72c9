"""Holes in faces: images whose alpha says where a ray passes.

What is there must not depend on who looks, or from how far: every ray reads the finest level, with
the same interpolation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from twin.world.meshes.details import Mask
from twin.world.meshes.mesh import Mesh


@wp.struct
class CutImage:
    """An image with holes."""

    first: wp.int32
    """Place of its first byte."""
    width: wp.int32
    height: wp.int32
    wrap: wp.int32
    """What it does beyond its borders along u, and along v times 4; see
    :mod:`twin.world.meshes.details`."""
    cutoff: wp.float32
    """Nothing is there below this alpha, 0..255."""


@wp.struct
class Cutouts:
    """Faces with holes; empty arrays: the world has none."""

    of_face: wp.array(dtype=wp.int32)
    """Image of each face [F]; -1: it has no holes."""
    images: wp.array(dtype=CutImage)
    alpha: wp.array(dtype=wp.uint8)
    """The images, one after another, their first rows on top."""


def masks_of_faces(meshes: Sequence[Mesh], mask_of_look: Sequence[int]) -> np.ndarray:
    """Number of each face's mask, int32 [F] in the order of the table of faces; -1: it has none.

    ``mask_of_look``: number of the mask of each look of the world, -1: none.
    """
    of_look = np.array([*mask_of_look, -1], np.int32)
    of_face = []
    for mesh in meshes:
        looks = np.full(len(mesh.faces), -1)
        if mesh.details is not None:
            there = mesh.details.row >= 0
            looks[there] = mesh.details.look[mesh.details.row[there]]
        of_face.append(of_look[looks])
    return np.concatenate(of_face)


def pack_cutouts(of_face: np.ndarray, masks: Sequence[Mask], device: wp.Device) -> Cutouts:
    """Put ``masks`` of a world on a device; ``of_face``: those of :func:`masks_of_faces`."""
    packed = Cutouts()
    if not masks:
        return packed
    rows = np.zeros(len(masks), CutImage.numpy_dtype())
    places: dict[int, int] = {}
    parts: list[np.ndarray] = []
    size = 0
    for row, mask in zip(rows, masks, strict=True):
        if id(mask.alpha) not in places:
            places[id(mask.alpha)] = size
            parts.append(mask.alpha.ravel())
            size += mask.alpha.size
        row["first"], row["wrap"] = places[id(mask.alpha)], mask.kind
        row["height"], row["width"] = mask.alpha.shape
        row["cutoff"] = mask.cutoff
    packed.of_face = wp.array(of_face, dtype=wp.int32, device=device)
    packed.images = wp.array(rows, dtype=CutImage, device=device)
    packed.alpha = wp.array(np.concatenate(parts), dtype=wp.uint8, device=device)
    return packed


def mark_holes(leaves: np.ndarray, of_face: np.ndarray, first_face: Sequence[int]) -> np.ndarray:
    """Leaves of single triangles with a word that is not 0 behind the second corner of faces with
    holes, so that a ray that meets a whole face reads nothing more of it.

    Args:
        leaves: words of :attr:`twin.render.trace.bvh.Bvh.leaves` of all meshes, one after another.
        of_face: those of :func:`masks_of_faces`.
        first_face: first face of each mesh, and the number of all.
    """
    rows = leaves.reshape(-1, 3, 4).copy()
    words = rows.view(np.int32)
    face = words[:, 0, 3] + np.repeat(first_face[:-1], np.diff(first_face))
    words[:, 1, 3] = of_face[face] >= 0
    return rows.ravel()


HOLE = """
    // Whether the image of a face has a hole where the weights of its first two corners are u, v.
    auto hole = [&](int row, float u, float v) -> bool {
        const int number = cuts.of_face.data[row];
        if (number < 0) return false;
        const auto& image = cuts.images.data[number];
        const wp::vec2* corner = corners.data + 3 * (size_t)row;
        const float w = 1.0f - u - v;
        float at[2];
        int low[2], high[2];
        for (int axis = 0; axis < 2; ++axis) {
            float c = corner[0][axis] * u + corner[1][axis] * v + corner[2][axis] * w;
            const int mode = (image.wrap >> (2 * axis)) & 3;
            const int size = axis ? image.height : image.width;
            if (mode == 1) c = c < 0.0f ? 0.0f : c > 1.0f ? 1.0f : c;
            else if (mode == 2) {
                c = c - 2.0f * floorf(0.5f * c);
                if (c > 1.0f) c = 2.0f - c;
            } else c = c - floorf(c);
            if (axis) c = 1.0f - c;
            c = c * (float)size - 0.5f;
            const float whole = floorf(c);
            at[axis] = c - whole;
            const int i = (int)whole;
            // From -1 to size - 1; a division would take most of the time.
            low[axis] = i >= 0 ? i : mode == 0 ? size - 1 : 0;
            high[axis] = i + 1 < size ? i + 1 : mode == 0 ? 0 : size - 1;
        }
        const unsigned char* alpha = cuts.alpha.data + image.first;
        const unsigned char* upper = alpha + (size_t)low[1] * image.width;
        const unsigned char* lower = alpha + (size_t)high[1] * image.width;
        const float a = upper[low[0]] * (1.0f - at[0]) + upper[high[0]] * at[0];
        const float b = lower[low[0]] * (1.0f - at[0]) + lower[high[0]] * at[0];
        return a * (1.0f - at[1]) + b * at[1] < image.cutoff;
    };
"""
"""Native code of a lambda ``hole(face, u, v)``; it needs ``cuts`` (:class:`Cutouts`) and
``corners``, the array of texture coordinates."""
