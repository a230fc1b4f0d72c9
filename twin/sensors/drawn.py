"""Sensors whose rows are drawn as points into a picture, without a rig around them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.case import Case
from schemas.kinds.point_look import colors, places
from schemas.kinds.registry import implementation
from schemas.kinds.sensor import SensorKind, drawn_kinds, sensor_kinds
from schemas.messages import Lights
from schemas.sections.lens import CameraMount
from twin.render.trace.geometry import Geometry
from twin.sensors.ray_sensor import Moment, RayMount, RaySensor, Sight
from twin.vehicle.vehicle_file import Vehicle
from twin.world.scene import Scene
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters
from twin.world.street.build import World

_DOT_PX = 5
"""Radius of a point in a picture of :data:`_USUAL_PX` [px]."""
_USUAL_PX = 960
_NEAREST_M = 0.1


def check_drawn(names: Sequence[str]) -> None:
    """Refuse sensors whose rows cannot be drawn.

    Raises:
        ValueError: no such sensor, or it gives no points; one line.
    """
    allowed = {kind.name for kind in drawn_kinds(k.name for k in sensor_kinds().declared)}
    for name in names:
        if name not in allowed:
            raise ValueError(f"sensor '{name}': allowed: {', '.join(sorted(allowed))}")


class DrawnSensors:
    """The sensors of a case that are drawn, in one slot."""

    def __init__(
        self, case: Case, vehicle: Vehicle, scene: Scene, world: World, geometry: Geometry
    ) -> None:
        """``geometry`` has one slot; whoever made it places the objects.

        Raises:
            ValueError: an implementation cannot be imported; one line.
        """
        mount = RayMount(case, vehicle, scene, world, geometry, {})
        self._case, self._vehicle = case, vehicle
        self._sensors: list[tuple[SensorKind, RaySensor]] = [
            (kind, implementation(kind.implementation)(mount, case.rig.sensor_hz[kind.name]))
            for kind in drawn_kinds(case.rig.sensor_hz)
        ]
        for _, sensor in self._sensors:
            sensor.reset(0, case)

    def draw(
        self,
        picture: np.ndarray,
        camera: Camera,
        site: CameraMount,
        pose: wp.array,
        sky: tuple[Daylight, WeatherParameters, tuple[float, float]],
    ) -> np.ndarray:
        """A copy of ``picture``, uint8 [H, W, 3] RGB, with a dot for every row.

        Args:
            picture: what the camera sees.
            camera: its size and field of view; lenses that bend are taken as pinholes.
            site: where it sits.
            pose: the vehicle's state on the device [1, T].
            sky: light, weather and the unit vector along the wind.
        """
        drawn = picture.copy()
        zero = np.zeros(1, np.int32)
        now = Moment(zero, zero.astype(np.int64), np.ones(1, np.bool_))
        for kind, sensor in self._sensors:
            sensor.light(0, *sky)
            sensor.advance(now)
            sensor.launch(Sight(now, [Lights()], pose, None))
            data = sensor.read()[kind.name]
            assert data.count is not None
            assert kind.points is not None
            rows = data.values[0, : data.count[0]].astype(float)
            named = dict(zip(kind.columns, rows.T, strict=True))
            points = self._in_vehicle(kind, places(kind.points, named))
            tones = colors(kind.points, named)
            # The farthest first, so that near ones stand on top.
            for k in np.argsort(-np.linalg.norm(points, axis=1), kind="stable"):
                _dot(drawn, camera, site, points[k], tones[k])
        return drawn

    def _in_vehicle(self, kind: SensorKind, points: np.ndarray) -> np.ndarray:
        """Points of a sensor's axes in those of the vehicle [N, 3]."""
        position_m, rotation_deg = implementation(kind.site)(self._case, self._vehicle)
        return np.asarray(points @ _rotation(rotation_deg).T + position_m)


def _rotation(rotation_deg: Sequence[float]) -> np.ndarray:
    """[3, 3]: roll, pitch and yaw about the vehicle's axes, applied in this order."""
    turns = np.eye(3)
    for axis, angle in enumerate(rotation_deg):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        turn = np.eye(3)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        turn[j, j], turn[j, k], turn[k, j], turn[k, k] = c, -s, s, c
        turns = turn @ turns
    return turns


def _dot(
    picture: np.ndarray, camera: Camera, site: CameraMount, point: np.ndarray, tone: np.ndarray
) -> None:
    """A dot where a camera without a lens sees ``point``, in vehicle axes."""
    ahead, left, up = _rotation(site.rotation_deg).T @ (point - np.array(site.position_m))
    if ahead < _NEAREST_M:
        return
    height, width = picture.shape[:2]
    focal_px = 0.5 * width / math.tan(math.radians(camera.hfov_deg) / 2)
    x = 0.5 * width - focal_px * left / ahead
    y = 0.5 * height - focal_px * up / ahead
    if not (0.0 <= x < width and 0.0 <= y < height):
        return
    place = (round(x), round(y))
    radius = max(1, round(_DOT_PX * width / _USUAL_PX))
    cv2.circle(picture, place, radius + 1, (0, 0, 0), cv2.FILLED, cv2.LINE_AA)
    cv2.circle(picture, place, radius, [int(v) for v in tone], cv2.FILLED, cv2.LINE_AA)
