"""Scripts of movable objects in closed form: where each is, as a function of sim time alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twin.actors.actor import Actor
from twin.actors.motion import Placement
from twin.base.portable.host import angle_of, sine_cosine

if TYPE_CHECKING:
    from twin.actors.variations import Variations

_BRAKING_MPS2 = 0.3
"""Brake lamps light up when it slows down more than this [m/s^2]."""
_GRID = 2.0**20
_STILL_MPS = 0.02
"""Slower than this it stands [m/s]."""


class _Places(NamedTuple):
    """Places on the actors' paths, each [S, M]."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    heading_rad: np.ndarray
    sine: np.ndarray
    """Of the heading."""
    cosine: np.ndarray
    curvature_per_m: np.ndarray
    slope: np.ndarray
    """Upwards [-]."""


class MotionScript:
    """The motion of M actors in closed form: tables, looked up for all slots at once."""

    def __init__(self, actors: Sequence[Actor]) -> None:
        self.count = len(actors)
        self.actors = tuple(actors)
        self._law, self._last_knot = _padded_laws(actors)
        self._path, self._last_height = _padded_paths(actors)
        self._slopes = any(a.path is not None and np.ptp(a.path.height[:, 1]) for a in actors)
        self._moves = np.array([a.law is not None for a in actors], bool)
        self._start = np.array([a.start_s for a in actors], float)
        self._duration = np.array([a.law.time_s[-1] if a.law else 1.0 for a in actors], float)
        self._length = np.array([a.path.length_m if a.path else 0.0 for a in actors], float)
        self._loop = np.array([a.loop for a in actors], bool)
        self._repeat = np.array([a.repeat_s for a in actors], float)
        self._present = np.array([a.present or a.law is None for a in actors], bool)
        self._kind = np.array([a.kind for a in actors], np.int32)
        self._phases = np.array([a.phases for a in actors], np.int32)
        self._way = np.array([a.way_m or 1.0 for a in actors], float)
        self._vehicle = np.array([a.vehicle for a in actors], bool)

    @property
    def standing(self) -> np.ndarray:
        """See :class:`Motion`."""
        return self._kind

    def at(self, time_s: np.ndarray, varied: Variations | None = None) -> Placement:
        """See :class:`Motion`; every slot's values depend on its own time and case alone."""
        start, pace = (self._start, 1.0) if varied is None else (varied.start_s, varied.pace)
        takes = self._duration / pace
        since = np.asarray(time_s, float)[:, None] - start
        started = since >= 0.0
        rounds = np.where(self._loop & started, np.floor(since / takes), 0.0)
        period = np.where(self._repeat > 0.0, self._repeat, 1.0)
        again = np.where((self._repeat > 0.0) & started, np.floor(since / period), 0.0)
        local = since - rounds * takes - again * self._repeat
        inside = started & (local < takes) & self._moves
        station, speed, acceleration = self._along(np.clip(local * pace, 0.0, self._duration))
        speed, acceleration = speed * pace * inside, acceleration * (pace * pace) * inside
        there = self._where(station)
        x, y = there.x_m, there.y_m
        if varied is not None:
            x, y = x + varied.shift_m[..., 0], y + varied.shift_m[..., 1]
        here = self._present | inside
        walked = station + rounds * self._length
        phase = np.floor(walked / self._way * self._phases).astype(np.int64)
        going = (speed > _STILL_MPS) & (self._phases > 0)
        kind = self._kind + np.where(going, 1 + phase % np.maximum(self._phases, 1), 0)
        standing = self._moves & started & (speed <= _STILL_MPS)
        brake = self._vehicle & ((acceleration < -_BRAKING_MPS2) | standing)
        slope = np.where(self._vehicle, there.slope, 0.0)  # who walks stands upright
        pitch = -_slope_angle(slope) if self._slopes else None
        return Placement(
            kind=np.where(here, kind, -1).astype(np.int32),
            position_m=_settled(np.stack([x, y, there.z_m], axis=-1)),
            yaw_rad=_settled(there.heading_rad),
            velocity_mps=_settled(
                np.stack([speed * there.cosine, speed * there.sine, speed * slope + 0.0], axis=-1)
            ),
            yaw_rate_radps=_settled(speed * there.curvature_per_m),
            brake=brake.astype(np.float32),
            lamps=np.broadcast_to(self._vehicle, x.shape).astype(np.float32),
            pitch_rad=None if pitch is None else _settled(pitch),
            roll_rad=None if pitch is None else np.zeros_like(pitch),
        )

    def _along(self, local_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Station [m], speed [m/s] and acceleration [m/s^2] at times [S, M] of the laws."""
        time, station, speed = self._law
        column = np.arange(self.count)
        k = (local_s[..., None] >= time).sum(axis=-1) - 1
        k = np.clip(k, 0, self._last_knot)
        t0, t1 = time[column, k], time[column, k + 1]
        s0, s1 = station[column, k], station[column, k + 1]
        v0, v1 = speed[column, k], speed[column, k + 1]
        h = t1 - t0
        u = (local_s - t0) / h
        way = s1 - s0
        # s = s0 + h v0 u + (3 way - h (2 v0 + v1)) u^2 + (h (v0 + v1) - 2 way) u^3
        square, cube = 3.0 * way - h * (2.0 * v0 + v1), h * (v0 + v1) - 2.0 * way
        s = s0 + u * (h * v0 + u * (square + u * cube))
        v = (h * v0 + u * (2.0 * square + 3.0 * u * cube)) / h
        return s, v, (2.0 * square + 6.0 * u * cube) / (h * h)

    def _where(self, station: np.ndarray) -> _Places:
        """Places at stations [S, M]."""
        begin, start, bend, height = self._path
        column = np.arange(self.count)
        k = np.maximum((station[..., None] >= begin).sum(axis=-1) - 1, 0)
        ahead = station - begin[column, k]
        x0, y0, yaw0 = (start[column, k, i] for i in range(3))
        curvature = bend[column, k]
        half = 0.5 * curvature * ahead
        # The chord of an arc: 2 sin(k s / 2) / k long, halfway between the two headings.
        heading = yaw0 + 2.0 * half
        turned = np.where(half == 0.0, 1.0, half)
        # All angles at once: a call takes as long for three of them as for one.
        sines, cosines = sine_cosine(np.stack([turned, yaw0 + half, heading]))
        chord = ahead * np.where(half == 0.0, 1.0, sines[0] / turned)
        x, y = x0 + chord * cosines[1], y0 + chord * sines[1]
        q = np.maximum((station[..., None] >= height[..., 0]).sum(axis=-1) - 1, 0)
        q = np.minimum(q, self._last_height)
        s0, s1 = height[column, q, 0], height[column, q + 1, 0]
        share = np.clip((station - s0) / (s1 - s0), 0.0, 1.0)
        rise = height[column, q + 1, 1] - height[column, q, 1]
        z = height[column, q, 1] + share * rise
        return _Places(x, y, z, heading, sines[2], cosines[2], curvature, rise / (s1 - s0))


def _slope_angle(slope: np.ndarray) -> np.ndarray:
    """Angle of slopes [rad]; most streets are level."""
    return angle_of(slope, 1.0) if slope.any() else slope


def _settled(values: np.ndarray) -> np.ndarray:
    """Values on a grid of a millionth."""
    return np.rint(values * _GRID) / _GRID


def _padded_laws(
    actors: Sequence[Actor],
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Time, station and speed of the knots [M, K], and the index of the last but one knot [M]."""
    knots = max((len(a.law.time_s) for a in actors if a.law), default=2)
    time = np.full((len(actors), knots), np.inf)
    station, speed = np.zeros_like(time), np.zeros_like(time)
    last = np.zeros(len(actors), np.int64)
    for m, actor in enumerate(actors):
        law = actor.law
        if law is None:
            time[m, :2] = 0.0, 1.0
            continue
        n = len(law.time_s)
        time[m, :n], station[m, :n], speed[m, :n] = law.time_s, law.station_m, law.speed_mps
        last[m] = n - 2
    return (time, station, speed), last


def _padded_paths(
    actors: Sequence[Actor],
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Pieces of the paths [M, P] and their heights [M, Q, 2]; index of the last height but one."""
    count = len(actors)
    pieces = max((len(a.path.station_m) for a in actors if a.path), default=1)
    heights = max((len(a.path.height) for a in actors if a.path), default=2)
    begin, bend = np.full((count, pieces), np.inf), np.zeros((count, pieces))
    start = np.zeros((count, pieces, 3))
    height = np.full((count, heights, 2), np.inf)
    last = np.zeros(count, np.int64)
    for m, actor in enumerate(actors):
        path = actor.path
        if path is None:
            x, y, z, yaw = actor.pose
            begin[m, 0], start[m, 0] = 0.0, (x, y, yaw)
            height[m, :2] = (0.0, z), (1.0, z)
            continue
        n = len(path.station_m)
        begin[m, :n], start[m, :n], bend[m, :n] = path.station_m, path.start, path.curvature
        height[m, : len(path.height)] = path.height
        last[m] = len(path.height) - 2
    return (begin, start, bend, height), last
