"""Lambert shading under one sun with one shadow ray, packed RGBA: what the peer renders as well.

Nothing but the traversal costs time here, so its alternatives are measured with these kernels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from twin.base.portable_math import portable_cos_f32, portable_sin_f32
from twin.render.trace import bvh, traverse
from twin.render.trace.geometry import Geometry, RayScene, occluded, ray_functions, trace
from twin.world.street.build import World

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

AMBIENT = wp.constant(0.2)


@dataclass(frozen=True, slots=True)
class Way:
    """One way to render the pictures."""

    shape: bvh.BvhWidth | None = None
    """Shape of the hierarchies; None: that of the device."""
    traversal: str = "native"
    """``native``, or ``scalar``: the GPU's code on every device, or ``warp``: ``wp.Mesh``."""
    tile: tuple[int, int] = (8, 4)
    """Pixels of a tile; one warp is 32 pixels."""
    block: int = 128
    """Threads of a block."""
    leaf: int = 2
    """Faces of a leaf, for ``warp``."""
    registers: int = 8
    """Blocks that shall fit a multiprocessor at least; 0: as the compiler likes."""


class LambertCamera:
    """Renders Lambert pictures of a world's static mesh."""

    def __init__(
        self,
        world: World,
        eyes_m: np.ndarray,
        yaws_rad: np.ndarray,
        size_px: tuple[int, int],
        hfov_deg: float,
        sun: tuple[float, float, float],
        device: str,
        way: Way = Way(),
    ) -> None:
        """``eyes_m`` [S, 3], ``yaws_rad`` [S], ``size_px`` (width, height), ``sun`` unit, to it."""
        self._device = wp.get_device(device)
        self._way = way
        width, height = size_px
        self._geometry = Geometry(world, len(eyes_m), self._device, way.shape)
        views = np.column_stack([eyes_m, yaws_rad])
        self._views = wp.array(views, dtype=wp.vec4, device=self._device)
        self._image = wp.zeros((len(eyes_m), height, width), dtype=wp.uint32, device=self._device)
        self._tangent = math.tan(math.radians(hfov_deg) / 2)
        self._sun = wp.vec3(*sun)
        self._mesh = None
        if way.traversal == "warp":
            points = wp.array(world.mesh.points_m, dtype=wp.vec3, device=self._device)
            indices = wp.array(world.mesh.faces.ravel(), dtype=wp.int32, device=self._device)
            self._mesh = wp.Mesh(points, indices, bvh_constructor="sah", bvh_leaf_size=way.leaf)
        self._kernel = _kernel(way)

    def launch(self) -> None:
        """Render all views; the images stay on the device."""
        count, height, width = self._image.shape
        columns, rows = self._way.tile
        tiles = -(-width // columns) * -(-height // rows)
        wp.launch(
            self._kernel,
            count * tiles * columns * rows,
            inputs=[
                self._geometry.scene,
                self._mesh.id if self._mesh else wp.uint64(0),
                self._views,
                self._sun,
                self._tangent,
            ],
            outputs=[self._image],
            device=self._device,
            block_dim=self._way.block,
        )

    def image(self) -> np.ndarray:
        """Pixels, uint8 [S, H, W, 4]."""
        pixels: Any = self._image.numpy()
        return pixels.view(np.uint8).reshape(*pixels.shape, 4)


def _kernel(way: Way) -> wp.Kernel:
    """The kernel of a way, a module of its own."""
    columns, rows = way.tile
    warp_mesh = way.traversal == "warp"
    trace_ray, shadowed = trace, occluded
    if way.traversal == "scalar":
        trace_ray, shadowed = ray_functions(traverse.closest_scalar, traverse.blocked_scalar)
    bounds = {"launch_bounds": (way.block, way.registers)} if way.registers else {}

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False}, **bounds)
    def lambert_kernel(
        scene: RayScene,
        mesh: wp.uint64,
        views: wp.array(dtype=wp.vec4),
        sun: wp.vec3,
        tangent: wp.float32,
        image_out: wp.array3d(dtype=wp.uint32),
    ):
        thread = wp.tid()
        height = image_out.shape[1]
        width = image_out.shape[2]
        tiles_x = (width + wp.static(columns - 1)) / wp.static(columns)
        tiles_y = (height + wp.static(rows - 1)) / wp.static(rows)
        tile = thread / wp.static(columns * rows)
        inside = thread - tile * wp.static(columns * rows)
        slot = tile / (tiles_x * tiles_y)
        tile = tile - slot * tiles_x * tiles_y
        row = tile / tiles_x * wp.static(rows) + inside / wp.static(columns)
        column = (tile - tile / tiles_x * tiles_x) * wp.static(columns)
        column += inside % wp.static(columns)
        if row >= height or column >= width:
            return
        view = views[slot]
        c = portable_cos_f32(view[3])
        s = portable_sin_f32(view[3])
        scale = 2.0 * tangent / wp.float32(width)
        right = (wp.float32(column) + 0.5 - 0.5 * wp.float32(width)) * scale
        down = (wp.float32(row) + 0.5 - 0.5 * wp.float32(height)) * scale
        ahead = wp.vec3(c + s * right, s - c * right, -down)
        direction = wp.normalize(ahead)
        eye = wp.vec3(view[0], view[1], view[2])
        shade = wp.float32(0.0)
        normal = wp.vec3(0.0, 0.0, 0.0)
        t = wp.float32(-1.0)
        if wp.static(warp_mesh):
            query = wp.mesh_query_ray(mesh, eye, direction, 1200.0)
            if query.result:
                t = query.t
                normal = query.normal
                if wp.dot(normal, direction) > 0.0:
                    normal = -normal
        else:
            hit = trace_ray(scene, slot, eye, direction, 0.0, 1200.0)
            if hit.found:
                t = hit.t
                normal = hit.normal
        if t > 0.0:
            shade = AMBIENT
            facing = wp.dot(normal, sun)
            if facing > 0.0:
                start = eye + direction * t + normal * 0.02
                if wp.static(warp_mesh):
                    if not wp.mesh_query_ray_anyhit(mesh, start, sun, 400.0):
                        shade += facing
                else:
                    if not shadowed(scene, slot, start, sun, 400.0):
                        shade += facing
        level = wp.uint32(wp.min(255.0, 160.0 * shade))
        gray = level * wp.uint32(65793)
        image_out[slot, row, column] = gray + wp.uint32(4278190080)

    return lambert_kernel
