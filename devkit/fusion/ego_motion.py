"""Motion of the car from its own sensors: wheel encoders and IMU, no truth.

Arrays have one row per slot. A Kalman filter of distance and speed takes the accelerometer as what
drives it and the mean of the four wheels as what it measures: at 20 Hz one tick of a 44-tooth wheel
is 1 m/s, so a difference of two counts alone would say little.
"""

from __future__ import annotations

import math

import numpy as np

from devkit.fusion.path import CarPath
from schemas.messages import IMU_COLUMNS, VEHICLE_COLUMNS

_ACCEL = IMU_COLUMNS.index("accel_x_mps2")
_RATE = IMU_COLUMNS.index("rate_z_radps")
_SPEED = VEHICLE_COLUMNS.index("speed_mps")
_YAW_RATE = VEHICLE_COLUMNS.index("yaw_rate_radps")
_STEERING = VEHICLE_COLUMNS.index("steering_rad")

ACCEL_SIGMA_MPS2 = 0.8
"""Deviation of the accelerometer as a measure of the change of speed: the pitch of a braking car
leaks gravity into it [m/s^2]."""
START_VARIANCE = 1.0
"""Of the by-wire feedback's speed, which the filter begins with [m^2/s^2]."""
STILL_S = 0.3
"""A car whose wheels have not turned for so long stands [s]."""
STEERING_BELOW_MPS = 1.0
"""Below this speed the path is told by the wheels' angle: a yaw rate over a speed near zero says
nothing [m/s]."""
WHEELBASE_M = 3.09
"""Wheelbase by which a steering angle becomes a curvature [m]."""
CURVATURE_S = 0.15
"""Time constant of the smoothed curvature [s]."""
TURNS_IN_MPS = 8.5
"""A slower car that turns may turn into another road, and does not follow a curve [m/s]."""
TURNED_S = 20.0
"""Time in which the direction from which the car has turned is forgotten [s]."""
DIVE_S = 0.1
"""Time constant of the pitch that follows from the acceleration: the accelerometer's noise is not
of the body [s]."""


class EgoMotion:
    """Speed, yaw rate, pitch and path of S cars."""

    def __init__(self, slots: int, dive_rad_per_mps2: float = 0.0) -> None:
        """Begin with all cars at rest; ``dive_rad_per_mps2``: how far the nose dives."""
        self._dive = dive_rad_per_mps2
        self.speed_mps = np.zeros(slots)
        self.yaw_rate_radps = np.zeros(slots)
        self.curvature_per_m = np.zeros(slots)
        """Of the path, left positive."""
        self.turned_rad = np.zeros(slots)
        """How far the car has turned lately, left positive."""
        self._curving = np.zeros(slots)
        """Change of the curvature [1/(m s)]."""
        self.dive_rad = np.zeros(slots)
        """Pitch against the road, nose down positive, as the accelerometer lets expect; 0 without
        one."""
        self.still = np.zeros(slots, bool)
        """Whether the wheels stand."""
        self.from_encoders = np.zeros(slots, bool)
        """Whether the speed comes from the wheel encoders; else from the by-wire feedback."""
        self.tick_m = np.full(slots, math.inf)
        """Way per encoder tick; infinite without encoders."""
        self._distance_m = np.zeros(slots)
        self._variance = np.zeros((3, slots))
        self._counted_m = np.zeros(slots)
        self._still_s = np.zeros(slots)
        self._accel_mps2 = np.zeros(slots)
        self._fresh = np.ones(slots, bool)

    def reset(self, slot: int, ticks_per_rev: float, wheel_radius_m: float) -> None:
        """A new car stands or drives in ``slot``; ``ticks_per_rev`` 0: it has no encoders."""
        for values in (
            *(self.speed_mps, self.yaw_rate_radps, self.curvature_per_m, self._distance_m),
            *(self._counted_m, self._still_s, self._accel_mps2, self.dive_rad),
            *(self.turned_rad, self._curving),
        ):
            values[slot] = 0.0
        self.still[slot] = self.from_encoders[slot] = False
        self._fresh[slot] = True
        way_m = 2.0 * math.pi * wheel_radius_m
        self.tick_m[slot] = way_m / ticks_per_rev if ticks_per_rev > 0.0 else math.inf
        self._variance[:, slot] = (0.01, 0.0, START_VARIANCE)

    def update(
        self,
        vehicle: np.ndarray,
        encoders: np.ndarray | None,
        imu: np.ndarray | None,
        period_s: np.ndarray,
    ) -> None:
        """One control tick.

        Args:
            vehicle: by-wire feedback, float64 [S, 7].
            encoders: counts, int64 [S, 4]; None where none is due or there are none.
            imu: float64 [S, 6]; None likewise.
            period_s: since the last tick, per slot [s].
        """
        if imu is not None:
            self._accel_mps2 = imu[:, _ACCEL].copy()
            self.yaw_rate_radps = imu[:, _RATE].copy()
            share = period_s / (period_s + DIVE_S)
            self.dive_rad = self.dive_rad - share * (self._dive * self._accel_mps2 + self.dive_rad)
        else:
            self.yaw_rate_radps = vehicle[:, _YAW_RATE].copy()
        if encoders is not None:
            self._measure(encoders, period_s, inertial=imu is not None)
            self._begin(vehicle[:, _SPEED])
        else:
            self.speed_mps = vehicle[:, _SPEED].copy()
            self.still = np.abs(self.speed_mps) < 0.05
            self.from_encoders[:] = False
        self._bend(vehicle[:, _STEERING], period_s)

    def _measure(self, encoders: np.ndarray, period_s: np.ndarray, *, inertial: bool) -> None:
        """Predict by the accelerometer, correct by the counted way."""
        finite = np.isfinite(self.tick_m)
        tick_m = np.where(finite, self.tick_m, 0.0)
        count = encoders[:, 0] + encoders[:, 1] + encoders[:, 2] + encoders[:, 3]
        # A count is the floor of what the wheel has turned: half a tick is missing on average.
        counted_m = (0.25 * count + 0.5) * tick_m
        moved = counted_m != self._counted_m
        self._still_s = np.where(moved, 0.0, self._still_s + period_s)
        self._counted_m = counted_m
        accel = self._accel_mps2 if inertial else np.zeros_like(self._accel_mps2)
        sigma = ACCEL_SIGMA_MPS2 if inertial else 4.0
        p_ss, p_sv, p_vv = self._variance
        q = sigma * sigma * period_s * period_s
        half_s = 0.5 * period_s
        distance = self._distance_m + (self.speed_mps + half_s * accel) * period_s
        speed = self.speed_mps + accel * period_s
        p_ss = (
            p_ss
            + 2.0 * period_s * p_sv
            + period_s * period_s * p_vv
            + 0.25 * q * period_s * period_s
        )
        p_sv = p_sv + period_s * p_vv + half_s * q
        p_vv = p_vv + q
        measured = tick_m * tick_m / 12.0 + 1e-9
        gain_s, gain_v = p_ss / (p_ss + measured), p_sv / (p_ss + measured)
        residual = counted_m - distance
        self._distance_m = distance + gain_s * residual
        speed = speed + gain_v * residual
        keep = 1.0 - gain_s
        self._variance = np.stack([keep * p_ss, keep * p_sv, p_vv - gain_v * p_sv])
        self.still = self._still_s >= STILL_S
        self.speed_mps = np.where(self.still, 0.0, np.maximum(speed, 0.0))
        self.from_encoders[:] = True

    def _begin(self, speed_mps: np.ndarray) -> None:
        """At the first tick the speed is that of the by-wire feedback: one count says nothing of a
        car that is on its way already."""
        fresh = self._fresh
        self.speed_mps = np.where(fresh, speed_mps, self.speed_mps)
        self._distance_m = np.where(fresh, self._counted_m, self._distance_m)
        start = np.array([[0.01], [0.0], [START_VARIANCE]])
        self._variance = np.where(fresh, start, self._variance)
        self._fresh = np.zeros_like(fresh)

    def _bend(self, steering_rad: np.ndarray, period_s: np.ndarray) -> None:
        """Curvature by yaw rate over speed, by the steering angle of a bicycle when slow."""
        fast = self.speed_mps > STEERING_BELOW_MPS
        by_yaw = self.yaw_rate_radps / np.where(fast, self.speed_mps, 1.0)
        # tan(a) to 1 % up to 0.6 rad; a series, since tangents of libraries differ.
        square = steering_rad * steering_rad
        tangent = steering_rad * (1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0)))
        wanted = np.where(fast, by_yaw, tangent / WHEELBASE_M)
        share = period_s / (period_s + CURVATURE_S)
        change = wanted - self.curvature_per_m
        self.curvature_per_m = self.curvature_per_m + share * change
        self._curving = self._curving + share * (change / (period_s + CURVATURE_S) - self._curving)
        turned = self.turned_rad + self.yaw_rate_radps * period_s
        self.turned_rad = turned * (1.0 - period_s / TURNED_S)

    @property
    def path(self) -> CarPath:
        """Where the cars go, arrays [S]: on along the arc, or straight on from where it ends.

        It may end where a car that turns back has the direction again that it turned from, as at
        the end of a lane change; or, while the wheel is turned back, where it is straight: a
        clothoid from curvature k to 0 turns by k^2 / (2 dk/ds), as the arc does in half its way.
        While a curve begins its curvature may also grow on; a slow car turns into another road.
        """
        bend = self.curvature_per_m
        back = bend * self.turned_rad < 0.0
        back_m = np.where(back, -self.turned_rad / np.where(back, bend, 1.0), np.inf)
        unwinds = bend * self._curving < 0.0
        clothoid_m = -self.speed_mps * bend / np.where(unwinds, self._curving, 1.0)
        on_m = np.minimum(back_m, np.where(unwinds, 0.5 * clothoid_m, np.inf))
        grows = (bend * self._curving > 0.0) & (self.speed_mps > TURNS_IN_MPS)
        grown = self._curving / np.where(grows, self.speed_mps, 1.0)
        return CarPath(bend, on_m, np.where(grows, grown, 0.0))
