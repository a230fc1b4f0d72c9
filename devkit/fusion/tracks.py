"""Tracks of what stands and moves around S cars: Kalman filters in arrays [S, T].

The state of a track is the middle of its near end in the car's axes, and its velocity over ground
along them, with a turn rate beside it. Per axis a constant-velocity filter (Bar-Shalom, Li and
Kirubarajan 2001, 6.2.2), whose velocity turns; the car's own motion moves the axes. Products are
written out and nothing is summed across arrays, so a slot's numbers do not depend on how many there
are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from devkit.fusion.parameters import TrackingParameters
from devkit.fusion.path import EyePlaces
from devkit.fusion.seen_ends import SeenEnds
from devkit.fusion.sightings import SIDEWAYS_SHARE, Sightings, is_person, sideways_share

TRACKS_MAX = 32
"""Most tracks of a car."""
LATERAL_SIGMA_M = 0.4
"""Deviation of an object's middle by LiDAR or radar, what is seen of it changes [m]."""
NARROW_SIGMA_M, NARROW_SHARE = 0.1, 0.17
"""The same by LiDAR for what is narrow: at no width [m], and per width [-]."""
BEARING_SIGMA_RAD = 0.01
"""Deviation of a radar's direction [rad]."""
PLACE_UNKNOWN = 1e4
"""Variance of a place along that nothing is known of [m^2]."""
EDGE_SHARE = 0.5
"""Share by which a new sighting moves the ends of a track [-]."""
PART_SIGMAS = 2.0
"""A width that changes by more than twice so many deviations of the middle is of another part of
the object [-]."""
INSIDE_SHARE = 0.4
"""Share by which one sighting changes whether a track is in the path, and whether radial speeds
agree with its velocity [-]."""
HELD_S = 1.0
"""A sensor that measures places and has seen a track so lately tells where it is, though a few
sweeps may have missed it: the camera's guess does not take its place at once [s]."""
STEP_M = 0.6
"""A person, and either end of him, is no further from where he was expected [m]."""
SLOW_MPS = 2.0
"""What is slower along and across may as well stand [m/s]."""
LOST_S = 0.35
"""LiDAR that sees a track again after so long begins to count anew [s]."""
VOUCHED_S = 0.25
"""A sensor that misses what another one has seen so lately says nothing against it: a pedestrian's
echo comes and goes [s]."""
TURN_PER_S, ACCEL_PER_S = 0.8, 2.5
"""Share by which a corrected heading changes the turn rate, and a corrected speed along x the
acceleration [1/s]."""
TURN_FADES_S, ACCEL_FADES_S = 4.0, 2.0
"""Time in which they fade if nothing confirms them [s]."""
ACCEL_MAX_MPS2 = 8.0
"""Largest acceleration of a track [m/s^2]."""
PLACES_KEPT = 12
"""Places for tracks along the road, which what is beside it does not take [-]."""
TURN_MAX_RADPS = 0.8
"""Largest turn rate of a track [rad/s]."""
TURNS_FROM_MPS = 4.0
"""Slower objects have no turn rate: the noise of their speed across would turn them [m/s]."""
OVERLAP_MIN = 0.3
"""Share of a camera box that must lie on a track for it to be of it [-]."""
NAMED_BOXES = 2.0
"""Boxes that name a person for good, unless as many others say otherwise [-]."""
SETTLED_S, SETTLED_SWEEPS = 0.5, 2
"""The place of a younger track that LiDAR has seen less often is not known well enough to tell how
far it has gone since [s, -]."""
BEHIND_M = -2.0
"""Tracks further behind the rear axle are forgotten [m]."""
KNOWN_VARIANCE = 2.0
"""Variance of a speed that is known [m^2/s^2]."""
PLACE_GATE = 4.0
"""Largest squared residual of a place across over its variance [-]."""
SPEED_GATE = 9.0
"""Largest squared residual of a radial speed over its variance [-]."""
PROBABILITY_MAX = 0.999
"""Existence is never surer [-]."""


def _arrays(slots: int, count: int) -> list[np.ndarray]:
    return [np.zeros((slots, TRACKS_MAX)) for _ in range(count)]


@dataclass(frozen=True, slots=True)
class SensorMemory:
    """What the tracks remember of one sensor, arrays [S, T]."""

    age_s: np.ndarray
    """Since it saw the track last; 1e9: never."""
    inside: np.ndarray
    """How much it says that the track is in the path, 0 to 1."""
    hits: np.ndarray
    """Sightings so far."""

    @classmethod
    def empty(cls, slots: int) -> SensorMemory:
        """Nothing remembered."""
        inside, hits = _arrays(slots, 2)
        return cls(np.full((slots, TRACKS_MAX), 1e9), inside, hits)


class TrackStore:
    """All tracks of S cars."""

    def __init__(self, slots: int, parameters: TrackingParameters) -> None:
        """Begin without tracks."""
        self._p = parameters
        self.live = np.zeros((slots, TRACKS_MAX), bool)
        self.x_m, self.y_m, self.vx_mps, self.vy_mps = _arrays(slots, 4)
        self.p_xx, self.p_xv, self.p_vv = _arrays(slots, 3)
        self.q_xx, self.q_xv, self.q_vv = _arrays(slots, 3)
        """Variances along y."""
        self.right_m, self.left_m, self.path_m = _arrays(slots, 3)
        """Ends relative to ``y_m``, and the nearest part in the path relative to ``x_m``."""
        self.turn_radps = np.zeros((slots, TRACKS_MAX))
        """Turn rate over ground, left positive."""
        self.accel_mps2 = np.zeros((slots, TRACKS_MAX))
        """Acceleration over ground along x."""
        self.from_x_m, self.from_y_m = _arrays(slots, 2)
        """Where it was at the age of :data:`SETTLED_S`, a place on the road, in the axes of now."""
        self.agrees, self.steady = np.ones((2, slots, TRACKS_MAX))
        """Share of radial speeds, and of places across, lately that its velocity explains: 1 at
        first."""
        self.ends = SeenEnds((slots, TRACKS_MAX))
        self.radial_mps = np.zeros((slots, TRACKS_MAX))
        """What radar measures along the ray lately, smoothed."""
        self.probability, self.age_s = _arrays(slots, 2)
        self.label = np.zeros((slots, TRACKS_MAX), np.int64)
        self.named = np.zeros((slots, TRACKS_MAX))
        """Boxes that say so, less those that say otherwise, up to :data:`NAMED_BOXES`."""
        self.place = np.full((slots, TRACKS_MAX), -1)
        """Of the camera box that showed it in this picture; -1: none."""
        self.camera = SensorMemory.empty(slots)
        self.lidar = SensorMemory.empty(slots)
        self.radar = SensorMemory.empty(slots)

    def reset(self, slot: int) -> None:
        """Forget the tracks of a slot."""
        self.live[slot] = False

    def predict(
        self, period_s: np.ndarray, speed_mps: np.ndarray, yaw_rate_radps: np.ndarray
    ) -> None:
        """Move on by a period: objects by velocity and turn rate (CTRV, to first order in the small
        turn of a period), the axes by the car's motion, all [S]."""
        dt, v = period_s[:, None], speed_mps[:, None]
        turn = yaw_rate_radps[:, None] * dt
        # A turn of one period is small: the series is exact to 1e-9 below 0.15 rad.
        square = turn * turn
        c = 1.0 - square * (0.5 - square / 24.0)
        s = turn * (1.0 - square * (1.0 / 6.0 - square / 120.0))
        bend = self.turn_radps * dt
        vx, vy = self.vx_mps - bend * self.vy_mps, self.vy_mps + bend * self.vx_mps
        vx = vx + self.accel_mps2 * dt
        self.accel_mps2 = self.accel_mps2 * (1.0 - dt / ACCEL_FADES_S)
        self.turn_radps = self.turn_radps * (1.0 - dt / TURN_FADES_S)
        x = self.x_m + (0.5 * (self.vx_mps + vx) - v) * dt
        y = self.y_m + 0.5 * (self.vy_mps + vy) * dt
        self.x_m, self.y_m = c * x + s * y, c * y - s * x
        self.ends.move(dt, s, c, x)
        x, y = self.from_x_m - v * dt, self.from_y_m
        self.from_x_m, self.from_y_m = c * x + s * y, c * y - s * x
        self.vx_mps, self.vy_mps = c * vx + s * vy, c * vy - s * vx
        noise = self._p.acceleration_mps2 * self._p.acceleration_mps2
        for pos, cross, vel in (("p_xx", "p_xv", "p_vv"), ("q_xx", "q_xv", "q_vv")):
            xx, xv, vv = getattr(self, pos), getattr(self, cross), getattr(self, vel)
            moved = xx + dt * (2.0 * xv + dt * vv)
            setattr(self, pos, moved + 0.25 * noise * (dt * dt) * (dt * dt))
            setattr(self, cross, xv + dt * vv + 0.5 * noise * dt * dt * dt)
            setattr(self, vel, vv + noise * dt * dt)
        self.age_s = self.age_s + dt
        # The first of these sweeps may be of another thing: its place counts less than the second.
        settled = self.lidar.hits - (self.lidar.age_s == 0.0) >= SETTLED_SWEEPS
        settles = (self.age_s < SETTLED_S) & ~settled
        self.from_x_m = np.where(settles, self.x_m, self.from_x_m)
        self.from_y_m = np.where(settles, self.y_m, self.from_y_m)
        for memory in (self.camera, self.lidar, self.radar):
            memory.age_s[...] += dt
        self.place[...] = -1

    def placed_s(self) -> np.ndarray:
        """Time since the sensor that tells where a track is saw it last: LiDAR, where it has seen
        it lately, else radar, else the camera [s]."""
        by_radar = self.radar.age_s < HELD_S
        others = np.where(by_radar, self.radar.age_s, self.camera.age_s)
        return np.where(self.lidar.age_s < HELD_S, self.lidar.age_s, others)

    def update(self, seen: Sightings, memory: SensorMemory, looked: np.ndarray) -> None:
        """Take the sightings of a sensor that measures places: LiDAR or radar.

        Each sighting goes to the nearest track within the gate, pairs in the order of their
        distance, equal ones in that of their numbers; what is left over begins new tracks.

        Args:
            seen: arrays [S, M].
            memory: of the sensor.
            looked: bool [S]: slots that have a new sweep.
        """
        pair = self._assigned(self._distances(seen), looked)
        self._correct(seen, memory, pair)
        self._missed(memory, pair, looked)
        self._begin(seen, memory, pair, looked)

    def confirm(self, seen: Sightings, eye: EyePlaces) -> np.ndarray:
        """Take the boxes of a picture: each raises the track that it fits best.

        A box tells directions well and distances badly, so it moves only tracks that no other
        sensor places. Its ends are those at the track's distance along its rays, and so is whether
        they reach into the path: the camera's directions at the radar's distance. Where that would
        make it wider than it is at its own distance, the box is too large, as one around two cars
        is, and its middle counts.

        Args:
            seen: arrays [S, M].
            eye: the cameras, and the paths.

        Returns:
            bool [S, M]: boxes that cover no track.
        """
        eye_x, eye_y = eye.x_m[:, None, None], eye.y_m[:, None, None]
        x = self.x_m[:, :, None]
        scale = np.maximum(x - eye_x, 0.5) / np.maximum(seen.x_m[:, None] - eye_x, 0.5)
        right = eye_y + (seen.right_m[:, None] - eye_y) * scale
        left = eye_y + (seen.left_m[:, None] - eye_y) * scale
        y = self.y_m[:, :, None]
        wider = 0.5 * np.maximum(left - right - (seen.left_m - seen.right_m)[:, None], 0.0)
        right, left = right + wider, left - wider
        common = np.minimum(left, y + self.left_m[:, :, None])
        common = common - np.maximum(right, y + self.right_m[:, :, None])
        least = np.minimum(left - right, (self.left_m - self.right_m)[:, :, None])
        along = x - seen.x_m[:, None]
        variance = self.p_xx[:, :, None] + (seen.sigma_m * seen.sigma_m)[:, None]
        cover = self.live[:, :, None] & seen.valid[:, None]
        cover &= (common >= OVERLAP_MIN * least) & (along * along < self._p.gate * variance)
        aside = 0.5 * (left + right) - y - 0.5 * (self.left_m + self.right_m)[:, :, None]
        sideways = LATERAL_SIGMA_M * LATERAL_SIGMA_M + self.q_xx[:, :, None]
        cost = np.where(
            cover,
            along * along / variance + aside * aside / (sideways + 0.25 * least * least),
            np.inf,
        )
        # The box of a car that stands is not of one that comes along beside it.
        theirs = cover & (cost.argmin(axis=1)[:, None] == np.arange(TRACKS_MAX)[:, None])
        best = np.where(theirs, cost, np.inf).argmin(axis=2)
        pair = np.where(theirs.any(axis=2), best, -1)
        reaches = eye.path.spread(3).holds(x, right, left, eye.corridor_half_m)
        self._correct(seen, self.camera, pair, reaches)
        taken: np.ndarray = cover.any(axis=1)
        alone: np.ndarray = seen.valid & ~taken
        return alone

    def take_boxes(self, seen: Sightings, eye: EyePlaces, looked: np.ndarray) -> None:
        """:meth:`confirm`, and begin tracks of the boxes that cover none."""
        alone = self.confirm(seen, eye)
        pair = np.where(self.live & (self.camera.age_s == 0.0), 0, -1)
        self._missed(self.camera, pair, looked)
        self._begin(replace(seen, valid=alone), self.camera, np.full(self.live.shape, -1), looked)

    def _distances(self, seen: Sightings) -> np.ndarray:
        """Squared Mahalanobis distance of every track and sighting, [S, T, M]; infinite outside
        the gate. Across, ends count: what overlaps is not apart."""
        along = seen.x_m[:, None] - self.x_m[:, :, None]
        variance = self.p_xx[:, :, None] + (seen.sigma_m * seen.sigma_m)[:, None]
        y = self.y_m[:, :, None]
        apart = np.maximum(
            seen.right_m[:, None] - (y + self.left_m[:, :, None]),
            (y + self.right_m[:, :, None]) - seen.left_m[:, None],
        )
        apart = np.maximum(apart, 0.0)
        sideways = self.q_xx[:, :, None] + LATERAL_SIGMA_M * LATERAL_SIGMA_M
        distance = along * along / variance + apart * apart / sideways
        near = self.live[:, :, None] & seen.valid[:, None] & (distance < self._p.gate)
        return np.where(near, distance, np.inf)

    def _assigned(self, distance: np.ndarray, looked: np.ndarray) -> np.ndarray:
        """Sighting of each track, int [S, T]; -1: none."""
        slots, tracks, places = distance.shape
        pair = np.full((slots, tracks), -1)
        flat = np.where(looked[:, None, None], distance, np.inf).reshape(slots, -1).copy()
        cube = flat.reshape(slots, tracks, places)
        rows = np.arange(slots)
        for _ in range(min(tracks, places)):
            best = flat.argmin(axis=1)
            open_ = np.flatnonzero(flat[rows, best] < np.inf)
            if not len(open_):
                break
            track, place = np.divmod(best[open_], places)
            pair[open_, track] = place
            cube[open_, track, :] = np.inf
            cube[open_, :, place] = np.inf
        return pair

    def _correct(
        self,
        seen: Sightings,
        memory: SensorMemory,
        pair: np.ndarray,
        reaches: np.ndarray | None = None,
    ) -> None:
        """Kalman's correction of the paired tracks, their ends, their place in the path; bool
        ``reaches`` [S, T, M]: who is in the path, if that depends on the track."""
        paired = pair >= 0
        index = np.where(paired, pair, 0)

        def of(values: np.ndarray) -> np.ndarray:
            picked: np.ndarray = np.take_along_axis(values, index, axis=1)
            return picked

        by_camera = memory is self.camera
        # Who measures places worse leaves those alone that a better sensor sees.
        better_s = np.minimum(self.lidar.age_s, self.radar.age_s) if by_camera else self.lidar.age_s
        moved = paired & ((better_s >= HELD_S) | (memory is self.lidar))
        right, left, x = of(seen.right_m), of(seen.left_m), of(seen.x_m)
        sigma, middle = of(seen.sigma_m), 0.5 * (left + right)
        vx, vy, known = self.vx_mps, self.vy_mps, self._speeds_known()
        sideways = self._sideways(x, sigma, left - right, memory)
        # Where another part is seen its middle is elsewhere, by up to half of what the width
        # changes, and nothing has moved.
        grown = 0.5 * np.abs(left - right - self.left_m + self.right_m)
        step = np.where(grown > PART_SIGMAS * np.sqrt(sideways), grown, 0.0)
        away_m, aside = x - self.x_m, middle - self.y_m
        if memory is self.lidar:
            along2, end_m = away_m * away_m, np.abs(aside) + grown
            other = (step > 0.0) | (along2 + aside * aside > STEP_M * STEP_M)
            anew = other | (memory.age_s > LOST_S)
            self.ends.count(paired, anew)
            anew |= along2 + end_m * end_m > STEP_M * STEP_M
            self.ends.see(paired, anew, right, left, vy)
            self._begin_across(moved & other & (step == 0.0), middle, sideways)
            self._begin_along(moved & (step > 0.0), away_m, sigma, 2.0 * grown)
        aside = np.clip(middle - self.y_m, -step, step)
        self.y_m = np.where(moved, self.y_m + aside, self.y_m)
        beside = middle - self.y_m
        fits = beside * beside < PLACE_GATE * (self.q_xx + sideways)
        self.steady += np.where(moved, INSIDE_SHARE * (fits - self.steady), 0.0)
        self._filter(moved, x, middle, sigma * sigma, sideways)
        radial = of(seen.radial_mps)
        told = paired & np.isfinite(radial)
        share = np.where(memory.hits == 0.0, 1.0, INSIDE_SHARE)
        step_mps = share * (np.where(told, radial, 0.0) - self.radial_mps)
        self.radial_mps = np.where(told, self.radial_mps + step_mps, self.radial_mps)
        self._measure_speed(told, radial, of(seen.radial_sigma_mps), of(seen.ray_y))
        self._turn(paired, known, vx, vy)
        first = moved & ((memory.hits == 0.0) | (step > 0.0))
        share = np.where(first, 1.0, EDGE_SHARE)
        half = 0.5 * (left - right)
        self.left_m = np.where(moved, self.left_m + share * (half - self.left_m), self.left_m)
        self.right_m = np.where(moved, self.right_m - share * (half + self.right_m), self.right_m)
        path = of(seen.path_x_m) - x
        self.path_m = np.where(moved, path, self.path_m)
        if reaches is None:
            inside = of(seen.inside).astype(float)
        else:
            inside = np.take_along_axis(reaches, index[:, :, None], axis=2)[:, :, 0].astype(float)
        memory.inside[...] = np.where(
            paired, memory.inside + INSIDE_SHARE * (inside - memory.inside), memory.inside
        )
        # After a while it may be another thing that LiDAR sees.
        lost = paired & (memory is self.lidar) & (memory.age_s > LOST_S)
        memory.hits[...] = np.where(lost, 1.0, memory.hits + paired)
        memory.age_s[...] = np.where(paired, 0.0, memory.age_s)
        self.probability = np.where(paired, self._seen_probability(), self.probability)
        if by_camera:
            self._name(paired, of(seen.label))
            self.place = np.where(paired, of(seen.place), self.place)

    def _name(self, which: np.ndarray, label: np.ndarray) -> None:
        """Boxes name tracks ``which``: what most of the latest say, people or vehicles. One box of
        a person does not make one of a car that two have shown."""
        same = (is_person(label) == is_person(self.label)) & (self.label > 0)
        votes = self.named + np.where(same, 1.0, -1.0)
        renamed = which & (same | (votes <= 0.0))
        votes = np.where(same, np.minimum(votes, NAMED_BOXES), np.where(votes <= 0.0, 1.0, votes))
        self.named = np.where(which, votes, self.named)
        self.label = np.where(renamed, label, self.label)

    def _begin_along(
        self, other_part: np.ndarray, along_m: np.ndarray, sigma_m: np.ndarray, grown_m: np.ndarray
    ) -> None:
        """Forget the place along of tracks of which another part is seen, nearer or further away by
        more than noise and by no more than the width has changed: a corner and the whole of a car
        that stands aslant. Their speed stays as it was known, or unknown."""
        elsewhere = other_part & (np.abs(along_m) > PART_SIGMAS * sigma_m)
        elsewhere &= np.abs(along_m) <= grown_m
        self.p_xx = np.where(elsewhere, PLACE_UNKNOWN, self.p_xx)
        self.p_xv = np.where(elsewhere, 0.0, self.p_xv)

    def _begin_across(self, which: np.ndarray, middle_m: np.ndarray, variance: np.ndarray) -> None:
        """Slow tracks that are another thing now have not come across from where they were."""
        slow = (np.abs(self.vx_mps) < SLOW_MPS) & (np.abs(self.vy_mps) < SLOW_MPS)
        begins = which & slow & (self.q_vv < KNOWN_VARIANCE)
        speed = self._p.start_speed_mps * self._p.start_speed_mps
        self.from_y_m = np.where(begins, self.from_y_m + middle_m - self.y_m, self.from_y_m)
        self.y_m = np.where(begins, middle_m, self.y_m)
        self.q_xx = np.where(begins, variance, self.q_xx)
        self.q_xv = np.where(begins, 0.0, self.q_xv)
        self.q_vv = np.where(begins, SIDEWAYS_SHARE * speed, self.q_vv)

    def _sideways(
        self, x_m: np.ndarray, sigma_m: np.ndarray, width_m: np.ndarray, memory: SensorMemory
    ) -> np.ndarray:
        """Variance of a middle across: LiDAR sees all of what is narrow; a camera's grows with the
        error of its distance."""
        sigma: np.ndarray
        if memory is self.lidar:
            sigma = np.minimum(LATERAL_SIGMA_M, NARROW_SIGMA_M + NARROW_SHARE * width_m)
        elif memory is self.camera:
            sigma = LATERAL_SIGMA_M + 0.1 * sigma_m
        else:
            bearing = BEARING_SIGMA_RAD * x_m
            return bearing * bearing + LATERAL_SIGMA_M * LATERAL_SIGMA_M
        return sigma * sigma

    def _filter(
        self,
        which: np.ndarray,
        x_m: np.ndarray,
        y_m: np.ndarray,
        x_variance: np.ndarray,
        y_variance: np.ndarray,
    ) -> None:
        """Correct both axes of the tracks ``which`` by measured places."""
        names = (
            ("x_m", "vx_mps", "p_xx", "p_xv", "p_vv"),
            ("y_m", "vy_mps", "q_xx", "q_xv", "q_vv"),
        )
        for axis, measured, variance in zip(
            names, (x_m, y_m), (x_variance, y_variance), strict=True
        ):
            place, speed, xx, xv, vv = (getattr(self, name) for name in axis)
            total = xx + variance
            gain, gain_v = xx / total, xv / total
            residual = measured - place
            keep = 1.0 - gain
            values = (
                *(place + gain * residual, speed + gain_v * residual),
                *(keep * xx, keep * xv, vv - gain_v * xv),
            )
            for name, old, new in zip(axis, (place, speed, xx, xv, vv), values, strict=True):
                setattr(self, name, np.where(which, new, old))

    def _speeds_known(self) -> np.ndarray:
        known: np.ndarray = (self.p_vv < KNOWN_VARIANCE) & (self.q_vv < KNOWN_VARIANCE)
        return known

    def _turn(
        self, which: np.ndarray, known: np.ndarray, vx_mps: np.ndarray, vy_mps: np.ndarray
    ) -> None:
        """Correct turn rates by what a correction turned the velocity, which was given before.

        While a track turns faster than is known, every correction turns its velocity on, and
        their sum is what is missing: an integral beside the filter of the velocity. What corrects
        a velocity that was not ``known`` before is its first estimate, and no turn.
        """
        cross = vx_mps * self.vy_mps - vy_mps * self.vx_mps
        square = self.vx_mps * self.vx_mps + self.vy_mps * self.vy_mps
        fast = which & (square > TURNS_FROM_MPS * TURNS_FROM_MPS)
        turned = np.where(known, cross / np.where(fast, square, 1.0), 0.0)
        turn = np.clip(self.turn_radps + TURN_PER_S * turned, -TURN_MAX_RADPS, TURN_MAX_RADPS)
        self.turn_radps = np.where(fast, turn, np.where(which, 0.0, self.turn_radps))

    def _measure_speed(
        self,
        which: np.ndarray,
        radial_mps: np.ndarray,
        sigma_mps: np.ndarray,
        ray_y: np.ndarray,
    ) -> None:
        """Correct tracks by a radial speed over ground, the velocity's part along the ray, whose
        direction has the sine ``ray_y``. One that is far from a track's is of a wheel, or of
        something beside it, or the track's velocity is wrong (:attr:`agrees`). What corrections of
        a known speed add up to is an acceleration, as in :meth:`_turn`."""
        ray_x = np.sqrt(1.0 - ray_y * ray_y)
        known = self.p_vv < KNOWN_VARIANCE
        least = np.where(which & ~known, sideways_share(ray_y, radial_mps) * self.p_vv, 0.0)
        self.q_vv = np.maximum(self.q_vv, least)
        total = ray_x * ray_x * self.p_vv + ray_y * ray_y * self.q_vv + sigma_mps * sigma_mps
        residual = radial_mps - ray_x * self.vx_mps - ray_y * self.vy_mps
        fits = ~known | (residual * residual < SPEED_GATE * total)
        self.agrees = np.where(
            which, self.agrees + INSIDE_SHARE * (fits - self.agrees), self.agrees
        )
        which = which & fits
        share = np.where(which, residual, 0.0) / total
        accel = self.accel_mps2 + ACCEL_PER_S * ray_x * self.p_vv * share
        accel = np.clip(accel, -ACCEL_MAX_MPS2, ACCEL_MAX_MPS2)
        self.accel_mps2 = np.where(which & known, accel, self.accel_mps2)
        for ray, names in (
            (ray_x, ("x_m", "vx_mps", "p_xx", "p_xv", "p_vv")),
            (ray_y, ("y_m", "vy_mps", "q_xx", "q_xv", "q_vv")),
        ):
            place, speed, xx, xv, vv = (getattr(self, name) for name in names)
            less = ray * ray / total
            values = (
                *(place + ray * xv * share, speed + ray * vv * share),
                *(xx - less * xv * xv, xv - less * xv * vv, vv - less * vv * vv),
            )
            for name, old, new in zip(names, (place, speed, xx, xv, vv), values, strict=True):
                setattr(self, name, np.where(which, new, old))

    def _seen_probability(self) -> np.ndarray:
        """Bayes' rule after a sighting."""
        there = self.probability * self._p.detection
        probability = there / (there + (1.0 - self.probability) * self._p.clutter)
        return np.minimum(probability, PROBABILITY_MAX)

    def _missed(self, memory: SensorMemory, pair: np.ndarray, looked: np.ndarray) -> None:
        """Bayes' rule after a sweep without a sighting, for tracks that this sensor has seen and no
        other one sees; what is improbable, old or behind is forgotten."""
        others = [m.age_s for m in (self.camera, self.lidar, self.radar) if m is not memory]
        missed = self.live & looked[:, None] & (pair < 0) & (memory.hits > 0.0)
        missed &= np.minimum(*others) > VOUCHED_S
        there = self.probability * (1.0 - self._p.detection)
        probability = there / (there + (1.0 - self.probability) * (1.0 - self._p.clutter))
        self.probability = np.where(missed, probability, self.probability)
        youngest = np.minimum(np.minimum(self.camera.age_s, self.lidar.age_s), self.radar.age_s)
        gone = (self.probability < self._p.dead) | (youngest > self._p.memory_s)
        self.live &= ~(gone | (self.x_m < BEHIND_M))

    def _begin(
        self, seen: Sightings, memory: SensorMemory, pair: np.ndarray, looked: np.ndarray
    ) -> None:
        """Tracks of sightings that no track has, in their order, in the free places. Beside the
        road only LiDAR begins them: radar also sees mirrors there."""
        taken = np.zeros(seen.valid.shape, bool)
        rows, tracks = np.nonzero(pair >= 0)
        taken[rows, pair[rows, tracks]] = True
        new = seen.valid & ~taken
        if memory is not self.lidar:
            new &= ~seen.beside
        new &= looked[:, None]
        if not new.any():
            return
        free = np.count_nonzero(~self.live, axis=1)[:, None]
        left = free - (np.cumsum(new, axis=1) - 1)
        new &= left > np.where(seen.beside, PLACES_KEPT, 0)
        slot, fresh = np.nonzero(new)
        places = np.argsort(self.live, axis=1, kind="stable")  # the free ones first
        at = places[slot, np.cumsum(new, axis=1)[slot, fresh] - 1]
        self._start(slot, at, fresh, seen, memory)

    def _start(
        self,
        slot: np.ndarray,
        at: np.ndarray,
        fresh: np.ndarray,
        seen: Sightings,
        memory: SensorMemory,
    ) -> None:
        """New tracks: each has a slot, its place there and its place among the sightings."""
        camera = memory is self.camera
        sigma = seen.sigma_m[slot, fresh]
        right, left = seen.right_m[slot, fresh], seen.left_m[slot, fresh]
        speed = self._p.start_speed_mps * self._p.start_speed_mps
        radial = seen.radial_mps[slot, fresh]
        told = np.isfinite(radial)
        told_sigma = np.minimum(seen.radial_sigma_mps[slot, fresh], self._p.start_speed_mps)
        # Who comes from the side is as fast across as others are along the road.
        ray_y = seen.ray_y[slot, fresh]
        sideways = np.where(seen.beside[slot, fresh], 1.0, sideways_share(ray_y, radial)) * speed
        ray_x = np.sqrt(1.0 - ray_y * ray_y)
        values = {
            "x_m": seen.x_m[slot, fresh],
            "y_m": 0.5 * (left + right),
            "vx_mps": np.where(told, ray_x * radial, 0.0),
            "vy_mps": np.where(told, ray_y * radial, 0.0),
            "p_xx": sigma * sigma,
            "p_xv": 0.0,
            # What the speed across adds along the ray is not known yet.
            "p_vv": np.where(told, told_sigma * told_sigma + ray_y * ray_y * sideways, speed),
            "q_xx": self._sideways(seen.x_m[slot, fresh], sigma, left - right, memory),
            "q_xv": 0.0,
            "q_vv": sideways,
            "right_m": 0.5 * (right - left),
            "left_m": 0.5 * (left - right),
            "path_m": seen.path_x_m[slot, fresh] - seen.x_m[slot, fresh],
            "probability": self._p.born,
            "age_s": 0.0,
            "turn_radps": 0.0,
            "accel_mps2": 0.0,
            "agrees": 1.0,
            "steady": 1.0,
            "radial_mps": np.where(told, radial, 0.0),
            "live": True,
            "label": seen.label[slot, fresh],
            "named": 1.0 if camera else 0.0,
            "place": seen.place[slot, fresh] if camera else -1,
        }
        for name, value in values.items():
            getattr(self, name)[slot, at] = value
        self.ends.begin(slot, at, right, left, memory is self.lidar)
        for other in (self.camera, self.lidar, self.radar):
            other.age_s[slot, at], other.hits[slot, at], other.inside[slot, at] = 1e9, 0.0, 0.0
        memory.age_s[slot, at], memory.hits[slot, at] = 0.0, 1.0
        memory.inside[slot, at] = INSIDE_SHARE * seen.inside[slot, fresh]
