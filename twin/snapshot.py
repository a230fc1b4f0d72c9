"""A contact sheet: one picture per weather and time of day, as a PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.identity import stream_key
from schemas.messages import Lights
from twin.render.camera import RayCamera
from twin.render.geometry import Geometry
from twin.render.light import fill_light, switch_lamps
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street import build_world
from twin.world.sun import daylight
from twin.world.weather import WEATHER

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
    weathers: Sequence[str],
    times: Sequence[str],
    *,
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
        weathers: names of :data:`schemas.campaign.WEATHERS`.
        times: local solar times ``HH:MM``.
        distance_m: distance from the ego's front to the obstacle [m].
        camera: size and field of view of one picture; 480x270 by default.
        lights: lamps of the ego; those of :func:`usual_lights` by default.

    Raises:
        ValueError: unknown weather, scene, vehicle or device; one line.
        OSError: the file cannot be written.
    """
    for name in weathers:
        if name not in WEATHER:
            raise ValueError(f"weather '{name}': allowed: {', '.join(WEATHER)}")
    prepare_kernels()
    camera = camera or Camera(width=480, height=270)
    target, car = load_scene(scene), load_vehicle(vehicle)
    world = build_world(target)
    warp_device = wp.get_device(device)
    eye = RayCamera(
        Geometry(world, 1, warp_device),
        world,
        target.furniture,
        camera,
        tuple(car.camera("front_right").position_m),
        tuple(car.headlamps_m),
    )
    x_m = world.obstacle_rear_m - distance_m - car.front_offset_m
    pose = wp.array([[x_m, 0.0, 0.0]], dtype=wp.float64, device=warp_device)
    rows = []
    for time in times:
        hours, minutes = time.split(":")
        pictures = []
        for name in weathers:
            light = daylight(60 * int(hours) + int(minutes), WEATHER[name])
            row = eye.lights.host[0]
            fill_light(row, light, WEATHER[name])
            switch_lamps(row, lights or usual_lights(name, light.illuminance_lx))
            row["active"], row["hazard"], row["noise"] = 1, 1.0, int(camera.noise)
            row["key"] = stream_key(0, f"{time}-{name}", f"camera/{camera.name}")
            pictures.append(_labelled(eye.render(pose)[0], f"{time}  {name.replace('_', ' ')}"))
        rows.append(np.hstack(pictures))
    done, data = cv2.imencode(".png", cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))
    if not done:
        raise OSError(f"{path}: the picture could not be encoded")
    Path(path).write_bytes(data.tobytes())


def _labelled(image: np.ndarray, text: str) -> np.ndarray:
    """The picture below a strip with its label."""
    strip = np.full((_LABEL_PX, image.shape[1], 3), 24, np.uint8)
    white = (235, 235, 235)
    cv2.putText(strip, text, (8, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, white, 1, cv2.LINE_AA)
    return np.vstack([strip, image])
