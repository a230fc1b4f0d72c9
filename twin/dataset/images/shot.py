"""Everything that is left to chance in one image: a function of the seed and the image's number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.messages import Lights
from schemas.names import WEATHERS
from schemas.sections.environment import Conditions
from twin.actors.car_body import LENGTH_M, WIDTH_M
from twin.dataset.chance import between, far_and_near, generator, pick, scattered
from twin.dataset.images.cameras import choose_eye
from twin.dataset.images.cast import Street
from twin.dataset.images.pose import VehiclePose
from twin.dataset.images.traffic import Placed, Room, populate
from twin.dataset.recipe import DatasetRecipe
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.weather import PRESETS
from twin.world.street.layout import lay_out

CUSTOM_SHARE = 0.3
"""Share of the images in a weather that is no preset [-]."""
BACKWARDS_SHARE = 0.2
"""Share of the images that look against +x, from the other lane [-]."""
OBSTACLE_SHARE = 0.45
"""Share of the others in which the broken-down car stands ahead, 3 to 120 m away [-]."""
STRAY_SHARE = 0.2
"""Share in which the ego is far off its line: up to 1.5 m and 20 degrees [-]."""

_NIGHT_BELOW_LX = 1000.0
_THICK_FOG = 0.4
_TRIES = 50


@dataclass(frozen=True, slots=True)
class Shot:
    """One image before it is taken."""

    split: str
    index: int
    """Index in its split."""
    street: int
    eye: int
    date: str
    minute: int
    """Local time, after midnight [min]."""
    weather: str
    """A preset, or ``custom``."""
    conditions: Conditions
    pose: VehiclePose
    speed_mps: float
    placed: tuple[Placed, ...]
    time_s: float
    """Moves clouds and drops [s]."""
    hazard: float
    """Hazard lamps are lit, 0 or 1."""
    high_beam: bool
    """Whether high beam is wanted, if it is dark and there is no fog."""

    @property
    def name(self) -> str:
        """Name as in ``train/17``."""
        return f"{self.split}/{self.index}"

    def lights(self, illuminance_lx: float) -> Lights:
        """Lamps that a careful driver has on."""
        fog = self.conditions.fog >= _THICK_FOG
        if illuminance_lx >= _NIGHT_BELOW_LX:
            return Lights(parking=True, fog=fog)
        high = self.high_beam and not fog
        return Lights(low=not high, high=high, parking=True, fog=fog)


def where(recipe: DatasetRecipe, split: str, index: int) -> tuple[int, int]:
    """Street and camera of an image."""
    rng = generator(recipe.seed, f"{split}/{index}", "where")
    return int(rng.integers(getattr(recipe.streets, split))), choose_eye(recipe, rng)


def plan_shot(
    recipe: DatasetRecipe, vehicle: Vehicle, streets: list[Street], split: str, index: int
) -> Shot:
    """The image ``index`` of ``split``, whose streets are given."""
    name = f"{split}/{index}"
    number, eye = where(recipe, split, index)
    rng = generator(recipe.seed, name, "shot")
    day = int(rng.integers(28)) + 1
    date = f"2025-{int(rng.integers(12)) + 1:02d}-{day:02d}"
    minute = 5 * int(rng.integers(288))
    weather, conditions = _weather(rng)
    street = streets[number]
    room = Room(lay_out(street.scene), street.scene)
    pose = _ego(rng, street, vehicle)
    half = (vehicle.length_m / 2, vehicle.width_m / 2)
    _occupy_ego_and_obstacle(room, street, vehicle, pose, half)
    placed = populate(generator(recipe.seed, name, "traffic"), room, street.cast, pose.x_m, pose)
    return Shot(
        split=split,
        index=index,
        street=number,
        eye=eye,
        date=date,
        minute=minute,
        weather=weather,
        conditions=conditions,
        pose=pose,
        speed_mps=round(between(rng, 0.0, 14.0), 2),
        placed=tuple(placed),
        time_s=round(between(rng, 0.0, 60.0), 3),
        hazard=float(rng.random() < 0.5),
        high_beam=bool(rng.random() < 0.4),
    )


def _weather(rng: np.random.Generator) -> tuple[str, Conditions]:
    preset, own = WEATHERS[int(rng.integers(len(WEATHERS)))], rng.random()
    cloud, fog, rain, snow, wind = np.round(rng.random(5), 2).tolist()
    which = pick(rng, {"sky": 0.3, "fog": 0.25, "rain": 0.25, "snow": 0.1, "all": 0.1})
    if own >= CUSTOM_SHARE:
        return preset, PRESETS[preset]
    falls = which in ("rain", "snow", "all")
    return "custom", Conditions(
        cloud=max(cloud, 0.6) if falls else cloud,
        fog=fog if which in ("fog", "all") else 0.0,
        rain=rain if which in ("rain", "all") else 0.0,
        snow=snow if which in ("snow", "all") else 0.0,
        wind=wind,
    )


def _ego(rng: np.random.Generator, street: Street, vehicle: Vehicle) -> VehiclePose:
    road, obstacle = street.scene.road, street.scene.obstacle
    front = vehicle.front_offset_m
    backwards, before = rng.random() < BACKWARDS_SHARE, rng.random() < OBSTACLE_SHARE
    stray = rng.random() < STRAY_SHARE
    side = between(rng, -1.5, 1.5) if stray else scattered(rng, 0.25, 0.7)
    turn = between(rng, -20.0, 20.0) if stray else scattered(rng, 2.0, 6.0)
    low, high = road.start_m + 8.0, road.end_m - 30.0
    x = obstacle.x_m - front - far_and_near(rng, 3.0, 120.0)
    if backwards:
        x = between(rng, low + 30.0, road.end_m - 8.0)
    elif not before or x < low:
        for _ in range(_TRIES):
            x = between(rng, low, high)
            behind = x - vehicle.rear_overhang_m > obstacle.x_m + LENGTH_M + 1.0
            if behind or x + front + 1.0 < obstacle.x_m:
                break
    yaw = math.radians(turn) + (math.pi if backwards else 0.0)
    return VehiclePose(
        x_m=round(x, 3),
        y_m=round(side + (road.lane_width_m if backwards else 0.0), 3),
        yaw_rad=round(yaw, 5),
        z_m=round(between(rng, -0.15, 0.35), 3),
        pitch_rad=round(math.radians(scattered(rng, 1.2, 4.0)), 5),
        roll_rad=round(math.radians(scattered(rng, 0.6, 2.0)), 5),
    )


def _occupy_ego_and_obstacle(
    room: Room, street: Street, vehicle: Vehicle, pose: VehiclePose, half: tuple[float, float]
) -> None:
    middle = half[0] - vehicle.rear_overhang_m
    x = pose.x_m + math.cos(pose.yaw_rad) * middle
    y = pose.y_m + math.sin(pose.yaw_rad) * middle
    room.take(x, y, pose.yaw_rad, *half, gap_m=0.4)
    obstacle = street.scene.obstacle
    at = obstacle.x_m + LENGTH_M / 2
    room.take(at, obstacle.y_m, 0.0, LENGTH_M / 2, WIDTH_M / 2, gap_m=0.4)
