"""The 3D LiDAR of a rig: allocates once, then sweeps all active slots in a few launches."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from schemas.sections.lidar import (
    POINT_COLUMNS,
    RETURN_KINDS,
    TRUTH_COLUMNS,
    Lidar,
    LidarMount,
    LidarProfile,
    lidar_columns,
)
from twin.render.trace.geometry import Geometry
from twin.sensors.lidar import cast as lidar_cast
from twin.sensors.lidar import packet as lidar_packet
from twin.sensors.lidar import returns as lidar_return
from twin.sensors.lidar import scatter as lidar_scatter
from twin.sensors.lidar import sweep as lidar_sweep
from twin.sensors.lidar.air import LidarAir, fog_extinction
from twin.sensors.lidar.surface import SNOW_REFLECTANCE, face_colors, face_returns, is_long_wave
from twin.sensors.truth import POSITION, ROTATION
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror, put_row, row_of

assert (POSITION, ROTATION) == (0, 3), "the sweep keeps the first seven columns of the truth"
_POSE_COLUMNS = 7

_SPECKLE_MAX = 8.0
"""Fog's strongest echo over its mean row signal, for deciding whether it can be detected."""


@dataclass(frozen=True, slots=True)
class LidarWeather:
    """What a LiDAR sees of the weather."""

    extinction_per_m: float = 0.0
    """Of fog, rain and snow together, in the near infrared; droplets, drops and flakes are larger
    than the wavelength, so that of visible light will do [1/m]."""
    rain_mm_per_h: float = 0.0
    snow_mm_per_h: float = 0.0
    """Water equivalent [mm/h]."""
    wetness: float = 0.0
    """0 dry, 1 a closed film of water [-]."""
    snow_cover: float = 0.0
    """Share of open ground under snow [-], 0..1."""


class LidarSensor:
    """One LiDAR on every slot's ego.

    ``air`` (host mirror of :class:`~twin.sensors.lidar.air.LidarAir` [S]) holds each slot's state:
    write ``tick`` before every :meth:`scan`; :meth:`reset` and :meth:`weather` write the rest.
    ``points`` float32 [S, channels x columns, K] and ``count`` int32 [S] are on the device;
    :meth:`pull` brings them to the host. Columns: :func:`schemas.sections.lidar.lidar_columns`.
    """

    def __init__(
        self,
        profile: LidarProfile,
        mount: LidarMount,
        geometry: Geometry,
        lidar: Lidar | None = None,
        points_out: np.ndarray | None = None,
        tile: tuple[int, int] = lidar_sweep.TILE,
        block: int = lidar_cast.BLOCK,
    ) -> None:
        """``points_out``: float32 [S, channels x columns, K] host buffer that receives the points;
        ``tile``: columns and channels that are cast together; ``block``: threads of a GPU's block.

        Raises:
            ValueError: ``points_out`` has another shape or type.
        """
        self.profile, self.lidar = profile, lidar or Lidar()
        self.hz = self.lidar.hz or profile.hz
        self.geometry = geometry
        """What it sees; whoever made it places the objects."""
        self._device = geometry.device
        slots, device = geometry.slots, geometry.device
        rays = profile.channels * profile.columns
        self.shape = (slots, rays, len(lidar_columns(self.lidar)))
        self.air = Mirror((slots,), LidarAir, device)
        self._beams = lidar_sweep.make_beams(profile, self.hz, device, tile)
        self._mount = wp.vec3d(*mount.position_m)
        self._mount_turn = lidar_sweep.mount_rotation(mount)
        self._detector = _detector(profile, self.lidar)
        rows = geometry.scene.faces.numpy()
        uv = geometry.scene.uv.numpy().reshape(-1, 3, 2)
        surfaces = face_returns(
            rows,
            face_colors(rows, uv, geometry.world.textures, geometry.world.texture_kinds),
            profile,
        )
        self._surfaces = wp.array(surfaces, dtype=wp.vec4, device=device)
        tables = lidar_scatter.scatter(profile)
        self._fog_peak = tables.fog[:, :, 1].max(axis=1)
        self._drops_expected = tables.drops_expected
        self._fog = wp.array(tables.fog, dtype=wp.vec2, device=device)
        self._drops = wp.array(tables.drops, dtype=wp.vec2, device=device)
        self._poses = wp.zeros((slots, profile.columns), dtype=lidar_sweep.SweepPose, device=device)
        self._before = wp.zeros((slots, _POSE_COLUMNS), dtype=wp.float64, device=device)
        objects = geometry.scene.objects.shape[1]
        self._tile, self._block = tile, block
        self._tiles_x, self._tiles_y = (
            -(-profile.columns // tile[0]),
            -(-profile.channels // tile[1]),
        )
        words = -(-objects // lidar_sweep.MASK_BITS)
        self._mask = wp.zeros((slots, self._tiles_x, words), dtype=wp.uint32, device=device)
        self._hits = wp.zeros(
            (slots, rays * profile.sub_rays), dtype=lidar_sweep.BeamHit, device=device
        )
        self.count = wp.zeros(slots, dtype=wp.int32, device=device)
        self._allocate_points(points_out)
        of = lidar_packet.packet_kernel_of if device.is_cpu else lidar_cast.cast_kernel_of
        self._caster = of(geometry.features)
        load_kernels(device, [lidar_sweep, lidar_return, (self._caster, block)])

    def _allocate_points(self, points_out: np.ndarray | None) -> None:
        if points_out is not None and (
            points_out.shape != self.shape
            or points_out.dtype != np.float32
            or not points_out.flags.c_contiguous
        ):
            raise ValueError(f"points_out must be a contiguous float32 array of shape {self.shape}")
        self.mirror = Mirror(self.shape, wp.float32, self._device, points_out, large=True)
        self.points = self.mirror.device

    def reset(self, slot: int, key: int, weather: LidarWeather | None = None) -> None:
        """A case begins in ``slot``: its random stream is ``key``; no sweep came before."""
        row = self.air.host[slot]
        row["active"], row["fresh"], row["key"], row["tick"] = 1, 1, key, 0
        row["noise"], row["motion"] = int(self.lidar.noise), int(self.lidar.motion)
        self.weather(slot, weather or LidarWeather())

    def weather(self, slot: int, weather: LidarWeather) -> None:
        """The weather of ``slot`` from now on; without the option ``weather`` it stays clear."""
        row = self.air.host[slot]
        if not self.lidar.weather:
            weather = LidarWeather()
        row["extinction"] = weather.extinction_per_m
        row["rain"], row["snow"] = weather.rain_mm_per_h, weather.snow_mm_per_h
        row["wetness"], row["snow_cover"] = weather.wetness, weather.snow_cover
        fog = fog_extinction(weather.extinction_per_m, weather.rain_mm_per_h, weather.snow_mm_per_h)
        grid = lidar_scatter.FOG_EXTINCTIONS_PER_M
        nearest = _nearest(grid, fog)
        row["fog_gain"] = lidar_scatter.fog_gain(fog)
        strongest = row["fog_gain"] * self._fog_peak[nearest] * _SPECKLE_MAX
        detectable = strongest > self._detector.threshold
        row["fog_row"] = nearest if detectable else -1
        rates = lidar_scatter.RATES_MM_PER_H
        snowing = weather.snow_mm_per_h > weather.rain_mm_per_h
        rate = max(weather.snow_mm_per_h, weather.rain_mm_per_h)
        row["drop_row"], row["drop_share"] = -1, 0.0
        if rate > 0.0:
            row["drop_row"] = _nearest(rates, rate) + (len(rates) if snowing else 0)
            # Of a Poisson number of drops in the beam, at least one.
            row["drop_share"] = -math.expm1(-self._drops_expected[row["drop_row"]])

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """What the next sweep of a slot depends on: key, and the vehicle at the last one."""
        row = self.air.host[slot]
        return {
            "key": np.array(row["key"]),
            "fresh": np.array(row["fresh"]),
            "before": row_of(self._before, slot),
        }

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with that, in a slot whose case has just begun."""
        row = self.air.host[slot]
        row["key"], row["fresh"] = saved["key"], saved["fresh"]
        put_row(self._before, slot, saved["before"])

    def clear(self, slot: int) -> None:
        """No case in ``slot``: its points and count become zeros."""
        self.air.host[slot]["active"] = 0
        self.mirror.host[slot] = 0.0
        if not self._device.is_cpu:
            self.points[slot].zero_()

    def scan(self, truth: wp.array) -> wp.array:
        """Sweep every active slot; the sweep ends now and began one period ago.

        Args:
            truth: float64 [S, T], rows of :data:`twin.sensors.truth.TRUTH`, on the device.

        Returns:
            ``points`` on the device.
        """
        slots, device = self.shape[0], self._device
        self.air.push()
        air, scene = self.air.device, self.geometry.scene
        wp.launch(
            lidar_sweep.sweep_kernel,
            (slots, self.profile.columns),
            inputs=[self._beams, self._mount, self._mount_turn, air, truth, self._before],
            outputs=[self._poses],
            device=device,
        )
        if self._mask.size:
            wp.launch(
                lidar_sweep.mask_kernel,
                self._mask.shape,
                inputs=[self._beams, scene, air, self._poses],
                outputs=[self._mask],
                device=device,
            )
        self._cast()
        self.count.zero_()
        rows = device.is_cpu
        wp.launch(
            lidar_return.row_kernel if rows else lidar_return.return_kernel,
            (slots, self.profile.channels if rows else self.shape[1]),
            inputs=[
                *(scene, self._beams, self._detector, self._surfaces, self._fog, self._drops),
                *(air, self._poses, self._hits),
            ],
            outputs=[self.points, self.count],
            device=device,
        )
        wp.launch(
            lidar_sweep.remember_kernel,
            slots,
            inputs=[air, truth],
            outputs=[self._before],
            device=device,
        )
        self.air.host["fresh"] *= self.air.host["active"] == 0
        return self.points

    def _cast(self) -> None:
        """Fill the table of hits: packets on the CPU, a thread per ray on a GPU."""
        cpu = self._device.is_cpu
        threads = math.prod(self._tile) // (math.prod(lidar_packet.PACKET) if cpu else 1)
        tiles = self._tiles_x * self._tiles_y * self.profile.sub_rays
        wp.launch(
            self._caster,
            self.shape[0] * tiles * threads,
            inputs=[
                *(self.geometry.scene, self._beams, self.air.device, self._poses, self._mask),
            ],
            outputs=[self._hits],
            device=self._device,
            block_dim=self._block,
        )

    def pull(self) -> tuple[np.ndarray, np.ndarray]:
        """Host arrays: points float32 [S, channels x columns, K] and count int32 [S]."""
        return self.mirror.pull(), self.count.numpy()

    @property
    def device_bytes(self) -> int:
        """Memory it takes on the device [bytes]."""
        arrays = (self.points, self._hits, self._poses, self._mask, self._surfaces, self._before)
        return sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in arrays)


def point_table(points: np.ndarray, profile: LidarProfile) -> np.ndarray:
    """One slot's returns as a structured array, without the rays that came back empty.

    Args:
        points: float32 [channels x columns, K] of one slot.
        profile: of the sensor.

    Returns:
        Fields x_m, y_m, z_m, range_m, intensity, time_s (float32), kind (uint8), channel and
        column (uint16); with truth also instance (int32) and semantic (int16).
    """
    narrow = {"kind": np.uint8, "instance": np.int32, "semantic": np.int16}
    names = POINT_COLUMNS + (TRUTH_COLUMNS if points.shape[1] > len(POINT_COLUMNS) else ())
    fields = [(name, narrow.get(name, np.float32)) for name in names]
    there = np.flatnonzero(points[:, POINT_COLUMNS.index("kind")] > RETURN_KINDS.index("none"))
    table = np.zeros(len(there), [*fields, ("channel", np.uint16), ("column", np.uint16)])
    for i, name in enumerate(names):
        table[name] = points[there, i]
    table["channel"], table["column"] = np.divmod(there, profile.columns)
    return table


def _nearest(grid: np.ndarray, value: float) -> int:
    """Row of a logarithmic grid."""
    if value <= 0.0:
        return 0
    return int(np.abs(np.log(grid) - math.log(value)).argmin())


def _detector(profile: LidarProfile, lidar: Lidar) -> lidar_return.Receiver:
    detector = lidar_return.Receiver()
    detector.threshold = lidar_scatter.threshold(profile)
    detector.sigma = detector.threshold / profile.threshold_to_noise
    detector.focus = profile.focus_m
    detector.noise, detector.step = profile.noise_m, profile.step_m
    detector.pulse, detector.dropout = profile.pulse_m, profile.dropout
    detector.by_signal = float(profile.returns == "strongest")
    detector.by_range = {"strongest": 0.0, "first": -1.0, "last": 1.0}[profile.returns]
    detector.weakens = int(profile.extinction == "signal")
    detector.retro_scale = 155.0 / math.log(profile.retro_max)
    detector.snow = SNOW_REFLECTANCE[is_long_wave(profile)]
    detector.deskew = int(lidar.deskew)
    return detector
