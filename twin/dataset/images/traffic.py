"""Who stands and moves where in an image: parked cars, traffic, people; nobody in anybody."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twin.actors import car_body, heavy_body
from twin.actors.cyclist import LENGTH_M, WIDTH_M
from twin.actors.person import PHASES
from twin.dataset.chance import between, far_and_near, scattered
from twin.dataset.images.cast import Look
from twin.world.scene import Scene
from twin.world.street.ground import PLACE_M
from twin.world.street.layout import Layout

PLACES = {"car": 18, "truck": 4, "bus": 3, "pedestrian": 8, "bicycle": 3}
"""Most objects of each class in one image, beside the broken-down car."""
PARKED_AHEAD_M = 90.0
"""Cars are parked from 10 m behind the ego to here before it [m]."""
DARK_SHARE, STANDING_DARK_SHARE = 0.06, 0.4
"""Share of the vehicles in traffic without lamps, of those that move and those that stand [-]."""

_CLASS = {"van": "car", "cyclist": "bicycle"}
_PERSON_HALF_M = 0.3
_SIDEWALK_CLEAR_M = 0.5
_TRIES = 8


class Heading(Protocol):
    """Direction in which the ego looks."""

    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Placed:
    """A member of the cast in an image."""

    look: int
    """Number in the street's cast."""
    class_name: str
    x_m: float
    """Middle of its hull, world."""
    y_m: float
    z_m: float
    yaw_rad: float
    speed_mps: float
    phase: int
    """Phase of its walk, from 0 on; -1: it stands."""
    brake: float
    lamps: float


class Room:
    """A street with what is taken of it: upright rectangles, in world axes."""

    def __init__(self, layout: Layout, scene: Scene) -> None:
        self.layout = layout
        self.scene = scene
        self._taken: list[tuple[float, float, float, float]] = []

    def take(
        self, x: float, y: float, yaw: float, half_length: float, half_width: float, gap_m: float
    ) -> bool:
        """Take a rectangle with ``gap_m`` around it, unless it is taken."""
        c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
        a = c * half_length + s * half_width + gap_m
        b = s * half_length + c * half_width + min(gap_m, 0.1)
        for x0, y0, x1, y1 in self._taken:
            if x - a < x1 and x + a > x0 and y - b < y1 and y + b > y0:
                return False
        self._taken.append((x - a, y - b, x + a, y + b))
        return True

    def inside(self, x: float) -> bool:
        """Whether ``x`` lies on the street."""
        return self.scene.road.start_m + 3.0 < x < self.scene.road.end_m - 3.0


def half_extent_m(look: Look) -> tuple[float, float]:
    """Half length and half width of its hull [m]."""
    if look.kind == "pedestrian":
        return _PERSON_HALF_M, _PERSON_HALF_M
    if look.kind == "cyclist":
        return LENGTH_M / 2, WIDTH_M / 2
    if look.kind in ("truck", "bus"):
        length, width = (heavy_body.TRUCK_M if look.kind == "truck" else heavy_body.BUS_M)[:2]
        return length / 2, width / 2
    shape = car_body.SHAPES[look.body]
    return shape.length_m / 2, shape.width_m / 2


class _Crowd:
    """Places what fits, and counts."""

    def __init__(self, rng: np.random.Generator, room: Room, cast: tuple[Look, ...]) -> None:
        self.rng, self.room, self.cast = rng, room, cast
        self.placed: list[Placed] = []
        self._left = dict(PLACES)
        self._of: dict[str, list[int]] = {}
        for number, look in enumerate(cast):
            self._of.setdefault(_CLASS.get(look.kind, look.kind), []).append(number)

    def choose(self, class_name: str) -> int:
        numbers = self._of[class_name]
        return numbers[int(self.rng.integers(len(numbers)))]

    def add(
        self,
        class_name: str,
        look: int,
        place: tuple[float, float, float, float],
        *,
        speed_mps: float = 0.0,
        brake: float = 0.0,
        lamps: float = 0.0,
        gap_m: float = 0.5,
    ) -> bool:
        """Put it at x, y, z [m] and yaw [rad] unless there is none left or no room."""
        x, y, z, yaw = place
        if not self._left[class_name] or not self.room.inside(x):
            return False
        if not self.room.take(x, y, yaw, *half_extent_m(self.cast[look]), gap_m):
            return False
        self._left[class_name] -= 1
        phase = int(self.rng.integers(PHASES)) if speed_mps > 0.0 else -1
        numbers = (round(v, 4) for v in (x, y, z, yaw, speed_mps))
        self.placed.append(Placed(look, class_name, *numbers, phase, brake, lamps))
        return True


def populate(
    rng: np.random.Generator, room: Room, cast: tuple[Look, ...], ego_x_m: float, heading: Heading
) -> list[Placed]:
    """Everybody in one image; ``room`` holds the ego and the broken-down car already."""
    crowd = _Crowd(rng, room, cast)
    ahead = 1.0 if math.cos(heading.yaw_rad) > 0.0 else -1.0
    _traffic(crowd, ego_x_m, ahead)
    _crossing(crowd, ego_x_m, ahead)
    _parked(crowd, ego_x_m, ahead)
    _cyclists(crowd, ego_x_m, ahead)
    _people(crowd, ego_x_m, ahead)
    return crowd.placed


def _vehicle(crowd: _Crowd) -> tuple[str, int]:
    dice = crowd.rng.random()
    name = "car" if dice < 0.68 else ("truck" if dice < 0.88 else "bus")
    return name, crowd.choose(name)


def _traffic(crowd: _Crowd, ego_x_m: float, ahead: float) -> None:
    """Vehicles in both lanes, near ones and far ones alike."""
    rng, lane = crowd.rng, crowd.room.scene.road.lane_width_m
    for _ in range(int(rng.integers(5))):
        name, look = _vehicle(crowd)
        own = rng.random() < 0.45
        x = ego_x_m + ahead * (4.0 + far_and_near(rng, 6.0, 110.0))
        forward = own == (ahead > 0.0)  # the lane at y = 0 runs to +x
        y = (0.0 if forward else lane) + scattered(rng, 0.2, 0.5)
        yaw = (0.0 if forward else math.pi) + math.radians(scattered(rng, 2.0, 8.0))
        brake = float(rng.random() < 0.35)
        speed = 0.0 if rng.random() < 0.2 else between(rng, 2.0, 14.0)
        lit = float(rng.random() > (DARK_SHARE if speed else STANDING_DARK_SHARE))
        place = (x, y, 0.0, yaw)
        crowd.add(name, look, place, speed_mps=speed, brake=brake * lit, lamps=lit, gap_m=1.0)


def _crossing(crowd: _Crowd, ego_x_m: float, ahead: float) -> None:
    """A vehicle in a side street or turning, in one image of three."""
    rng, layout = crowd.rng, crowd.room.layout
    near = [x for x in layout.sides if 8.0 < ahead * (x - ego_x_m) < 110.0]
    dice, turn = rng.random(2)
    if not near or dice > 0.33:
        return
    name, look = _vehicle(crowd)
    up = 1.0 if rng.random() < 0.5 else -1.0
    x = near[0] + up * layout.half_side / 2
    y = between(rng, -24.0, 28.0)
    yaw = up * math.pi / 2 + (math.radians(between(rng, -40.0, 40.0)) if turn < 0.3 else 0.0)
    crowd.add(name, look, (x, y, 0.0, yaw), speed_mps=between(rng, 1.0, 8.0), lamps=1.0)


def _parked(crowd: _Crowd, ego_x_m: float, ahead: float) -> None:
    """Cars at the kerbs, nearest first; how many places are taken varies with the image."""
    rng, layout = crowd.rng, crowd.room.layout
    share = between(rng, 0.0, 0.65)
    strip = crowd.room.scene.road.parking_width_m / 2
    places = [
        (x + PLACE_M / 2, kerb, sign)
        for block in layout.blocks
        for x in np.arange(block.parking[0], block.parking[1] - PLACE_M, PLACE_M).tolist()
        for kerb, _, sign in layout.rows()
        if -10.0 < ahead * (x - ego_x_m) < PARKED_AHEAD_M
    ]
    for x, kerb, sign in sorted(places, key=lambda place: (abs(place[0] - ego_x_m), place[2])):
        taken, shift, sway, big, turned = rng.random(5)
        if taken > share:
            continue
        name = "car" if big < 0.9 else ("truck" if big < 0.96 else "bus")
        look = crowd.choose(name)
        lamps = float(name == "bus")  # it stands at its stop
        y = kerb - sign * strip + 0.16 * (sway - 0.5)
        yaw = 0.0 if (sign < 0.0) != (turned < 0.1) else math.pi
        yaw += math.radians(scattered(rng, 1.0, 3.0))
        crowd.add(name, look, (x + shift - 0.5, y, 0.0, yaw), lamps=lamps, gap_m=0.3)


def _cyclists(crowd: _Crowd, ego_x_m: float, ahead: float) -> None:
    rng, road = crowd.rng, crowd.room.scene.road
    for _ in range(int(rng.integers(4)) - 1):
        right = rng.random() < 0.6
        x = ego_x_m + ahead * (3.0 + far_and_near(rng, 4.0, 70.0))
        y = -road.lane_width_m / 2 + 0.4 if right else 1.5 * road.lane_width_m - 0.4
        yaw = (0.0 if right else math.pi) + math.radians(scattered(rng, 3.0, 10.0))
        y += scattered(rng, 0.2, 0.4)
        speed = between(rng, 2.0, 7.0)
        crowd.add("bicycle", crowd.choose("bicycle"), (x, y, 0.0, yaw), speed_mps=speed)


def _people(crowd: _Crowd, ego_x_m: float, ahead: float) -> None:
    """People on the sidewalks, and some of them crossing the road."""
    rng, layout = crowd.rng, crowd.room.layout
    kerb_m = crowd.room.scene.road.kerb_height_m
    for _ in range(int(rng.integers(PLACES["pedestrian"] + 1))):
        look = crowd.choose("pedestrian")
        on_road, left = rng.random() < 0.3, rng.random() < 0.5
        turn, going = rng.random(2)
        for _ in range(_TRIES):
            x = ego_x_m + ahead * (2.5 + far_and_near(rng, 3.0, 70.0))
            if on_road:
                y = between(rng, layout.kerb_right + 0.2, layout.kerb_left - 0.2)
                place = (x, y, 0.0, math.copysign(math.pi / 2, turn - 0.5))
            else:
                kerb, wall, sign = layout.rows()[int(left)]
                out = abs(wall - kerb) - 2 * _SIDEWALK_CLEAR_M
                y = kerb + sign * (_SIDEWALK_CLEAR_M + out * float(rng.random()))
                if not any(b.start + 3.0 < x < b.end - 3.0 for b in layout.blocks):
                    continue  # there is no sidewalk across a side street
                place = (x, y, kerb_m, math.pi * float(np.floor(2.0 * turn)) + (going < 0.2) * turn)
            speed = 0.0 if going < 0.25 else between(rng, 0.6, 1.8)
            if crowd.add("pedestrian", look, place, speed_mps=speed, gap_m=0.1):
                break
