"""Light on level ground at a place, as pictures show it: of sky, sun, moon and street lamps."""

from __future__ import annotations

import math

import numpy as np

from twin.render.light.lamps import LAMPS_LIGHTING, SODIUM
from twin.render.light.street_lamps import LAMP_CELL_M, nearest_lamps
from twin.world.scene import Furniture
from twin.world.sky.atmosphere import LUMINANCE
from twin.world.sky.sun import Daylight
from twin.world.street.build import World

_SEEN = sum(float(share) * float(weight) for share, weight in zip(SODIUM, LUMINANCE, strict=True))
"""Luminance of the colour of street lamps: pictures give each its lux in this colour."""


class GroundLight:
    """Illuminance on level ground in each slot [lx].

    Street lamps count with the formula and the lamps of pictures (:mod:`twin.render.light.lamps`),
    in float64: I h^3 / d^5 for a lamp of the intensity I, h above the place and d away. Lamps of
    vehicles are left out, those of the ego too: a protocol asks what light there is at the place of
    the test, before somebody comes along.
    """

    def __init__(self, world: World, furniture: Furniture, slots: int) -> None:
        self.open_lx = np.zeros(slots)
        """Without lamps [lx]."""
        self._lamps_on = np.zeros(slots, np.bool_)
        self._furniture = furniture
        self._rows = () if world.lamps is not None else (world.lamps_right, world.lamps_left)
        self._at_m = np.zeros((0, 2)) if world.lamps is None else world.lamps
        self._near, self._corner_m = nearest_lamps(self._at_m)

    def set(self, slot: int, light: Daylight) -> None:
        """Light of sky, sun and moon in a slot from now on."""
        self.open_lx[slot] = light.illuminance_lx
        self._lamps_on[slot] = light.lamps_on

    def at(self, slot: int, place_m: tuple[float, float], height_m: float) -> float:
        """Light on level ground in a slot [lx].

        Args:
            slot: the slot.
            place_m: world x, y.
            height_m: world z of the ground.
        """
        total = float(self.open_lx[slot])
        return total + self.lamps_lx(place_m, height_m) if self._lamps_on[slot] else total

    def lamps_lx(self, place_m: tuple[float, float], height_m: float) -> float:
        """Light of the street lamps that light a place, where they are on [lx]."""
        up_m = self._furniture.lamp_height_m - height_m
        if up_m <= 0.0:
            return 0.0
        total = 0.0
        for x_m, y_m in self._lighting(place_m):
            square = (x_m - place_m[0]) ** 2 + (y_m - place_m[1]) ** 2 + up_m * up_m
            total += up_m * up_m * up_m / (square * square * math.sqrt(square))
        return total * self._furniture.lamp_intensity_cd * _SEEN

    def _lighting(self, place_m: tuple[float, float]) -> list[tuple[float, float]]:
        """World x, y of the lamps that light a place [m]."""
        spacing_m = self._furniture.lamp_spacing_m
        if self._rows:
            return [
                (at_m + (math.floor((place_m[0] - at_m) / spacing_m) + step) * spacing_m, row_m)
                for at_m, row_m in self._rows
                for step in (0, 1)
            ]
        column, row = (
            math.floor((place_m[axis] - self._corner_m[axis]) / LAMP_CELL_M) for axis in (0, 1)
        )
        rows, columns, _ = self._near.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return []
        near = self._near[row, column, :LAMPS_LIGHTING]
        return [(float(x), float(y)) for x, y in self._at_m[near[near >= 0]]]
