"""Where the car is going: along the arc of its present turn, or along it and then straight on.

The arc alone is wrong while a car turns back: at the end of a lane change or of a corner it bends
across what stands beside the new lane. So there may be a second path, which leaves the arc along
its tangent after :attr:`CarPath.turns_on_m`, and what is in the way lies on both. It is wrong, too,
while a car turns in: where a curve begins what is parked beside it lies straight ahead. So there
may be a third one, whose curvature goes on to grow as it does now.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAR_M = 1e6
"""Distance from the path of what lies beyond a quarter of a turn [m]."""
BEND_MIN_PER_M = 1e-9
"""A path that bends less is straight [1/m]."""
GROWS_M = 30.0
"""Way after which a curvature that grows stays as it is: a clothoid of a street is as long [m]."""


@dataclass(frozen=True, slots=True)
class CarPath:
    """Paths of cars: floats of one car, or arrays that broadcast against places."""

    bend_per_m: float | np.ndarray
    """Curvature of the arc, left positive."""
    turns_on_m: float | np.ndarray = np.inf
    """Way after which the second path goes straight on; infinite: there is none."""
    grows_per_m2: float | np.ndarray = 0.0
    """Growth of the third path's curvature, of its sign; 0: there is none."""

    def of_slot(self, slot: int) -> CarPath:
        """The path of one slot of arrays [S]."""
        on_m, grows = (
            np.broadcast_to(values, np.shape(self.bend_per_m))
            for values in (self.turns_on_m, self.grows_per_m2)
        )
        bend = np.asarray(self.bend_per_m)
        return CarPath(float(bend[slot]), float(on_m[slot]), float(grows[slot]))

    def spread(self, dimensions: int) -> CarPath:
        """Arrays [S] as [S, 1, ...], to broadcast against places of so many dimensions."""
        tail = (1,) * (dimensions - 1)
        bend = np.asarray(self.bend_per_m)
        on_m = np.broadcast_to(self.turns_on_m, bend.shape)
        grows = np.broadcast_to(self.grows_per_m2, bend.shape)
        return CarPath(*(values.reshape(-1, *tail) for values in (bend, on_m, grows)))

    def beside_circle_m(self, x_m: np.ndarray | float, y_m: np.ndarray | float) -> np.ndarray:
        """Distance of places from the arc's whole circle, left of it positive [m].

        The distance from a circle through the rear axle, 1/k - sqrt(x^2 + (1/k - y)^2), written so
        that it holds for k = 0 too. It stays as it is while the car drives on along the circle.
        """
        bend = np.asarray(self.bend_per_m)
        inward = 1.0 - bend * y_m
        root = np.sqrt(inward * inward + (bend * x_m) * (bend * x_m))
        result: np.ndarray = (2.0 * y_m - bend * (x_m * x_m + y_m * y_m)) / (1.0 + root)
        return result

    def beside_arc_m(self, x_m: np.ndarray | float, y_m: np.ndarray | float) -> np.ndarray:
        """How far places lie left of the arc [m]; :data:`FAR_M` beyond a quarter of its circle."""
        bend = np.asarray(self.bend_per_m)
        beside = self.beside_circle_m(x_m, y_m)
        far = np.where(bend > 0.0, FAR_M, -FAR_M)
        result: np.ndarray = np.where(1.0 - bend * y_m > 0.0, beside, far)
        return result

    def beside_second_m(self, x_m: np.ndarray | float, y_m: np.ndarray | float) -> np.ndarray:
        """Distance beside the second path: the arc, then its tangent. An angle of that is small, so
        its sine and cosine are series."""
        return self._beside_second_m(x_m, y_m, self.beside_arc_m(x_m, y_m))

    def _beside_second_m(
        self, x_m: np.ndarray | float, y_m: np.ndarray | float, arc_m: np.ndarray
    ) -> np.ndarray:
        """:meth:`beside_second_m` of places that lie ``arc_m`` beside the arc."""
        bend = np.asarray(self.bend_per_m)
        bends = np.abs(bend) > BEND_MIN_PER_M
        way = np.where(
            bends, np.minimum(self.turns_on_m, 1.0 / np.where(bends, np.abs(bend), 1)), 0
        )
        angle = bend * way
        square = angle * angle
        sine = angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
        cosine = 1.0 - square * (0.5 - square / 24.0)
        end_x = way * (1.0 - square * (1.0 / 6.0 - square / 120.0))
        end_y = way * angle * (0.5 - square / 24.0)
        along, aside = x_m - end_x, y_m - end_y
        straight = aside * cosine - along * sine
        on_arc = along * cosine + aside * sine < 0.0
        result: np.ndarray = np.where(on_arc, arc_m, straight)
        return result

    def holds(
        self,
        x_m: np.ndarray | float,
        right_m: np.ndarray | float,
        left_m: np.ndarray | float,
        half_m: float,
    ) -> np.ndarray:
        """Whether what reaches from ``right_m`` to ``left_m`` at ``x_m`` is within ``half_m`` of
        the arc, and of the second path where there is one."""
        left = self.beside_arc_m(x_m, left_m)
        right = left if right_m is left_m else self.beside_arc_m(x_m, right_m)
        held: np.ndarray = (left > -half_m) & (right < half_m)
        turns_on = np.isfinite(self.turns_on_m)
        if turns_on.any():
            left = self._beside_second_m(x_m, left_m, left)
            if right_m is left_m:
                right = left
            else:
                right = self._beside_second_m(x_m, right_m, right)
            held = held & (((left > -half_m) & (right < half_m)) | ~turns_on)
        grows = np.asarray(self.grows_per_m2)
        if (grows != 0.0).any():
            aside_m = self.beside_growing_m(x_m)
            left = self.beside_arc_m(x_m, left_m - aside_m)
            right = left if right_m is left_m else self.beside_arc_m(x_m, right_m - aside_m)
            held = held & (((left > -half_m) & (right < half_m)) | (grows == 0.0))
        return held

    def beside_growing_m(self, x_m: np.ndarray | float) -> np.ndarray:
        """Distance of the third path, left of the arc: c x^3 / 6 as far as its curvature grows by c
        per metre, and on along a circle; for slopes that are small [m]."""
        way = np.minimum(x_m, GROWS_M)
        rest = x_m - way
        grown = np.asarray(self.grows_per_m2) * way
        aside: np.ndarray = grown * (way * way / 6.0 + 0.5 * rest * (way + rest))
        return aside


@dataclass(frozen=True, slots=True)
class EyePlaces:
    """Where cameras sit and where the cars are going."""

    x_m: np.ndarray
    """Camera before the rear axle, [S]."""
    y_m: np.ndarray
    """Camera left of the middle, [S]."""
    path: CarPath
    """Of the cars, arrays [S]."""
    corridor_half_m: float
    """Half width of the path."""
