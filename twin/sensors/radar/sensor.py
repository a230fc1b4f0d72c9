"""A radar of one profile in all slots: allocates once, then measures in a few launches."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from schemas.kinds.sensors.radar import COLUMNS, DETECTIONS_MAX
from schemas.steady import steady
from twin.render.trace.geometry import Geometry
from twin.sensors.radar import detect, ghosts, peaks, spectrum
from twin.sensors.radar import scatter as radar_scatter
from twin.sensors.radar.bodies import TEMPLATE_ROWS, Reflector, Scatterer, standing, templates
from twin.sensors.radar.clutter import clutter_kernel_of, make_grid, surfaces
from twin.sensors.radar.echo import RadarEcho, RadarPose, RadarSlot, make_model
from twin.sensors.radar.profile import RadarProfile
from twin.sensors.radar.rain import attenuation_per_m, echo_per_m
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror
from twin.world.street.build import World

DROP_SPREAD_MPS = 1.5
"""Standard deviation of the radial speeds of drops: wind and turbulence (inferred) [m/s]."""


class RadarSensor:
    """One profile's radars.

    ``state`` (host mirror of :class:`~twin.sensors.radar.echo.RadarSlot` [S]) holds each slot's:
    write ``tick`` before every :meth:`measure`; :meth:`reset`, :meth:`mount` and :meth:`weather`
    write the rest.
    """

    def __init__(
        self,
        profile: RadarProfile,
        geometry: Geometry,
        reflectors: tuple[Reflector, ...] = (),
        rows_out: np.ndarray | None = None,
    ) -> None:
        """Build a radar for all slots.

        Args:
            profile: what it is built like.
            geometry: what it sees; whoever made it places the objects.
            reflectors: targets that stand in the world besides what it has.
            rows_out: float32 [S, N, 6] host buffer that receives the detections.
        """
        self.profile, self.geometry = profile, geometry
        slots, device, world = geometry.slots, geometry.device, geometry.world
        self._device = device
        self.model = make_model(profile, device)
        self.state = Mirror((slots,), RadarSlot, device)
        self.rows = Mirror(
            (slots, DETECTIONS_MAX, len(COLUMNS)), wp.float32, device, rows_out, large=True
        )
        self._templates = wp.array(templates(), dtype=Scatterer, device=device)
        still = standing(world, reflectors)
        self._standing = wp.array(still, dtype=Scatterer, device=device)
        objects = geometry.scene.objects.shape[1]
        self._bodies = len(still) + objects * TEMPLATE_ROWS
        self._reflectors = len(reflectors)
        self._mirrored = self._reflectors + objects * TEMPLATE_ROWS
        self._ghosts = self._mirrored * ghosts.SIDES * ghosts.ECHOES
        self._parked, self._grid = world.cars, make_grid(profile, world.cars)
        self._rays = profile.rays[0] * profile.rays[1]
        self._surface = wp.array(surfaces(), dtype=wp.vec4d, device=device)
        self._solid_angle = two_way_solid_angle(profile)
        cells = (slots, profile.chirps, profile.samples)

        def empty(shape: tuple[int, ...], dtype: type) -> wp.array:
            return wp.zeros(shape, dtype=dtype, device=device)

        self._poses = empty((slots,), RadarPose)
        self._walls = empty((slots, ghosts.SIDES), ghosts.RadarWall)
        self.echoes = empty((slots, self._bodies + self._ghosts + self._rays), RadarEcho)
        flat = math.prod(cells)
        self.touched = empty((flat,), wp.uint8)
        """1 where echoes were added [S x speeds x ranges]."""
        self.signals = empty((flat, profile.antennas), wp.vec2)
        """Signals of the antennas, there [S x speeds x ranges, antennas]."""
        groups = -(-profile.samples // spectrum.GROUP)
        self._group_count = empty((slots, groups), wp.int32)
        self._group_first = empty((slots, groups), wp.int32)
        self._members = empty((slots, 2 * self.echoes.shape[1]), wp.int32)
        self.power = empty(cells, wp.float32)
        """Range-Doppler map: mean power of the antennas over thermal noise."""
        self.alarm = empty(cells, wp.uint8)
        self._near = empty((slots, profile.samples), wp.float64)
        self._by_speed = empty((slots, profile.chirps), wp.float64)
        self._count_by_row = empty((slots, profile.samples), wp.int32)
        self._peaks = empty((slots, peaks.PEAKS_MAX), wp.int32)
        self.peaks_total = empty((slots,), wp.int32)
        candidates = (slots, peaks.PEAKS_MAX * detect.PER_PEAK)
        self.found = empty(candidates, detect.RadarDetection)
        self._kept = empty(candidates, wp.int32)
        self.count = empty((slots,), wp.int32)
        self.scatter = radar_scatter.scatter_kernel_of(geometry.features)
        self.clutter = clutter_kernel_of(geometry.features)
        self._wall = ghosts.wall_kernel_of(geometry.features)
        self._ghost = ghosts.ghost_kernel_of(geometry.features)
        self.unique = (self.scatter, self.clutter, self._wall, self._ghost)
        """Kernels with modules of their own."""
        self._compile()

    def _compile(self) -> None:
        """Compile on first use, the modules side by side."""
        self.launch: Callable[..., None] = self._launch
        """Launches a kernel with its threads, inputs and outputs; a bench puts a clock around."""
        load_kernels(self._device, [radar_scatter, spectrum, peaks, detect, *self.unique])

    def reset(self, slot: int, key: int, *, noise: bool = True) -> None:
        """A case begins in ``slot``, its random stream is ``key``; :meth:`mount` follows."""
        row = self.state.host[slot]
        row["active"], row["key"], row["tick"] = 1, key, 0
        row["noise"], row["multipath"], row["clutter"] = int(noise), 1, 1
        self.weather(slot)

    def mount(self, slot: int, position_m: tuple[float, float, float], yaw_deg: float) -> None:
        """Where it sits in vehicle axes, and where it looks."""
        row = self.state.host[slot]
        row["position"] = position_m
        yaw = math.radians(yaw_deg)
        row["yaw"] = steady([math.cos(yaw), math.sin(yaw)], 40)

    def weather(
        self,
        slot: int,
        rain_mm_per_h: float = 0.0,
        snow_mm_per_h: float = 0.0,
        wetness: float = 0.0,
    ) -> None:
        """Rain, snow and wet surfaces of ``slot`` from now on."""
        row = self.state.host[slot]
        carrier = self.profile.carrier_hz
        row["attenuation"] = steady(attenuation_per_m(carrier, rain_mm_per_h, snow_mm_per_h), 40)
        row["rain_echo"] = steady(echo_per_m(rain_mm_per_h, snow_mm_per_h), 40)
        row["wetness"] = wetness

    def clear(self, slot: int) -> None:
        """No case in ``slot``: its rows and count become zeros at the next measurement."""
        self.state.host[slot]["active"] = 0

    def measure(self, vehicles: wp.array) -> None:
        """Begin a measurement of every active slot.

        ``vehicles``: states [S, T] with the columns of :mod:`twin.vehicle.state`, on the device.
        """
        self.state.push()
        self.listen(vehicles)
        self.look()
        self._tell()

    @property
    def cells(self) -> list[wp.array]:
        """What the last measurement left of every cell: slots, rain by range and by speed, where
        echoes are, signals there, powers."""
        seen = [self._near, self._by_speed, self.touched, self.signals, self.power]
        return [self.state.device, *seen]

    def _launch(self, kernel: wp.Kernel, dim: Any, inputs: list, outputs: list) -> None:
        wp.launch(kernel, dim, inputs=inputs, outputs=outputs, device=self._device)

    def listen(self, vehicles: wp.array) -> None:
        """Echoes of all scatterers, into :attr:`echoes`."""
        slots, scene, state = self.geometry.slots, self.geometry.scene, self.state.device
        launch = self.launch
        launch(radar_scatter.pose_kernel, slots, [state, vehicles], [self._poses])
        fixed = [self.model, scene]
        if self._bodies:
            bodies = [self._templates, self._standing, self.geometry.classes]
            launch(
                self.scatter,
                (slots, self._bodies),
                [*fixed, *bodies, state, self._poses],
                [self.echoes],
            )
        if self._mirrored:
            looking = [scene, self._parked, self._surface, state, self._poses]
            launch(self._wall, slots, looking, [self._walls])
            mirrored = [self._templates, self._standing, self.geometry.classes]
            launch(
                self._ghost,
                (slots, self._mirrored, ghosts.SIDES),
                [
                    *fixed,
                    *mirrored,
                    state,
                    self._poses,
                    self._walls,
                    self._reflectors,
                    self._bodies,
                ],
                [self.echoes],
            )
        launch(
            self.clutter,
            (slots, self._rays),
            [*fixed, self._grid, self._surface, state, self._poses, self._bodies + self._ghosts],
            [self.echoes],
        )

    def look(self, *, peaks_only: bool = True) -> None:
        """The range-Doppler map and its alarms, of :attr:`echoes`."""
        slots, profile, state = self.geometry.slots, self.profile, self.state.device
        model, launch = self.model, self.launch
        blocks = (slots, -(-profile.chirps // spectrum.SPEEDS), profile.samples)
        self.touched.zero_()
        listed = [state, self.echoes]
        groups = self._group_count.shape
        launch(spectrum.group_kernel, groups, listed, [self._group_count])
        members = [self._group_first, self._members]
        launch(spectrum.member_kernel, groups, [*listed, self._group_count], members)
        launch(
            spectrum.map_kernel,
            (slots, profile.samples),
            [model, *listed, self._group_count, *members, self.touched],
            [self.signals],
        )
        rain = [model, self._solid_angle, DROP_SPREAD_MPS, state, self._poses]
        launch(
            spectrum.rain_kernel,
            (slots, max(profile.chirps, profile.samples)),
            rain,
            [self._near, self._by_speed],
        )
        air = [self._near, self._by_speed]
        launch(
            spectrum.power_kernel,
            blocks,
            [model, state, *air, self.touched, self.signals],
            [self.power],
        )
        launch(
            peaks.alarm_kernel, blocks, [model, int(peaks_only), state, self.power], [self.alarm]
        )

    def _tell(self) -> None:
        """Peaks, their directions, and the strongest of them as rows."""
        slots, profile, state = self.geometry.slots, self.profile, self.state.device
        model, launch = self.model, self.launch
        by_row = (slots, profile.samples)
        launch(peaks.count_kernel, by_row, [model, state, self.alarm], [self._count_by_row])
        launch(peaks.offset_kernel, slots, [model, state, self._count_by_row], [self.peaks_total])
        launch(
            peaks.list_kernel,
            by_row,
            [model, state, self.alarm, self._count_by_row],
            [self._peaks],
        )
        total = self.peaks_total
        launch(
            detect.detect_kernel,
            (slots, peaks.PEAKS_MAX),
            [model, *self.cells, self._peaks, total],
            [self.found],
        )
        candidates = (slots, peaks.PEAKS_MAX * detect.PER_PEAK)
        launch(detect.keep_kernel, candidates, [DETECTIONS_MAX, self.found, total], [self._kept])
        self.rows.device.zero_()
        self.count.zero_()
        launch(
            detect.emit_kernel,
            candidates,
            [self.found, total, self._kept],
            [self.rows.device, self.count],
        )

    def pull(self) -> tuple[np.ndarray, np.ndarray]:
        """Host arrays: detections float32 [S, N, 6] and count int32 [S]."""
        return self.rows.pull(), self.count.numpy()


def bodies_in(world: World, objects: int) -> int:
    """Bright points and ghosts that may be in a world with so many movable objects."""
    moving = objects * TEMPLATE_ROWS
    return len(standing(world)) + moving * (1 + ghosts.SIDES * ghosts.ECHOES)


def bytes_per_slot(profile: RadarProfile, bodies: int) -> int:
    """Memory of a slot on the device besides its detections and state [bytes]."""
    cells = profile.chirps * profile.samples
    echoes = bodies + profile.rays[0] * profile.rays[1]
    echo = np.dtype(RadarEcho.numpy_dtype()).itemsize
    found = np.dtype(detect.RadarDetection.numpy_dtype()).itemsize
    groups = -(-profile.samples // spectrum.GROUP)
    by_cell = 1 + 8 * profile.antennas + 4 + 1
    by_peak = 4 + detect.PER_PEAK * (found + 4)
    by_line = 12 * profile.samples + 8 * profile.chirps + 8 * groups
    by_slot = np.dtype(RadarPose.numpy_dtype()).itemsize
    by_slot += ghosts.SIDES * np.dtype(ghosts.RadarWall.numpy_dtype()).itemsize + 8
    return cells * by_cell + echoes * (echo + 8) + peaks.PEAKS_MAX * by_peak + by_line + by_slot


def two_way_solid_angle(profile: RadarProfile) -> float:
    """Integral of the two-way gain, relative to the axis, over the half space ahead [sr]."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2001)
    sums = []
    for width, floor_db, weight in zip(
        profile.beam_deg, profile.floor_db, (1.0, np.cos(angle)), strict=True
    ):
        fall = 4.0 * math.log(2.0) / math.radians(width) ** 2
        gain = np.maximum(np.exp(-fall * angle**2), 10.0 ** (floor_db / 10.0))
        sums.append(float(np.trapezoid(gain**2 * weight, angle)))
    return float(steady(sums[0] * sums[1], 24))
