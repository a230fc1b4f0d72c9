"""The ray-traced camera of a rig: allocates once, then renders all active slots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.sections.lens import CameraMount
from schemas.sections.lens_projection import vehicle_from_camera
from twin.render.boxes import BOX_FIELDS
from twin.render.build import KernelOptions, Tuning, tuning_for
from twin.render.flow import PictureBefore, projection_of
from twin.render.lens import ray_table
from twin.render.light import lamps
from twin.render.light.lamps import BEAMS_MAX, LampBeams
from twin.render.light.light import SlotLight
from twin.render.light.second_light import second_light_kernel
from twin.render.light.sky import SKY_COLUMNS, SKY_ROWS
from twin.render.light.street_lamps import street_lamps
from twin.render.look_kernel import look_kernel
from twin.render.mirror import STRIDE, mirror_kernel
from twin.render.outputs import OUTPUTS, Buffers, Wanted
from twin.render.picture import picture_kernel
from twin.render.post.chain import PostEffects, needs_depth, needs_flow
from twin.render.tone import tone_table
from twin.render.trace import raster, rays, second_hits, sun_packet, visibility
from twin.render.trace.geometry import Geometry
from twin.render.trace.raster import raster_of
from twin.render.trace.rays import Optics, SlotPose
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror
from twin.world.relaunch import Relaunch
from twin.world.scene import Furniture
from twin.world.street.build import World

_FAR = np.iinfo(np.int32).max
_POSE_COLUMNS = 3


class _Pass(NamedTuple):
    """A launch over the pixels of some slots."""

    kernel: wp.Kernel
    build: KernelOptions
    size: int
    """Threads."""
    inputs: list[Any]
    outputs: list[Any]


class RayCamera:
    """One camera of all slots, with its lens, outputs and effects.

    ``lights`` (host mirror of :class:`~twin.render.light.light.SlotLight` [S]) and ``sky_table``
    are written by the engine.
    """

    def __init__(
        self,
        geometry: Geometry,
        world: World,
        furniture: Furniture,
        camera: Camera,
        mount: CameraMount | Sequence[float],
        lamps_m: tuple[float, float, float],
        image_out: np.ndarray | None = None,
        outputs_out: Mapping[str, np.ndarray] | None = None,
        tuning: Tuning | None = None,
    ) -> None:
        """Allocate and compile.

        Args:
            geometry: what the rays meet, shared by all sensors of the rig.
            mount: place and lens on the vehicle; a bare position stands for an ideal lens.
            lamps_m: middle of the ego's headlamps, in the vehicle.
            image_out: uint8 [S, H, W, 3] host buffer that receives the images.
            outputs_out: host buffers of further outputs by name; missing ones are allocated.
            tuning: of the kernels, by default the usual one of the device.

        Raises:
            ValueError: a buffer or the lens does not fit.
        """
        if not isinstance(mount, CameraMount):
            mount = CameraMount(position_m=list(mount))
        slots, device = geometry.slots, geometry.device
        self.shape = (slots, camera.height, camera.width, 3)
        self.geometry = geometry
        """Geometry that it sees; its maker places the objects."""
        self._device = device
        self._launch = Relaunch(device)
        self._lamps = street_lamps(world, furniture, geometry.device)
        self._optics = _optics(camera, mount, lamps_m)
        table = ray_table(mount.lens, camera.width, camera.height, camera.hfov_deg)
        self._optics.pixel = _pixel_angle(table)
        self._rays = wp.array(table, dtype=wp.vec3, device=device)
        self._table = wp.array(tone_table(), dtype=wp.uint8, device=device)
        self.lights = Mirror((slots,), SlotLight, device)
        self.sky_table = Mirror((slots, SKY_ROWS, SKY_COLUMNS), wp.vec3, device)
        self.sky_stale = True
        """``sky_table`` was written on the host since the last picture."""
        self._poses = wp.zeros(slots, dtype=SlotPose, device=device)
        self._projection = projection_of(mount.lens, camera.width, camera.height, camera.hfov_deg)
        self._beams = wp.zeros((slots, BEAMS_MAX), dtype=LampBeams, device=device)
        self._chunk = min(slots, max(1, visibility.CHUNK_PIXELS // (camera.width * camera.height)))
        self._wanted = wanted_of(camera)
        objects = geometry.poses.device if self._wanted.flow else None
        self._before = PictureBefore(self._poses, objects, 1.0 / camera.hz)
        size = camera.height, camera.width
        self._seen = visibility.allocate_seen(
            self._chunk, *size, device, self._wanted.second, geometry.features
        )
        self._effects = _effects_of(camera, mount, slots, device)
        self._tuning = tuning = tuning or tuning_for(device)
        features, second = geometry.features, self._wanted.second
        self._first = self._first_kernel(mount, table, camera.hfov_deg)
        self._look = look_kernel(tuning.look, second) if features.looks else None
        self._mirror = mirror_kernel(tuning.mirror, features) if second else None
        self._hits, self._left = None, self._seen
        if second and tuning.hits is not None:
            self._hits = second_hits.allocate_hits(self._chunk, *size, device, features)
            self._left = second_hits.left_pixels(self._seen, self._hits)
        self._picture = picture_kernel(self._wanted, tuning.picture, tuning.without, features)
        self._allocate(camera, image_out, outputs_out or {})
        drawn = [] if self._raster is None else [raster.raster_kernel(features)]
        shaded = ((each.kernel, each.build.block) for each in self._passes(0, self._chunk))
        load_kernels(device, [rays, lamps, *drawn, *shaded])

    def _first_kernel(self, mount: CameraMount, table: np.ndarray, hfov_deg: float) -> wp.Kernel:
        """Rays to what is seen; where drawing is faster, only those to the sun are left."""
        build = self._tuning.visibility
        self._raster = raster_of(mount.lens, self._optics, table, hfov_deg, self._device)
        features = self.geometry.features
        if self._raster is None:
            return visibility.visibility_kernel(build, self._wanted.second, features)
        return visibility.sun_kernel(build, self._wanted.second, features)

    def _passes(self, first: int, slots: int) -> Iterator[_Pass]:
        """What goes over all pixels of ``slots`` from ``first`` on, in order: visibility, what
        materials from files say and second rays if there are any, shading."""
        scene, seen, tuning = self.geometry.scene, self._seen, self._tuning
        lights, poses, optics = self.lights.device, self._poses, self._optics
        count = visibility.threads(slots, *self.shape[1:3])
        stride = 1 if self._device.is_cpu else STRIDE
        packets = 1 if self._raster is None else sun_packet.LANES
        own = [scene, optics, self._rays, lights, poses, first]
        yield _Pass(self._first, tuning.visibility, count // packets, own, [seen])
        if self._look is not None:
            yield _Pass(self._look, tuning.look, stride, own, [seen])
        if self._mirror is not None:
            yield from self._second_passes(self._mirror, first, stride)
        shade = [scene, self._lamps, optics, self._projection, self._rays, self._table]
        state = [lights, self.sky_table.device, poses, self._before.handle, self._beams, seen]
        size = count // tuning.picture.pixels
        yield _Pass(self._picture, tuning.picture, size, [*shade, *state, first], [self._out])

    def _second_passes(self, mirror: wp.Kernel, first: int, stride: int) -> Iterator[_Pass]:
        """Second rays: traced, shaded apart by what they have met, and those left to do both."""
        seen, hits, tuning = self._seen, self._hits, self._tuning
        lights, poses, optics = self.lights.device, self._poses, self._optics
        scene, features = self.geometry.scene, self.geometry.features
        model = [scene, self._lamps, optics, self._rays]
        state = [lights, self.sky_table.device, poses, self._beams]
        if hits is not None and tuning.hits is not None:
            kernel = second_hits.hits_kernel(tuning.hits, features)
            inputs = [scene, optics, self._rays, lights, poses, seen, first]
            yield _Pass(kernel, tuning.hits, stride, inputs, [hits])
            for detailed, build in ((False, tuning.light), (True, tuning.light_detailed)):
                if build is not None and (features.looks or not detailed):
                    kernel = second_light_kernel(build, features, detailed)
                    yield _Pass(kernel, build, stride, [*model, *state, hits, first], [seen])
        yield _Pass(mirror, tuning.mirror, stride, [*model, *state, first, stride], [self._left])

    def _allocate(
        self, camera: Camera, image_out: np.ndarray | None, outputs_out: Mapping[str, np.ndarray]
    ) -> None:
        device, size = self._device, self.shape[:3]
        out = Buffers()
        empty = np.full((size[0], max(1, self.geometry.instances), BOX_FIELDS), 0, np.int32)
        empty[:, :, [0, 1, 5]] = _FAR
        empty[:, :, [2, 3]] = -1
        self._empty = wp.array(empty, dtype=wp.int32, device=device)
        self.boxes = out.boxes = wp.zeros_like(self._empty)
        self._image = _host_backed("image_out", image_out, self.shape, wp.uint8, device)
        self.image = self._image.host
        out.image = self._image.device
        if self._wanted.hdr:
            out.hdr = wp.zeros(self.shape, dtype=wp.float16, device=device)
        self._truth: dict[str, Mirror] = {}
        for name, (dtype, values) in OUTPUTS.items():
            if not getattr(self._wanted, name):
                continue
            shape = size if values == 1 else (*size, values)
            if name in camera.outputs:
                mirror = _host_backed(name, outputs_out.get(name), shape, dtype, device)
                self._truth[name] = mirror
                setattr(out, name, mirror.device)
            else:
                setattr(out, name, wp.zeros(shape, dtype=dtype, device=device))
        self._out = out

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Host arrays of the outputs that the camera declares; valid after :meth:`render`."""
        return {name: mirror.host for name, mirror in self._truth.items()}

    @property
    def pictures(self) -> dict[str, Mirror]:
        """The image, under an empty name, and the outputs that the camera declares."""
        return {"": self._image, **self._truth}

    def reset(self, slot: int) -> None:
        """A case begins in a slot: the picture before the first is not of this case."""
        self._before.reset(slot)

    def hold(self, slot: int, *, held: bool) -> None:
        """Pictures are made without a slot for a while; its last one stays the one before."""
        self._before.hold(slot, held=held)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Poses of the last picture of a slot."""
        return self._before.save(slot)

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """The last picture of a slot had these poses."""
        self._before.restore(slot, saved)

    def clear(self, slot: int) -> None:
        """Blank the image and outputs of a slot."""
        self._before.forget(slot)
        for mirror in (self._image, *self._truth.values()):
            mirror.host[slot] = 0
            if not self._device.is_cpu:
                mirror.device[slot].zero_()

    def render(self, pose: wp.array) -> np.ndarray:
        """Render all active slots; returns the host image [S, H, W, 3].

        ``pose``: vehicle states [S, T] with the columns of :mod:`twin.vehicle.state`, or x, y [m]
        and yaw [rad] of level vehicles [S, 3].
        """
        self.launch(pose)
        self._image.pull()
        for mirror in self._truth.values():
            mirror.pull()
        return self.image

    def launch(self, pose: wp.array) -> None:
        """Render as :meth:`render` does, and leave everything on the device."""
        slots = self.shape[0]
        self.lights.push()
        if self.sky_stale:
            self.sky_table.push()
            self.sky_stale = False
        wp.copy(self.boxes, self._empty)
        self._place(pose)
        scene, seen = self.geometry.scene, self._seen
        lights, poses, optics = self.lights.device, self._poses, self._optics
        self._launch(lamps.beams_kernel, slots, [scene, lights, poses], [self._beams])
        for first in range(0, slots, self._chunk):
            chunk = min(self._chunk, slots - first)
            seen.listed_count.zero_()
            seen.detailed_count.zero_()
            if self._hits is not None:
                self._hits.counts.zero_()
            if self._raster is not None:
                self._launch(
                    raster.raster_kernel(self.geometry.features),
                    chunk,
                    [scene, optics, self._raster, lights, poses, first],
                    [seen],
                )
            for each in self._passes(first, chunk):
                self._launch(each.kernel, each.size, each.inputs, each.outputs, each.build.block)
        if self._effects is not None:
            out = self._out
            self._effects.apply(
                out.hdr,
                out.depth if self._wanted.depth else None,
                out.flow if self._wanted.flow else None,
                lights,
                self._table,
                out.image,
            )
        self._before.keep()

    def _place(self, pose: wp.array) -> None:
        kernel = rays.flat_pose_kernel if pose.shape[1] == _POSE_COLUMNS else rays.pose_kernel
        wp.launch(kernel, self.shape[0], [self._optics, pose], [self._poses], device=self._device)
        self._before.begin(self.lights.host["active"] != 0)

    def second_pixels(self) -> int:
        """Pixels of the last slots that were listed for second rays in the last picture."""
        return int(self._seen.listed_count.numpy()[0])

    def second_kinds(self) -> dict[str, int]:
        """Numbers of these by what they met: ``plain`` faces or the sky, and ``detailed`` ones, if
        any face has details; ``left`` to the kernel that does both. Empty where that does all."""
        if self._hits is None:
            return {}
        left, _, plain, _, detailed, _ = self._hits.counts.numpy().tolist()
        return {"left": left, "plain": plain, "detailed": detailed}

    def rays_per_frame(self) -> float:
        """Rays to what is seen and to the sun in the last picture, the mean of the last slots."""
        slots, height, width, _ = self.shape
        last = (slots - 1) % self._chunk + 1
        count = visibility.threads(last, height, width)
        return visibility.rays_traced(self._seen, count) / last


def wanted_of(camera: Camera) -> Wanted:
    """What the shading kernel of a camera writes."""
    effects = camera.active_effects()
    return Wanted.of(
        camera.outputs,
        hdr=bool(effects),
        second=camera.reflections,
        depth=needs_depth(effects),
        flow=needs_flow(effects),
    )


def _host_backed(
    name: str,
    host: np.ndarray | None,
    shape: tuple[int, ...],
    dtype: type,
    device: wp.Device,
) -> Mirror:
    """An array whose host side is ``host``, if there is one."""
    numpy_type = np.dtype(wp.dtype_to_numpy(dtype))
    if host is not None and (
        host.shape != shape or host.dtype != numpy_type or not host.flags.c_contiguous
    ):
        raise ValueError(f"{name} must be a contiguous {numpy_type} array of shape {shape}")
    return Mirror(shape, dtype, device, host, large=True)


def _effects_of(
    camera: Camera, mount: CameraMount, slots: int, device: wp.Device
) -> PostEffects | None:
    """Effects on finished pictures; None: the camera has none."""
    effects = camera.active_effects()
    if not effects:
        return None
    size = camera.height, camera.width
    return PostEffects(
        effects, mount.lens, slots, *size, device, hfov_deg=camera.hfov_deg, hz=camera.hz
    )


def _optics(camera: Camera, mount: CameraMount, lamps_m: tuple[float, float, float]) -> Optics:
    optics = Optics()
    optics.width, optics.height = camera.width, camera.height
    optics.near, optics.far = mount.lens.near_m, mount.lens.far_m
    optics.spherical = int(mount.lens.model == "fisheye")
    optics.lamps = wp.vec3(*lamps_m)
    rays.mount(optics, mount.position_m, vehicle_from_camera(mount.rotation_deg))
    return optics


def _pixel_angle(table: np.ndarray) -> float:
    """Angle between two rays in the middle of a table [rad]."""
    row, column = table.shape[0] // 2, table.shape[1] // 2
    return float(np.linalg.norm(table[row, column] - table[row, column - 1]))
