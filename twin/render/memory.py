"""GPU memory of a rig's cameras and LiDARs, added up before anything is allocated.

Everything grows with the number of slots in a straight line, so the largest number that fits is
known as well. Buffers follow the kernels' argument types; what cannot be known before the scene is
built (BVH nodes) is an upper bound.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from schemas.campaign import Camera
from twin.render.camera import wanted_of
from twin.render.light.light import SlotLight
from twin.render.looks import has_looks
from twin.render.outputs import bytes_per_pixel
from twin.render.post.chain import bytes_needed
from twin.render.trace.second_hits import DETAIL_HIT_BYTES_PER_PIXEL, HIT_BYTES_PER_PIXEL
from twin.render.trace.visibility import BYTES_PER_PIXEL, CHUNK_PIXELS, DETAIL_BYTES_PER_PIXEL
from twin.world.meshes.details import DATA
from twin.world.street.build import World

SLOTS_MAX = 1_000_000
"""Largest number of slots that is looked for."""
_BYTES_PER_TRIANGLE = 512
"""Corners, texture coordinates, baked light, face row and two kinds of BVH, rounded up."""
_BYTES_PER_BOX = 2 * 6 * 4
_RAY_BYTES = 3 * 4
_SKY_BYTES = 32 * 64 * 12
"""Table of the sky of a slot [bytes]."""
_OBJECT_BYTES = 256
"""Pose, sphere and look of a movable object, rounded up."""
_RESERVE_BYTES = 256 * 2**20
"""Kernels, their stacks, and rounding of the allocator."""


@dataclass(frozen=True, slots=True)
class LidarLoad:
    """What of a LiDAR takes memory."""

    name: str
    rays: int
    """Channels times columns of a sweep."""
    bytes_per_ray: int = 64
    """A point of the cloud and what its ray met on the way there, rounded up."""

    @property
    def row(self) -> MemoryRow:
        """Line of the plan that names it."""
        return MemoryRow(f"{self.name}: rays", 0, self.rays * self.bytes_per_ray)


@dataclass(frozen=True, slots=True)
class MemoryRow:
    """One line of the plan."""

    name: str
    fixed: int
    """[bytes]"""
    per_slot: int
    """[bytes]"""
    slots_max: int | None = None
    """Slots beyond this number take nothing more; None: all take the same."""

    def total(self, slots: int) -> int:
        """Memory for so many slots [bytes]."""
        return self.fixed + min(slots, self.slots_max or slots) * self.per_slot


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """What a rig takes on its GPU."""

    slots: int
    rows: tuple[MemoryRow, ...]

    @property
    def bytes_total(self) -> int:
        """All of it [bytes]."""
        return self.total(self.slots)

    def total(self, slots: int) -> int:
        """Memory for another number of slots [bytes]."""
        return sum(row.total(slots) for row in self.rows)

    def slots_max(self, free: int) -> int:
        """Largest number of slots that fits into ``free`` [bytes]; 0: not even one."""
        return max(0, bisect.bisect_right(range(SLOTS_MAX), free, key=self.total) - 1)

    def lines(self) -> list[str]:
        """The plan for people: one line per row, largest first, then the sum."""
        sizes = {row.name: row.total(self.slots) for row in self.rows}
        ranked = sorted(sizes.items(), key=lambda item: -item[1])
        found = [f"{size / 1e6:10,.1f} MB  {name}" for name, size in ranked]
        return [*found, f"{self.bytes_total / 1e6:10,.1f} MB  for {self.slots} slots"]

    def check(self, free: int) -> None:
        """Refuse what does not fit into ``free`` [bytes].

        Raises:
            ValueError: it does not; one line with the largest number of slots that does.
        """
        if self.bytes_total <= free:
            return
        most = self.slots_max(free)
        fits = f"at most {most} fit" if most else "not even one fits"
        raise ValueError(
            f"{self.slots} slots of this rig need {self.bytes_total / 1e9:.2f} GB of GPU memory "
            f"and {free / 1e9:.2f} GB are free: {fits}; ask for fewer slots, smaller pictures, "
            "fewer outputs or effects"
        )


def plan(
    cameras: Sequence[Camera],
    lidars: Sequence[LidarLoad],
    slots: int,
    *,
    triangles: int,
    texture_bytes: int = 0,
    instances: int = 0,
    objects: int = 0,
    sky_bytes: int = _SKY_BYTES,
    details: bool = False,
) -> MemoryPlan:
    """Memory for ``slots`` cases at once.

    Args:
        cameras: every camera of the campaign.
        lidars: every LiDAR of the campaign.
        slots: cases at once.
        triangles: of the street and of every kind of object.
        texture_bytes: of images and details of faces, see :func:`material_bytes` [bytes].
        instances: things that get a box.
        objects: movable objects in a slot.
        sky_bytes: a slot's table of the sky [bytes].
        details: whether pictures need details of faces, :func:`twin.render.looks.has_looks`.
    """
    rows = [
        MemoryRow("kernels and reserve", _RESERVE_BYTES, 0),
        MemoryRow("scene", triangles * _BYTES_PER_TRIANGLE + texture_bytes, 0),
        MemoryRow("movable objects", 0, objects * _OBJECT_BYTES),
    ]
    for camera in cameras:
        rows += camera_rows(camera, instances=instances, sky_bytes=sky_bytes, details=details)
    rows += [lidar.row for lidar in lidars]
    return MemoryPlan(slots, tuple(rows))


def material_bytes(world: World) -> int:
    """Memory of images, masks and details of faces on a device [bytes]."""
    kinds = world.texture_kinds or (0,) * len(world.textures)
    images = {
        (id(image), kind & DATA): image for image, kind in zip(world.textures, kinds, strict=True)
    }
    # With their halves; an odd edge is rounded up in each.
    total = sum(_with_halves(*image.shape[:2]) for image in images.values())
    total += sum({id(mask.alpha): mask.alpha.size for mask in world.masks}.values())
    meshes = [world.mesh, *(kind.mesh for kind in world.kinds)]
    faces = sum(len(mesh.faces) for mesh in meshes)
    total += 4 * faces if world.masks else 0
    if has_looks(world):
        total += 4 * faces + sum(mesh.details.bytes for mesh in meshes if mesh.details is not None)
    return total


def _with_halves(height: int, width: int) -> int:
    total = height * width
    while max(height, width) > 1:
        height, width = -(-height // 2), -(-width // 2)
        total += height * width
    return 4 * total


def camera_rows(
    camera: Camera, *, instances: int, sky_bytes: int = _SKY_BYTES, details: bool = False
) -> list[MemoryRow]:
    """What a camera takes; arguments as of :func:`plan`."""
    light = np.dtype(SlotLight.numpy_dtype()).itemsize
    small = instances * _BYTES_PER_BOX + light + sky_bytes
    on = camera.active_effects()
    pixels = camera.width * camera.height
    rows = [
        MemoryRow(f"{camera.name}: rays through the lens", pixels * _RAY_BYTES, 0),
        _under_way(camera, details=details),
        MemoryRow(f"{camera.name}: pictures", 0, pixels * bytes_per_pixel(wanted_of(camera))),
        MemoryRow(f"{camera.name}: light, sky and boxes", 0, small),
    ]
    if on:
        one, two = (bytes_needed(n, camera.height, camera.width, on) for n in (1, 2))
        rows.append(MemoryRow(f"{camera.name}: effects", 2 * one - two, two - one))
    return rows


def _under_way(camera: Camera, *, details: bool) -> MemoryRow:
    """Pixels are traced in chunks of whole pictures."""
    pixels = camera.width * camera.height
    size = BYTES_PER_PIXEL + (DETAIL_BYTES_PER_PIXEL if details else 0)
    if camera.reflections:
        size += HIT_BYTES_PER_PIXEL + (DETAIL_HIT_BYTES_PER_PIXEL if details else 0)
    most = max(1, CHUNK_PIXELS // pixels)
    return MemoryRow(f"{camera.name}: pixels under way", 0, pixels * size, most)


def check_free(found: MemoryPlan, device: wp.Device) -> None:
    """Refuse a plan that does not fit into what is free on ``device``; on a CPU nothing is refused.

    Raises:
        ValueError: it does not fit; one line.
    """
    if device.is_cuda:
        found.check(free_bytes(device))


def free_bytes(device: wp.Device) -> int:
    """What is free on a GPU [bytes].

    Asked about one that this process does not use yet, the driver makes a context and throws it
    away again, half a second each time (measured): so it is used from here on.
    """
    _ = device.context
    return int(device.free_memory)
