"""Keeps track of the lane: markings of the last moments, carried along with the car's motion.

A fixed-lag map. Every camera frame adds the markings it shows; between frames the map moves by
speed and yaw rate; the lane is the curve through what is left. So a gap between dashes, a frame of
glare or a stretch without paint changes nothing, and a lane that is seen no more fades from sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from devkit.lane.curve import LaneCurve, fit
from devkit.lane.lines import Points, find_points
from devkit.lane.view import LaneView
from schemas.messages import Detection

MEMORY_S = 0.4
"""Points lose 1/e of their weight in this time [s]."""
WEIGHT_MIN = 0.03
"""Lighter points are forgotten [-]."""
BEHIND_M = 4.0
"""Points further behind the rear axle are forgotten [m]."""
GATES_M = (1.1, 0.5)
"""Distance from the expectation within which a marking is looked for, before and after the lane is
known [m]."""
SCALES_M = (0.5, 0.3, 0.2)
"""Residual at which a point's say is quartered, one round of the fit after the other [m]."""
SUPPORT_MIN = (5.0, 2.0)
"""The lane is known while the points that agree with it weigh this much together, to find it and
to keep it; one clear frame weighs 15 [-]."""
AGREED_MIN = (0.8, 0.6)
"""Share of all points, by weight, that must agree to find a lane and to keep it. On wrong curves
through rain streaks and glare at most 0.75 of them agreed, on the right ones 0.81 [-]."""
FRAMES_MIN = 3
"""Camera frames in a row that must agree before a lane counts as found: streaks of rain lie
elsewhere in each [-]."""
FOUND_WITHIN = (1.0, 0.15, 0.02)
"""A lane that is found lies within this offset [m] and slope [-] of the car, and its curvature
within this of the one it was looked for along [1/m]: cars do not begin beside their lane."""


@dataclass(frozen=True, slots=True)
class CarMotion:
    """Motion of the car, from its own sensors."""

    speed_mps: float
    yaw_rate_radps: float

    @property
    def lateral_mps2(self) -> float:
        """Centripetal acceleration, to the left [m/s^2]."""
        return self.speed_mps * self.yaw_rate_radps


@dataclass(frozen=True, slots=True)
class Chassis:
    """Response of the car's body to lateral acceleration, in steady state."""

    roll_rad_per_mps2: float
    """Roll about x, positive: leans to the right, in a bend to the left [rad s^2/m]."""
    sideslip_rad_per_mps2: float
    """The rear axle moves this far to the right of where the car points, likewise [rad s^2/m]."""


@dataclass(slots=True)
class LaneTrack:
    """One car's lane."""

    view: LaneView
    lines_m: tuple[float, ...]
    """Places of painted markings, left of the lane's centre [m]."""
    chassis: Chassis
    curve: LaneCurve = field(default_factory=LaneCurve)
    """The lane's centre line, or the last that was known of it."""
    known: bool = False
    """Enough markings agree with the curve."""
    sure: bool = False
    """Whether there are as many as it takes to find a lane; fewer keep it."""
    _rows: np.ndarray = field(default_factory=lambda: np.zeros((4, 0)))
    """Ahead, left [m], painted at [m] and weight of the points, [4, P]."""

    _motion: CarMotion | None = None
    _bend_per_m: float = 0.0
    """Bend of the lane when it was known last."""
    _looked_along: float = 0.0
    """Curvature of the last search."""
    _agreeing: int = 0
    """Camera frames in a row that agree on a lane that is not known yet."""

    def update(
        self,
        motion: CarMotion,
        image: np.ndarray | None,
        period_s: float,
        covered: Sequence[Detection] = (),
    ) -> LaneCurve | None:
        """One control tick.

        Args:
            motion: of this tick.
            image: a new camera frame, uint8 [H, W, 3], RGB; None when none is due.
            period_s: control period, gone by since the last tick [s].
            covered: objects in the image; no marking is looked for on them.

        Returns:
            The lane's centre line, None where it is not known.
        """
        if self._motion is not None:
            self._move(self._motion, motion, period_s)
        self._motion = motion
        if image is not None:
            self._look(image, covered, self.chassis.roll_rad_per_mps2 * motion.lateral_mps2)
        return self.curve if self.known else None

    @property
    def bend(self) -> LaneCurve | None:
        """The curve, where so much of it is seen that its bend can be told."""
        return self.curve if self.known and self.sure else None

    def _move(self, before: CarMotion, now: CarMotion, period_s: float) -> None:
        """Carry everything along while the car moves for ``period_s``."""
        speed_mps = 0.5 * (before.speed_mps + now.speed_mps)
        turn = 0.5 * (before.yaw_rate_radps + now.yaw_rate_radps) * period_s
        # The car rolls along an arc; its chord lies halfway between the headings. Series of the
        # functions of a small angle: the library's own differ between machines.
        way_m = speed_mps * period_s
        drift_m = -self.chassis.sideslip_rad_per_mps2 * now.lateral_mps2 * way_m
        square = turn * turn
        cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0)
        sine = turn * (1.0 - square / 6.0 * (1.0 - square / 20.0))
        ahead = self._rows[0] - way_m
        left = self._rows[1] - way_m * turn / 2.0 - drift_m
        weight = self._rows[3] * (1.0 / (1.0 + period_s / MEMORY_S))
        rows = np.stack(
            [cosine * ahead + sine * left, cosine * left - sine * ahead, self._rows[2], weight]
        )
        self._rows = rows[:, (rows[0] > -BEHIND_M) & (rows[3] > WEIGHT_MIN)]
        self.curve = _moved(self.curve, way_m, turn)
        self._fit(SCALES_M[-1:])

    def _look(self, image: np.ndarray, covered: Sequence[Detection], roll_rad: float) -> None:
        """Add what a camera frame shows."""
        if not self.known and not self._agreeing:
            # Points that are no lane yet would only be in the way of the next try.
            self._rows = np.zeros((4, 0))
            # Along the bend it was lost in, and straight ahead, by turns.
            self._looked_along = 0.0 if self._looked_along else self._bend_per_m
            self.curve = LaneCurve((0.0, 0.0, self._looked_along, 0.0))
        gate_m = GATES_M[self.known or self._agreeing > 0]
        points = find_points(image, self.view, self.curve, self.lines_m, gate_m, covered)
        ahead_m, left_m = self.view.rolled(points.ahead_m, points.left_m, roll_rad)
        points = Points(ahead_m, left_m, points.line_m)
        self._rows = np.concatenate([self._rows, _weighted(points)], axis=1)
        self._fit(SCALES_M)
        if not self.known and self._agreeing:
            self._agreeing += 1
            self.known = self._agreeing > FRAMES_MIN

    def _fit(self, scales_m: tuple[float, ...]) -> None:
        """Fit the curve in rounds (iteratively reweighted least squares, Geman and McClure's
        weights): from the curve as it was, points that lie far from it count less and less."""
        ahead, left, line, weight = self._rows
        if not weight.size:
            self.known, self.sure, self._agreeing, self.curve = False, False, 0, LaneCurve()
            return
        curve = self.curve
        for scale_m in scales_m:
            centre = left - line * curve.stretch(ahead)
            off = (centre - curve.left_m(ahead)) / scale_m
            agreed = 1.0 / (1.0 + off * off)
            trusted = weight * agreed * agreed
            curve = fit(ahead, centre, trusted)
        support, total = float(trusted.sum()), float(weight.sum())
        self.sure = support >= max(SUPPORT_MIN[0], AGREED_MIN[0] * total)
        if self.known:
            self.known = support >= max(SUPPORT_MIN[1], AGREED_MIN[1] * total)
            self._agreeing = 0
        elif self.sure and _plausible(curve, self._looked_along):
            self._agreeing = max(self._agreeing, 1)
        else:
            self._agreeing = 0
        self.curve = curve if self.known or self._agreeing else LaneCurve()
        if self.known and self.sure:
            self._bend_per_m = curve.coefficients[2]


def _plausible(curve: LaneCurve, looked_along: float) -> bool:
    a, b, c, _ = curve.coefficients
    offset_m, slope, bend_per_m = FOUND_WITHIN
    return abs(a) < offset_m and abs(b) < slope and abs(c - looked_along) < bend_per_m


def _weighted(points: Points) -> np.ndarray:
    """Rows of the map [4, P]; the further away, the less exact is a place on the road."""
    share = 1.0 / (1.0 + 0.1 * points.ahead_m)
    return np.stack([points.ahead_m, points.left_m, points.line_m, share * share])


def _moved(curve: LaneCurve, way_m: float, turn: float) -> LaneCurve:
    """The curve as seen from the new place, for small turns."""
    _, _, c, d = curve.coefficients
    left_m = curve.left_m(way_m) - way_m * turn / 2.0
    slope = curve.slope(way_m)
    return LaneCurve((left_m, (slope - turn) / (1.0 + slope * turn), c + d * way_m, d))
