"""Materials from files: what corners and maps say about a point of a face.

Kernels of worlds without such materials are compiled without this code
(:class:`twin.render.build.Features`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from twin.world.meshes.details import MAPS, FaceLook
from twin.world.meshes.mesh import Mesh
from twin.world.street.build import World

SMOOTH = 1 << 30
"""Bit of a face's row: its corners have normals. It stands there because rays to the sun ask for it
at every point."""


@wp.struct
class LookRow:
    """A material."""

    colored: wp.int32
    """1: corners have colours, which take the place of the face's."""
    mirrors: wp.int32
    """1: it mirrors strongly enough to be worth a ray."""
    images: wp.int32
    """Images to look at, that of the face's colour included."""
    emission: wp.vec3
    """Own luminance [cd/m^2]."""
    metallic: wp.float32
    roughness: wp.float32
    normal_scale: wp.float32


@wp.struct
class MapRow:
    """A map of a material."""

    texture: wp.int32
    """Image; -1: there is none."""
    u: wp.vec3
    """Its u from those of the face and 1."""
    v: wp.vec3
    scale: wp.float32
    """Its texture coordinates per one of the face."""


@wp.struct
class LookTables:
    """Details of faces; empty arrays: no face has any."""

    row: wp.array(dtype=wp.int32)
    """Row of each face [F], with :data:`SMOOTH` added where its corners have normals; -1: it has
    none."""
    look: wp.array(dtype=wp.int32)
    """Material of each row [R]."""
    table: wp.array(dtype=LookRow)
    """Materials [L]."""
    maps: wp.array2d(dtype=MapRow)
    """Their maps [L, 3], by their places in :mod:`twin.world.meshes.details`."""
    normal: wp.array(dtype=wp.vec3)
    """Of corners [3 R or 0], unit, in the mesh's own axes."""
    rise: wp.array(dtype=wp.vec2)
    """How far the next corner and the one after it lie above the plane through a corner across its
    normal [3 R or 0] [m]."""
    color: wp.array(dtype=wp.vec3)
    """Of corners [3 R or 0], linear RGB."""
    tangent: wp.array(dtype=wp.vec4)
    """Of corners [3 R or 0]; see :attr:`twin.world.meshes.details.FaceDetails.tangent`."""


def has_looks(world: World) -> bool:
    """Whether pictures of a world need the details of faces; masks alone do not."""
    return any(look != FaceLook(mask=look.mask) for look in world.looks)


def pack_looks(meshes: Sequence[Mesh], world: World, device: wp.Device) -> LookTables:
    """Put the details of ``meshes``, in the order of the table of faces, on a device."""
    packed = LookTables()
    if not has_looks(world):
        return packed
    rows, looks, parts = [], [], []
    count = 0
    for mesh in meshes:
        details = mesh.details
        if details is None:
            rows.append(np.full(len(mesh.faces), -1, np.int32))
            continue
        own = details.row + count
        smooth = np.array([look.smooth for look in world.looks])[details.look]
        own += np.where(smooth[details.row], SMOOTH, 0).astype(np.int32)
        rows.append(np.where(details.row >= 0, own, -1))
        looks.append(details.look)
        there = np.flatnonzero(details.row >= 0)
        order = np.empty(len(details.look), np.int64)
        order[details.row[there]] = there
        corners = mesh.points_m[mesh.faces[order]].astype(float)
        parts.append((details, rises(corners, details.normal)))
        count += len(details.look)
    table = np.zeros(len(world.looks), LookRow.numpy_dtype())
    maps = np.zeros((len(world.looks), MAPS), MapRow.numpy_dtype())
    for row, own, look in zip(table, maps, world.looks, strict=True):
        _fill(row, own, look)

    def corner_array(values: list[np.ndarray], width: int, dtype: Any) -> wp.array:
        wanted = any(len(value) for value in values)
        whole = [
            value if len(value) or not wanted else np.zeros((len(d.look), 3, width), np.float32)
            for value, (d, _) in zip(values, parts, strict=True)
        ]
        flat = np.concatenate(whole).reshape(-1, width)
        return wp.array(flat.astype(np.float32), dtype=dtype, device=device)

    packed.row = wp.array(np.concatenate(rows), dtype=wp.int32, device=device)
    packed.look = wp.array(np.concatenate(looks), dtype=wp.int32, device=device)
    packed.table = wp.array(table, dtype=LookRow, device=device)
    packed.maps = wp.array(maps, dtype=MapRow, device=device)
    packed.normal = corner_array([d.normal for d, _ in parts], 3, wp.vec3)
    packed.rise = corner_array([rise for _, rise in parts], 2, wp.vec2)
    packed.color = corner_array([d.color for d, _ in parts], 3, wp.vec3)
    packed.tangent = corner_array([d.tangent for d, _ in parts], 4, wp.vec4)
    return packed


def rises(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Values of :attr:`LookTables.rise`, float32 [R or 0, 3, 2], of corners [R, 3, 3] and their
    normals."""
    if not len(normals):
        return np.zeros((0, 3, 2), np.float32)
    to = [np.roll(corners, -step, axis=1) - corners for step in (1, 2)]
    return np.stack([(way * normals).sum(axis=2) for way in to], axis=2).astype(np.float32)


def _fill(row: Any, maps: Any, look: FaceLook) -> None:
    row["colored"], row["mirrors"] = look.colored, look.mirrors
    row["images"] = 1 + max(place + 1 if look.maps[place] >= 0 else 0 for place in range(MAPS))
    row["emission"] = look.emission
    row["metallic"], row["roughness"] = look.metallic, look.roughness
    row["normal_scale"] = look.normal_scale
    for own, texture, matrix in zip(maps, look.maps, look.map_from_uv, strict=True):
        a, b, c, d, e, f = matrix
        own["texture"], own["u"], own["v"] = texture, (a, b, c), (d, e, f)
        own["scale"] = abs(a * e - b * d) ** 0.5
