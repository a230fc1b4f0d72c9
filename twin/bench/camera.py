"""Camera frames per second, beside the camera of newton on the same triangles and views.

Work on the device alone is timed; the copy to the host is a figure of its own. Rates are the best
of several rounds: other load on the machine only ever slows a round down.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from schemas.campaign import WEATHERS, Camera
from twin.actors.motion import Placement
from twin.base.progress import steps
from twin.bench import newton_peer
from twin.bench.lambert import LambertCamera
from twin.render.build import Tuning
from twin.render.camera import RayCamera
from twin.render.light.light import advance_light, begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.trace.geometry import Geometry
from twin.snapshot import usual_lights
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from twin.world.sky.sun import daylight
from twin.world.sky.weather import WEATHER
from twin.world.street.build import World, build_world

HOURS_MIN: tuple[int, ...] = (360, 480, 600, 720, 840, 960, 1080, 1200)
"""Times of day of the views, one after another [min]."""
SUN = (0.4423, 0.5528, 0.7063)
"""Unit direction to the sun of the Lambert pictures."""
PEER_RATIO = 1.3
"""Frames per frame of the peer to reach on a GPU."""
SCENE, VEHICLE, CAMERA = "downtown", "opencav", "front_right"
HFOV_DEG = 70.0


@dataclass(frozen=True, slots=True)
class Size:
    """Number and size of the rendered pictures."""

    slots: int
    width: int
    height: int


SIZES: dict[str, Size] = {"cpu": Size(1, 320, 180), "cuda": Size(256, 640, 360)}
"""Default per kind of device."""
TARGETS: dict[tuple[str, str, Size], float] = {
    ("cpu", "fast", Size(1, 320, 180)): 110.0,
    ("cuda", "fast", Size(256, 640, 360)): 12_000.0,
    ("cuda", "full", Size(256, 640, 360)): 6_000.0,
    ("cuda", "fast", Size(32, 1920, 1080)): 1_500.0,
}
"""Frames per second to reach, by kind of device, picture and size: one core, one H200."""


@dataclass(frozen=True, slots=True)
class Rate:
    """Speed of one kind of picture."""

    picture: str
    """``lambert``, ``fast``, ``mirrors`` or ``full``."""
    frames_per_s: float
    copied_frames_per_s: float | None
    """Rate with the copy of the images to the host."""
    rays_per_frame: float | None
    """Primary and shadow rays, mean over the views."""
    target: float | None = None

    @property
    def rays_per_s(self) -> float | None:
        """Rays per second, device work only."""
        return None if self.rays_per_frame is None else self.rays_per_frame * self.frames_per_s

    @property
    def missed(self) -> bool:
        """Below the target."""
        return self.target is not None and self.frames_per_s < self.target


@dataclass(frozen=True, slots=True)
class CameraFigures:
    """Figures of the camera bench."""

    device: str
    size: Size
    faces: int
    objects: int
    rates: list[Rate]
    peer: dict[str, float] = field(default_factory=dict)
    """Frames per second of newton by way of launching; empty where it cannot run."""
    peer_reason: str = ""
    """Why it did not run."""

    @property
    def peer_ratio(self) -> float | None:
        """Our Lambert frames per frame of the peer's best way."""
        lambert = next((r.frames_per_s for r in self.rates if r.picture == "lambert"), None)
        if not self.peer or lambert is None:
            return None
        return lambert / max(self.peer.values())

    @property
    def missed(self) -> list[str]:
        """One sentence for every target that was not reached."""
        sentences = [
            f"{r.picture}: {r.frames_per_s:,.0f} frames/s, target {r.target:,.0f}"
            for r in self.rates
            if r.missed
        ]
        ratio = self.peer_ratio
        if ratio is not None and self.device != "cpu" and ratio < PEER_RATIO:
            sentences.append(f"{ratio:.2f} times {newton_peer.PEER}, target {PEER_RATIO}")
        return sentences


def measure(
    device: str, size: Size, pictures: tuple[str, ...] = (), *, peer: bool = True, rounds: int = 5
) -> CameraFigures:
    """Render ``size.slots`` views spread along the street, and the peer's if it is installed.

    Args:
        device: ``cpu`` or ``cuda:N``.
        pictures: kinds of pictures, all by default.
        peer: whether newton runs as well.
        rounds: rounds of about half a second, the best of which counts.
    """
    world = build_world(load_scene(SCENE))
    kind = device.partition(":")[0]
    rates = [_lambert(world, size, device, rounds)]
    for picture in steps("kinds of pictures", pictures or PICTURES):
        bench = CameraBench(world, size, device, picture)
        rate = bench.rate(rounds)
        target = TARGETS.get((kind, picture, size))
        rates.append(dataclasses.replace(rate, target=target))
    figures = CameraFigures(device, size, len(world.mesh.faces), world.motion.count, rates)
    if not peer:
        return dataclasses.replace(figures, peer_reason="not asked for")
    if not newton_peer.available():
        return dataclasses.replace(figures, peer_reason=f"{newton_peer.PEER} is not installed")
    try:
        return dataclasses.replace(figures, peer=_peer(world, size, device, rounds))
    except Exception as error:  # another package's failure is a line of the result
        return dataclasses.replace(figures, peer_reason=str(error).splitlines()[0])


@dataclass(frozen=True, slots=True)
class Views:
    """Where the views of the bench look from."""

    x_m: np.ndarray
    y_m: np.ndarray
    yaw_rad: np.ndarray


def views(world: World, slots: int) -> Views:
    """``slots`` poses of the ego spread along the street, a little to the side and turned."""
    last = world.obstacle_rear_m - 12.0
    step = np.arange(slots)
    along = (step + 0.5) / slots
    x_m = last - 150.0 * (1.0 - along)
    y_m = 0.6 * np.sin(2.4 * step)
    return Views(x_m, y_m, 0.12 * np.sin(1.7 * step))


def eyes(at: Views, mount_m: tuple[float, ...] | list[float]) -> np.ndarray:
    """float64 [S, 3]: where a camera at ``mount_m`` of the ego is."""
    x, y, z = mount_m
    c, s = np.cos(at.yaw_rad), np.sin(at.yaw_rad)
    return np.stack([at.x_m + c * x - s * y, at.y_m + s * x + c * y, np.full(len(c), z)], axis=1)


class CameraBench:
    """One camera of the bench: built once, rendered many times."""

    def __init__(
        self,
        world: World,
        size: Size,
        device: str,
        picture: str,
        tuning: Tuning | None = None,
    ) -> None:
        car = load_vehicle(VEHICLE)
        scene = load_scene(SCENE)
        self.device = wp.get_device(device)
        """Device that it renders on."""
        self._slots = size.slots
        geometry = Geometry(world, size.slots, self.device)
        camera = Camera(
            width=size.width,
            height=size.height,
            hfov_deg=HFOV_DEG,
            noise=picture == "full",
            effects=["all"] if picture == "full" else [],
            reflections=picture != "fast",
        )
        self.camera = RayCamera(
            geometry,
            world,
            scene.furniture,
            camera,
            car.camera(CAMERA),
            tuple(car.headlamps_m),
            tuning=tuning,
        )
        self._picture = picture
        at = views(world, size.slots)
        poses = np.stack([at.x_m, at.y_m, at.yaw_rad], axis=1)
        self._poses = wp.array(poses, dtype=wp.float64, device=self.device)
        self._geometry = geometry
        self.place(world.motion.at(np.arange(size.slots) * 0.37))
        self.light()

    def place(self, placement: Placement) -> None:
        """Put the movable objects of all views where ``placement`` says."""
        self._geometry.place(placement)

    def light(self, weather: str = "", minute_of_day: int = -1) -> None:
        """Light the views: all weathers and hours in turn, or one for all."""
        self.camera.sky_stale = True
        for slot, row in enumerate(self.camera.lights.host):
            name = weather or WEATHERS[slot % len(WEATHERS)]
            minute = 720 if self._slots == 1 else HOURS_MIN[slot // len(WEATHERS) % len(HOURS_MIN)]
            minute = minute if minute_of_day < 0 else minute_of_day
            light = daylight(minute, WEATHER[name])
            fill_light(row, light, WEATHER[name])
            fill_sky(self.camera.sky_table.host[slot], light)
            switch_lamps(row, usual_lights(name, light.illuminance_lx))
            row["active"], row["key"], row["noise"] = 1, slot + 1, int(self._picture == "full")
            begin_sky(row, slot << 20)
            advance_light(row, 0.37 * slot)

    def launch(self) -> None:
        """Render all views; the images stay on the device."""
        self.camera.launch(self._poses)

    def kernel_ms(self) -> dict[str, float]:
        """Time of every kernel in one picture of all views, by its name; on a CPU of all [ms]."""
        self.launch()
        if self.device.is_cpu:
            return {"all": round(1e3 / best_rate(self.launch, self.device, 2), 3)}
        wp.synchronize_device(self.device)
        wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
        self.launch()
        total: dict[str, float] = {}
        for result in wp.timing_end():
            name = result.name.removeprefix("forward kernel ").partition("_kernel")[0]
            total[name] = round(total.get(name, 0.0) + result.elapsed, 3)
        return total

    def second_pixels(self) -> int:
        """Pixels of the last pictures that were listed for second rays."""
        return self.camera.second_pixels()

    def render(self) -> np.ndarray:
        """Render all views; the images uint8 [S, H, W, 3]."""
        return self.camera.render(self._poses)

    def rate(self, rounds: int) -> Rate:
        """Rate of the camera, the best of ``rounds``."""
        frames = best_rate(self.launch, self.device, rounds) * self._slots
        copied = frames
        if not self.device.is_cpu:
            copied = best_rate(self.render, self.device, max(2, rounds // 2)) * self._slots
        rays = self.camera.rays_per_frame()
        return Rate(self._picture, frames, copied, rays)


PICTURES = ("fast", "mirrors", "full")
"""Sun shadows, sky, weather, textures; with second rays as well; with all effects and noise too."""


def best_rate(launch: Callable[[], object], device: wp.Device, rounds: int) -> float:
    """Launches per second, the best of ``rounds`` of about half a second."""
    launch()
    wp.synchronize_device(device)
    best = 0.0
    for _ in range(rounds):
        count, started = 0, time.perf_counter()
        while (spent := time.perf_counter() - started) < 0.4:
            for _ in range(4 if not device.is_cpu else 1):
                launch()
                count += 1
            wp.synchronize_device(device)
        best = max(best, count / spent)
    return best


def _lambert(world: World, size: Size, device: str, rounds: int) -> Rate:
    at = views(world, size.slots)
    mount = load_vehicle(VEHICLE).camera(CAMERA).position_m
    camera = LambertCamera(
        world, eyes(at, mount), at.yaw_rad, (size.width, size.height), HFOV_DEG, SUN, device
    )
    frames = best_rate(camera.launch, wp.get_device(device), rounds) * size.slots
    return Rate("lambert", frames, None, None)


def _peer(world: World, size: Size, device: str, rounds: int) -> dict[str, float]:
    at = views(world, size.slots)
    mount = load_vehicle(VEHICLE).camera(CAMERA).position_m
    warp_device = wp.get_device(device)
    rates: dict[str, float] = {}
    for shapes in steps("kinds of the peer", newton_peer.SHAPES):
        peer = newton_peer.NewtonCamera(
            world.mesh,
            eyes(at, mount),
            at.yaw_rad,
            (size.width, size.height),
            HFOV_DEG,
            SUN,
            device,
            shapes,
        )
        for name, launch in peer.launches().items():
            rates[name] = best_rate(launch, warp_device, rounds) * size.slots
        if peer.image()[..., :3].std() < 1.0:
            raise ValueError(f"{newton_peer.PEER} rendered an empty picture")
    return rates


def as_json(found: CameraFigures) -> dict[str, object]:
    """The result for ``--output json``."""
    return {
        "device": found.device,
        "scene": SCENE,
        "faces": found.faces,
        "objects": found.objects,
        **dataclasses.asdict(found.size),
        "pictures": [
            {**dataclasses.asdict(rate), "rays_per_s": rate.rays_per_s} for rate in found.rates
        ],
        "newton_frames_per_s": found.peer,
        "newton_ratio": found.peer_ratio,
        "newton_did_not_run": found.peer_reason or None,
        "missed": found.missed,
    }


def lines(found: CameraFigures) -> list[str]:
    """The result for people."""
    size = found.size
    text = [
        f"{size.slots} views of {size.width}x{size.height} on {found.device}; scene {SCENE}: "
        f"{found.faces:,} static triangles, {found.objects} movable objects"
    ]
    for rate in found.rates:
        target = "" if rate.target is None else f" (target {rate.target:,.0f})"
        line = f"{rate.picture:>8}: {rate.frames_per_s:,.1f} frames/s{target}"
        if rate.rays_per_s is not None:
            line += f", {rate.rays_per_s / 1e6:,.1f} million rays/s"
        if rate.copied_frames_per_s is not None:
            line += f", {rate.copied_frames_per_s:,.1f} frames/s with the copy to the host"
        text.append(line)
    if found.peer_ratio is None:
        text.append(f"no ratio to {newton_peer.PEER}: {found.peer_reason}")
    else:
        best = max(found.peer, key=lambda name: found.peer[name])
        text.append(
            f"lambert is {found.peer_ratio:.2f} times the {found.peer[best]:,.1f} frames/s of "
            f"{newton_peer.PEER} ({best}) in the same run"
        )
    return text
