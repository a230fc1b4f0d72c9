"""The camera of newton on our static triangles and views: the peer in :mod:`twin.bench.camera`.

Both pictures are Lambert shading under one sun with one shadow ray; newton is a bench-only package.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from twin.world.meshes.mesh import Mesh

PEER = "newton"
"""Name of the package."""
SHAPES: tuple[int, ...] = (1, 8)
"""Into how many shapes the triangles are split, along the street."""
TILES: tuple[tuple[int, int], ...] = ((16, 8), (8, 4))
BLOCKS: tuple[int, ...] = (64, 128)
"""Tile shapes [px] and thread blocks of its tiled render order; of all ways the best counts."""


def available() -> bool:
    """Whether newton is installed."""
    return importlib.util.find_spec(PEER) is not None


class NewtonCamera:
    """Renders our views with newton's ``SensorCamera``."""

    def __init__(
        self,
        mesh: Mesh,
        eyes_m: np.ndarray,
        yaws_rad: np.ndarray,
        size_px: tuple[int, int],
        hfov_deg: float,
        sun: tuple[float, float, float],
        device: str,
        shapes: int = 1,
    ) -> None:
        """``eyes_m`` [S, 3], ``yaws_rad`` [S], ``size_px`` (width, height), ``sun`` unit, to it."""
        import newton
        from newton.sensors import SensorCamera

        width, height = size_px
        self._shapes = shapes
        with wp.ScopedDevice(device):
            builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
            # Its default on a GPU is built quickly and met slowly; this one is ours as well.
            builder.default_bvh_cfg.mesh_constructor = "sah"
            for faces in _split(mesh, shapes):
                used, indices = np.unique(faces, return_inverse=True)
                part = newton.Mesh(mesh.points_m[used], indices.ravel(), compute_inertia=False)
                builder.add_shape_mesh(body=-1, mesh=part, color=(0.5, 0.5, 0.5))
            model = builder.finalize(device=device)
            self._sensor = SensorCamera(model, load_textures=False)
            down = wp.vec3(*(-c for c in sun))
            self._sensor.create_default_light(enable_shadows=True, direction=down)
            vfov = 2 * math.atan(math.tan(math.radians(hfov_deg) / 2) * height / width)
            self._rays = SensorCamera.compute_camera_rays_pinhole(
                width, height, camera_fov=vfov, device=device
            )
            self._poses = wp.array(
                [(*eye, *_turn(yaw)) for eye, yaw in zip(eyes_m, yaws_rad, strict=True)],
                dtype=wp.transformf,
                device=device,
            )
            count = len(eyes_m)
            worlds = np.zeros(count, np.int32)  # every view looks at the one world
            self._worlds = wp.array(worlds, dtype=wp.int32, device=device)
            self._image = self._sensor.allocate_image_color(count, width, height)
            self._state = model.state()

    def launches(self) -> dict[str, Callable[[], None]]:
        """One render call for each way that is tried, by name."""
        return {
            f"{self._shapes} shapes, tiles {tile[0]}x{tile[1]}, blocks of {block}": self._launch(
                tile, block
            )
            for tile in TILES
            for block in BLOCKS
        }

    def image(self) -> np.ndarray:
        """uint8 [S, H, W, 4] of the last render."""
        pixels: Any = self._image.numpy()
        return pixels.view(np.uint8).reshape(*pixels.shape, 4)

    def _launch(self, tile: tuple[int, int], block: int) -> Callable[[], None]:
        from newton.sensors import SensorCamera

        config = SensorCamera.RenderConfig(
            enable_shadows=True,
            enable_particles=False,
            render_order=SensorCamera.RenderOrder.TILED,
            tile_width=tile[0],
            tile_height=tile[1],
            block_dim=block,
        )

        def render() -> None:
            self._sensor.update(
                self._state,
                self._poses,
                self._rays,
                color_image=self._image,
                world_indices=self._worlds,
                render_config=config,
            )

        return render


def _split(mesh: Mesh, parts: int) -> list[np.ndarray]:
    """The faces in ``parts`` of equal number, along the street."""
    along = mesh.points_m[mesh.faces][:, :, 0].mean(axis=1)
    return np.array_split(mesh.faces[np.argsort(along, kind="stable")], parts)


def _turn(yaw: float) -> tuple[float, float, float, float]:
    """world_from_camera xyzw of a camera (x right, y up, looking along -z) turned by ``yaw``."""
    # Columns: right = -left, up = z, back = -forward, for yaw 0: quaternion (1, -1, -1, 1) / 2.
    half = yaw / 2
    c, s = math.cos(half), math.sin(half)
    x, y, z, w = 0.5, -0.5, -0.5, 0.5
    # (0, 0, s, c) * (x, y, z, w)
    return (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
