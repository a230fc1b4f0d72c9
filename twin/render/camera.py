"""The ray-traced camera of a rig: allocates once, then renders all active slots in one launch."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from schemas.campaign import Camera
from twin.render import trace
from twin.render.geometry import Geometry
from twin.render.lamps import StreetLamps
from twin.render.light import SlotLight
from twin.render.sky import SKY_COLUMNS, SKY_ROWS
from twin.render.tone import tone_table
from twin.world.mirror import Mirror
from twin.world.scene import Furniture
from twin.world.street import World

_FAR = np.iinfo(np.int32).max


class RayCamera:
    """Pinhole camera in front of one static world.

    ``lights`` (host mirror of :class:`~twin.render.light.SlotLight` [S]) is written by the engine.
    """

    def __init__(
        self,
        geometry: Geometry,
        world: World,
        furniture: Furniture,
        camera: Camera,
        mount_m: tuple[float, float, float],
        lamps_m: tuple[float, float, float],
        image_out: np.ndarray | None = None,
    ) -> None:
        """``image_out``: uint8 [S, H, W, 3] host buffer that receives the images."""
        slots, device = geometry.slots, geometry.device
        self.shape = (slots, camera.height, camera.width, 3)
        self._geometry = geometry
        self._instances = geometry.instances
        self._lamps = _street_lamps(world, furniture)
        optics = trace.Optics()
        optics.width, optics.height = camera.width, camera.height
        optics.tangent = math.tan(math.radians(camera.hfov_deg) / 2.0)
        optics.mount = wp.vec3(*mount_m)
        optics.lamps = wp.vec3(*lamps_m)
        self._optics = optics
        self._table = wp.array(tone_table(), dtype=wp.uint8, device=device)
        self.lights = Mirror((slots,), SlotLight, device)
        self.sky_table = Mirror((slots, SKY_ROWS, SKY_COLUMNS), wp.vec3, device)
        self._poses = wp.zeros(slots, dtype=trace.SlotPose, device=device)
        empty = np.full((slots, max(1, self._instances), trace.BOX_FIELDS), 0, np.int32)
        empty[:, :, [0, 1, 5]] = _FAR
        empty[:, :, [2, 3]] = -1
        self._empty = wp.array(empty, dtype=wp.int32, device=device)
        self.boxes = wp.zeros_like(self._empty)
        self._device = device
        self._allocate_image(image_out)
        wp.load_module(trace, device=device)

    def _allocate_image(self, image_out: np.ndarray | None) -> None:
        if image_out is not None and (
            image_out.shape != self.shape
            or image_out.dtype != np.uint8
            or not image_out.flags.c_contiguous
        ):
            raise ValueError(f"image_out must be a contiguous uint8 array of shape {self.shape}")
        self.image = np.zeros(self.shape, np.uint8) if image_out is None else image_out
        if self._device.is_cpu:
            self._image = wp.array(
                ptr=self.image.ctypes.data, shape=self.shape, dtype=wp.uint8, device=self._device
            )
        else:
            self._image = wp.zeros(self.shape, dtype=wp.uint8, device=self._device)

    def clear(self, slot: int) -> None:
        """Blank the image of a slot."""
        self.image[slot] = 0
        if not self._device.is_cpu:
            self._image[slot].zero_()

    def render(self, pose: wp.array) -> np.ndarray:
        """Render all active slots from ego poses [S, 3]; returns the host image [S, H, W, 3]."""
        self.launch(pose)
        if not self._device.is_cpu:
            self.image[...] = self._image.numpy()
        return self.image

    def rays_per_frame(self) -> float:
        """Primary rays of a picture."""
        return float(self.shape[1] * self.shape[2])

    def launch(self, pose: wp.array) -> None:
        """Render as :meth:`render` does, and leave the images on the device."""
        slots, height, width, _ = self.shape
        self.lights.push()
        wp.copy(self.boxes, self._empty)
        wp.launch(
            trace.place_kernel, slots, inputs=[pose], outputs=[self._poses], device=self._device
        )
        tiles = -(-width // trace.TILE_COLUMNS) * -(-height // trace.TILE_ROWS)
        wp.launch(
            trace.camera_kernel,
            slots * tiles * trace.TILE_COLUMNS * trace.TILE_ROWS,
            inputs=[
                self._geometry.scene,
                self._lamps,
                self._optics,
                self._table,
                self.lights.device,
                self.sky_table.device,
                self._poses,
            ],
            outputs=[self._image, self.boxes],
            device=self._device,
        )


def _street_lamps(world: World, furniture: Furniture) -> StreetLamps:
    lamps = StreetLamps()
    lamps.spacing = furniture.lamp_spacing_m
    lamps.height = furniture.lamp_height_m
    lamps.intensity = furniture.lamp_intensity_cd
    lamps.right = wp.vec2(*world.lamps_right)
    lamps.left = wp.vec2(*world.lamps_left)
    return lamps
