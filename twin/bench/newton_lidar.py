"""Newton's ray caster on our triangles with a LiDAR's rays: the peer of ``twin bench lidar``.

Newton has no LiDAR, but its camera takes any bundle of rays and writes their lengths alone. It is
given one mesh of all triangles, and each of its render orders; the fastest counts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from twin.world.meshes.mesh import Mesh

PEER = "newton"
MISS = -1.0
"""Length of a ray that meets nothing [m]."""


class NewtonLidar:
    """Lengths of the same rays from the same eyes."""

    def __init__(
        self, mesh: Mesh, rays: np.ndarray, eyes_m: np.ndarray, range_max_m: float, device: str
    ) -> None:
        """``rays``: unit directions [channels, columns, 3]; ``eyes_m``: [S, 3]."""
        import newton
        from newton.sensors import SensorCamera

        builder = newton.ModelBuilder()
        shape = newton.Mesh(mesh.points_m, mesh.faces.ravel(), compute_inertia=False)
        builder.add_shape_mesh(body=-1, mesh=shape)
        self._model = builder.finalize(device=device)
        self._state = self._model.state()
        self._camera = SensorCamera(self._model, load_textures=False)
        bundle = np.zeros((*rays.shape[:2], 1, 2, 3), np.float32)
        bundle[..., 0, 1, :] = rays
        self._rays = wp.array(bundle, dtype=wp.vec3, device=device)
        poses = np.zeros((len(eyes_m), 7), np.float32)
        poses[:, :3], poses[:, 6] = eyes_m, 1.0
        self._poses = wp.array(poses, dtype=wp.transformf, device=device)
        self._worlds = wp.zeros(len(eyes_m), dtype=wp.int32, device=device)
        self._ranges = wp.zeros((len(eyes_m), *rays.shape[:2]), dtype=wp.float32, device=device)
        self._clear = SensorCamera.ClearData(clear_depth=MISS)
        self._far = range_max_m

    def orders(self) -> dict[str, Callable[[], None]]:
        """Launches by name: every render order, and tiles of a warp's shape."""
        from newton.sensors import SensorCamera

        order = SensorCamera.RenderOrder
        configs = {
            "pixel priority": {"render_order": order.PIXEL_PRIORITY},
            "view priority": {"render_order": order.VIEW_PRIORITY},
            "tiles 16x8": {"render_order": order.TILED},
            "tiles 8x4": {"render_order": order.TILED, "tile_width": 8, "tile_height": 4},
        }
        return {name: self._launch(**options) for name, options in configs.items()}

    def _launch(self, **options: object) -> Callable[[], None]:
        from newton.sensors import SensorCamera

        config = SensorCamera.RenderConfig(
            max_distance=self._far, enable_particles=False, enable_backface_culling=False, **options
        )

        def launch() -> None:
            self._camera.update(
                self._state,
                self._poses,
                self._rays,
                depth_image=self._ranges,
                world_indices=self._worlds,
                clear_data=self._clear,
                render_config=config,
            )

        return launch

    def ranges(self) -> np.ndarray:
        """Lengths [S, channels, columns], :data:`MISS` where a ray meets nothing [m]."""
        return self._ranges.numpy()
