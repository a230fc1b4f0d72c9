"""A contact sheet: one picture per weather and time of day, as a PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.environment import Environment
from schemas.identity import stream_key
from schemas.messages import Lights
from schemas.names import WEATHERS, minutes
from twin.render.camera import RayCamera
from twin.render.geometry import Geometry
from twin.render.light import advance_light, fill_light, fill_sky, switch_lamps
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.environment import light_of, wind_towards
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street import build_world
from twin.world.sun import Daylight
from twin.world.weather import WeatherParameters, weather_of

HOURS = ("00:00", "05:50", "06:30", "09:00", "12:00", "16:00", "18:30", "19:10")
"""Local times of the usual sheet: night, dawn, sunrise, day, sunset and dusk of an equinox."""

_PLAIN = Environment()
_LABEL_PX = 22
_NIGHT_BELOW_LX = 1000.0


def usual_lights(weather: str, illuminance_lx: float) -> Lights:
    """Lamps that a careful driver has on, after the original's rule for night and fog."""
    fog = "fog" in weather
    if illuminance_lx < _NIGHT_BELOW_LX:
        return Lights(low=fog, high=not fog, parking=True, fog=fog)
    return Lights(parking=True, fog=fog)


def contact_sheet(
    path: str | Path,
    weathers: Sequence[str] = WEATHERS,
    times: Sequence[str] = HOURS,
    *,
    environment: Environment = _PLAIN,
    distance_m: float = 25.0,
    camera: Camera | None = None,
    scene: str = "downtown",
    vehicle: str = "opencav",
    device: str = "cpu",
    lights: Lights | None = None,
) -> None:
    """Render a sheet of ``weathers`` (columns) x ``times`` (rows) and write it to ``path``.

    Args:
        path: PNG file to write.
        weathers: presets, or custom weathers of ``environment``.
        times: local times ``HH:MM``.
        environment: family, date, sun, exposure and custom weathers.
        distance_m: distance from the ego's front to the obstacle [m].
        camera: size and field of view of one picture; 320x180 by default.
        lights: lamps of the ego; those of :func:`usual_lights` by default.

    Raises:
        ValueError: unknown weather, scene, vehicle or device; one line.
        OSError: the file cannot be written.
    """
    found = {n: weather_of(n, environment.family, environment.custom) for n in weathers}
    camera = camera or Camera(width=320, height=180)
    street = _Street(scene, vehicle, camera, distance_m, device)
    rows = []
    for time in times:
        pictures = []
        for name, weather in found.items():
            light = light_of(environment, street.place, minutes(time), weather)
            toward = wind_towards(environment, street.place)
            lamps = lights or usual_lights(name, light.illuminance_lx)
            key = stream_key(0, f"{time}-{name}", f"camera/{camera.name}")
            picture = street.picture(light, weather, toward, lamps, key)
            pictures.append(_labelled(picture, f"{time}  {name.replace('_', ' ')}"))
        rows.append(np.hstack(pictures))
    done, data = cv2.imencode(".png", cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))
    if not done:
        raise OSError(f"{path}: the picture could not be encoded")
    Path(path).write_bytes(data.tobytes())


class _Street:
    """One camera behind a windscreen, in a street."""

    def __init__(
        self, scene: str, vehicle: str, camera: Camera, distance_m: float, device: str
    ) -> None:
        prepare_kernels()
        target, car = load_scene(scene), load_vehicle(vehicle)
        world = build_world(target)
        warp_device = wp.get_device(device)
        self.place = target.origin
        self._noise = int(camera.noise)
        self._geometry = Geometry(world, 1, warp_device)
        self._geometry.place(world.motion.at(np.zeros(1)))
        self._eye = RayCamera(
            self._geometry,
            world,
            target.furniture,
            camera,
            tuple(car.camera("front_right").position_m),
            tuple(car.headlamps_m),
        )
        x_m = world.obstacle_rear_m - distance_m - car.front_offset_m
        self._pose = wp.array([[x_m, 0.0, 0.0]], dtype=wp.float64, device=warp_device)

    def picture(
        self,
        light: Daylight,
        weather: WeatherParameters,
        toward: tuple[float, float],
        lamps: Lights,
        key: int,
    ) -> np.ndarray:
        """uint8 [H, W, 3], valid until the next."""
        row = self._eye.lights.host[0]
        fill_light(row, light, weather, toward)
        fill_sky(self._eye.sky_table.host[0], light)
        self._eye.sky_table.push()
        switch_lamps(row, lamps)
        row["active"], row["hazard"], row["noise"], row["key"] = 1, 1.0, self._noise, key
        advance_light(row, 0.0)
        return self._eye.render(self._pose)[0]


def _labelled(image: np.ndarray, text: str) -> np.ndarray:
    """The picture below a strip with its label."""
    strip = np.full((_LABEL_PX, image.shape[1], 3), 24, np.uint8)
    white = (235, 235, 235)
    cv2.putText(strip, text, (8, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, white, 1, cv2.LINE_AA)
    return np.vstack([strip, image])
