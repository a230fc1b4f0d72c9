"""The coordinates of a road: world places from s, t, h and from lanes, and back.

At station s the cross section stands upright on the plane tangent of the reference line. In it the
t axis is turned by the superelevation a about the reference line, to the left upwards if positive,
and h is perpendicular to t. With r(s) the reference line in the plane, n its normal to the left and
e(s) the elevation (ASAM OpenDRIVE 1.8, sections 8 and 10)::

    (x, y) = r + (t cos a - h sin a) n        z = e + t sin a + h cos a

From the inner border of a level lane outwards the surface is level across, and h is vertical.
Heading, pitch and roll are those of a body that lies on the surface and points along s, or along
the middle of a lane; right-handed as in ISO 8855: heading about z, then pitch about y (down is
positive), then roll about x (to the right is positive).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.road.opendrive.cross_section import CrossSection
from twin.road.opendrive.grid import angle_of, cosine, settled, sine, turned
from twin.road.opendrive.profile import CubicProfile
from twin.road.opendrive.records import Lane, RoadRecord
from twin.road.opendrive.reference_line import LinePlace, reference_line

_SLOPE_MIN = 1e-6


class RoadPose(NamedTuple):
    """Poses in the world; arrays of one shape."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    heading_rad: np.ndarray
    """In [-pi, pi) [rad]."""
    pitch_rad: np.ndarray
    """Down is positive [rad]."""
    roll_rad: np.ndarray
    """To the right is positive [rad]."""


class RoadPlace(NamedTuple):
    """Places in the coordinates of a road; arrays of one shape."""

    s_m: np.ndarray
    t_m: np.ndarray
    h_m: np.ndarray
    """Above the surface; 0 where no height was given."""


class _Across(NamedTuple):
    """A place of a cross section: sideways and upwards, and how both change with s and t."""

    side: np.ndarray
    up: np.ndarray
    side_s: np.ndarray
    up_s: np.ndarray
    side_t: np.ndarray
    up_t: np.ndarray


class RoadFrame:
    """The coordinates of one road.

    Raises:
        ValueError: its reference line has no direction somewhere.
    """

    def __init__(self, road: RoadRecord) -> None:
        self.road = road
        self.line = reference_line(road)
        offset = CubicProfile(road.lane_offset)
        self.sections = tuple(CrossSection(section, offset) for section in road.sections)
        self._starts = np.array([section.start_m for section in road.sections])
        self._elevation = CubicProfile(road.elevation)
        self._tilt = CubicProfile(road.superelevation)
        self._level = any(s.level_from(1) or s.level_from(-1) for s in self.sections)

    def section_at(self, s_m: float | np.ndarray) -> np.ndarray:
        """Indices of lane sections; a station between two belongs to the second."""
        found = np.searchsorted(self._starts, np.asarray(s_m, float), "right") - 1
        return np.maximum(found, 0)

    def curvature(self, s_m: float | np.ndarray) -> np.ndarray:
        """Curvature of the reference line, to the left positive [1/m]."""
        return self.line.at(s_m).curvature_per_m

    def pose(
        self,
        s_m: float | np.ndarray,
        t_m: float | np.ndarray = 0.0,
        h_m: float | np.ndarray = 0.0,
    ) -> RoadPose:
        """Places t to the left of and h above stations, headed along s; shapes that broadcast.

        Raises:
            ValueError: a station lies beyond the ends of the road.
        """
        s, t, h = (np.asarray(v, float) for v in np.broadcast_arrays(s_m, t_m, h_m))
        return self._pose(s, t, h, np.zeros(s.shape), np.zeros(s.shape), along_road=True)

    def lane_pose(
        self,
        lane_id: int | np.ndarray,
        s_m: float | np.ndarray,
        offset_m: float | np.ndarray = 0.0,
        *,
        with_traffic: bool = False,
    ) -> RoadPose:
        """Places ``offset_m`` to the left (in direction of s) of the middle of lanes.

        Args:
            lane_id, s_m, offset_m: shapes that broadcast; lane 0 is the centre line.
            with_traffic: head the way the lane is driven, not along s.

        Raises:
            ValueError: a station lies beyond the ends of the road, or has no such lane.
        """
        lanes, s, offset = np.broadcast_arrays(
            np.asarray(lane_id), np.asarray(s_m, float), np.asarray(offset_m, float)
        )
        t, slope, lift, cross, sign = (np.zeros(s.shape) for _ in range(5))
        for mine, section, lane in self._by_lane(lanes, s):
            at = s[mine]
            t[mine], slope[mine] = section.centre(lane, at)
            record = section.section.lane(lane)
            sign[mine] = -1.0 if record and traffic_sign(self.road, record) < 0 else 1.0
            if record and record.heights:
                inner, outer = lane_heights(record, at - section.section.start_m)
                width = np.maximum(section.width(lane, at), 1e-9)
                rise = (outer - inner) / width * (1.0 if lane > 0 else -1.0)
                lift[mine] = 0.5 * (inner + outer) + rise * offset[mine]
                cross[mine] = rise
        pose = self._pose(s, t + offset, lift, slope, cross)
        return _faced(pose, sign) if with_traffic else pose

    def lane_width(self, lane_id: int | np.ndarray, s_m: float | np.ndarray) -> np.ndarray:
        """Widths of lanes at stations; shapes that broadcast [m].

        Raises:
            ValueError: as :meth:`lane_pose`.
        """
        lanes, s = np.broadcast_arrays(np.asarray(lane_id), np.asarray(s_m, float))
        width = np.zeros(s.shape)
        for mine, section, lane in self._by_lane(lanes, s):
            width[mine] = section.width(lane, s[mine]) if lane else 0.0
        return settled(width)

    def lane_at(self, s_m: float | np.ndarray, t_m: float | np.ndarray) -> np.ndarray:
        """Ids of the lanes at places of the road, 0 where there is none."""
        s, t = np.broadcast_arrays(np.asarray(s_m, float), np.asarray(t_m, float))
        found = np.zeros(s.shape, int)
        index = self.section_at(s)
        for k in np.unique(index).tolist():
            mine = index == k
            found[mine] = self.sections[k].lane_at(s[mine], t[mine])
        return found

    def locate(
        self,
        x_m: float | np.ndarray,
        y_m: float | np.ndarray,
        z_m: float | np.ndarray | None = None,
        *,
        near_s_m: float | np.ndarray | None = None,
        within_m: float = 20.0,
    ) -> RoadPlace:
        """Where world points lie as seen from the road; shapes that broadcast.

        Args:
            x_m, y_m: of the points.
            z_m: None: on the surface.
            near_s_m: where they were before; None: anywhere on the road. It keeps a point on its
                branch where a road passes itself, and saves time on long roads.
            within_m: how far from there their stations may be [m].
        """
        points = (x_m, y_m) if z_m is None else (x_m, y_m, z_m)
        hint = () if near_s_m is None else (near_s_m,)
        arrays = [np.asarray(v, float) for v in np.broadcast_arrays(*points, *hint)]
        x, y = arrays[0], arrays[1]
        near = arrays[-1].ravel() if hint else None
        s = self.line.nearest(x.ravel(), y.ravel(), near, within_m).reshape(x.shape)
        place = self.line.at(s)
        side = place.cosine * (y - place.y_m) - place.sine * (x - place.x_m)
        angle, _ = self._tilt.at(s)
        c, si = cosine(angle), sine(angle)
        flat = z_m is None
        up = np.zeros(s.shape) if flat else arrays[2] - self._elevation.at(s)[0]
        t = np.array(side / c if flat else side * c + up * si)
        h = np.array(np.zeros(s.shape) if flat else up * c - side * si)
        if self._level:
            for mine, edge, _ in self._level_parts(s, side / c):
                at = self._across(s[mine], edge)
                t[mine] = edge + (side[mine] - at.side)
                h[mine] = 0.0 if flat else up[mine] - at.up
        return RoadPlace(s, settled(t), settled(h))

    def _by_lane(self, lanes: np.ndarray, s: np.ndarray):  # type: ignore[no-untyped-def]
        """Masks with the cross section and the lane id they have in common."""
        self.line.check(s)
        index = self.section_at(s)
        for k in np.unique(index).tolist():
            for lane in np.unique(lanes[index == k]).tolist():
                section = self.sections[k]
                mine = (index == k) & (lanes == lane)
                if lane != 0 and section.section.lane(lane) is None:
                    ids = ", ".join(str(each.id) for each in section.section.lanes)
                    at = s[mine].ravel()[0]
                    raise ValueError(
                        f"road {self.road.id[:40]} has no lane {lane} at s={at:g} m; it has {ids}"
                    )
                yield mine, section, lane

    def _level_parts(self, s: np.ndarray, t: np.ndarray):  # type: ignore[no-untyped-def]
        """Masks of places on level parts; t where the part begins, its slope along s."""
        index = self.section_at(s)
        for k in np.unique(index).tolist():
            for sign in (1, -1):
                lane = self.sections[k].level_from(sign)
                if not lane:
                    continue
                edge, slope = self.sections[k].inner(lane, s)
                mine = (index == k) & (sign * t > sign * edge)
                if mine.any():
                    yield mine, edge[mine], slope[mine]

    def _across(self, s: np.ndarray, t: np.ndarray) -> _Across:
        """Places of tilted cross sections."""
        angle, rate = self._tilt.at(s)
        c, si = cosine(angle), sine(angle)
        return _Across(t * c, t * si, -t * si * rate, t * c * rate, c, si)

    def _surface(self, s: np.ndarray, t: np.ndarray) -> _Across:
        """Places of the surface."""
        across = self._across(s, t)
        if not self._level:
            return across
        columns = [np.array(column) for column in across]
        for mine, edge, slope in self._level_parts(s, t):
            at = self._across(s[mine], edge)
            columns[0][mine] = at.side + (t[mine] - edge)
            columns[1][mine] = at.up
            columns[2][mine] = at.side_s + slope * (at.side_t - 1.0)
            columns[3][mine] = at.up_s + slope * at.up_t
            columns[4][mine] = 1.0
            columns[5][mine] = 0.0
        return _Across(*columns)

    def _pose(
        self,
        s: np.ndarray,
        t: np.ndarray,
        h: np.ndarray,
        slope: np.ndarray,
        rise: np.ndarray,
        *,
        along_road: bool = False,
    ) -> RoadPose:
        """Poses at s, t, h, headed along dt/ds = ``slope``, on lanes that rise by ``rise`` per
        metre to the left above the surface."""
        place: LinePlace = self.line.at(s)
        s = np.clip(s, 0.0, self.road.length_m)
        at = self._surface(s, t)
        elevation, climb = self._elevation.at(s)
        side = at.side - h * at.up_t
        x = place.x_m - side * place.sine
        y = place.y_m + side * place.cosine
        z = elevation + at.up + h * at.side_t
        # The plane that the ways along s and along t span, as slopes along and across the road.
        forward = 1.0 - place.curvature_per_m * at.side
        forward = np.where(np.abs(forward) < _SLOPE_MIN, _SLOPE_MIN, forward)
        to_left = at.up_t / at.side_t + rise
        ahead = (climb + at.up_s - to_left * at.side_s) / forward
        drift = np.zeros(s.shape) if along_road else at.side_s + slope * at.side_t
        bend = angle_of(drift, np.maximum(forward, _SLOPE_MIN))
        c, si = cosine(bend), sine(bend)
        pitch = -angle_of(ahead * c + to_left * si, np.ones(s.shape))
        roll = angle_of((to_left * c - ahead * si) * cosine(pitch), np.ones(s.shape))
        heading = settled(turned(place.heading_rad + bend))
        return RoadPose(settled(x), settled(y), settled(z), heading, pitch, roll)


def traffic_sign(road: RoadRecord, lane: Lane) -> int:
    """The way a lane is driven: 1 along s, -1 against it, 0 both."""
    if lane.direction == "both":
        return 0
    sign = -1 if (lane.id > 0) == (road.rule == "RHT") else 1
    return -sign if lane.direction == "reversed" else sign


def lane_heights(lane: Lane, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights above the road of a lane's inner and outer border, by way since its section begins;
    0 before the first [m]."""
    starts = np.array([height.start_m for height in lane.heights])
    rows = np.array([(0.0, 0.0), *((height.inner_m, height.outer_m) for height in lane.heights)])
    row = rows[np.searchsorted(starts, ahead, "right")]
    return row[..., 0], row[..., 1]


def _faced(pose: RoadPose, sign: np.ndarray) -> RoadPose:
    """Turned round where ``sign`` is below 0."""
    back = sign < 0.0
    heading = np.where(back, settled(turned(pose.heading_rad + np.pi)), pose.heading_rad)
    return RoadPose(*pose[:3], heading, pose.pitch_rad * sign, pose.roll_rad * sign)
