"""Lanes side by side: where their borders lie, and which lane lies where."""

from __future__ import annotations

import numpy as np

from twin.road.opendrive.profile import CubicProfile
from twin.road.opendrive.records import LaneSection


class CrossSection:
    """The borders of one lane section. Stations are those of the road; t to the left positive."""

    def __init__(self, section: LaneSection, offset: CubicProfile) -> None:
        self.section = section
        self._offset = offset
        self._profiles = {
            lane.id: (bool(lane.widths), CubicProfile(lane.widths or lane.borders))
            for lane in section.lanes
        }

    def outer(self, lane_id: int, s_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """t of the outer border of a lane, and its slope along s; lane 0: the centre."""
        t, slope = self._offset.at(s_m)
        base = t, slope
        sign = 1.0 if lane_id > 0 else -1.0
        ahead = s_m - self.section.start_m
        for number in range(1, abs(lane_id) + 1):
            by_width, profile = self._profiles[int(sign) * number]
            value, rate = profile.at(ahead)
            if by_width:
                rate = np.where(value < 0.0, 0.0, rate)
                t, slope = t + sign * np.maximum(value, 0.0), slope + sign * rate
            else:
                t, slope = base[0] + value, base[1] + rate
        return t, slope

    def borders(self, s_m: np.ndarray) -> dict[int, np.ndarray]:
        """t of the outer borders of all lanes, and of the centre (0), by lane id from the left to
        the right; as :meth:`outer`, but each computed from the one inside of it."""
        base = self._offset.at(s_m)[0]
        ahead = s_m - self.section.start_m
        sides = []
        for sign, lanes in ((1.0, self.section.left), (-1.0, self.section.right)):
            rows, t = {}, base
            for lane in lanes:
                by_width, profile = self._profiles[lane.id]
                value = profile.at(ahead)[0]
                t = t + sign * np.maximum(value, 0.0) if by_width else base + value
                rows[lane.id] = t
            sides.append(rows)
        left, right = sides
        return {**dict(reversed(left.items())), 0: base, **right}

    def inner(self, lane_id: int, s_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """t of the inner border of a lane, and its slope along s."""
        return self.outer(lane_id - 1 if lane_id > 0 else lane_id + 1, s_m)

    def centre(self, lane_id: int, s_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """t of the middle of a lane, and its slope along s; lane 0: the centre."""
        if lane_id == 0:
            return self.outer(0, s_m)
        inner, outer = self.inner(lane_id, s_m), self.outer(lane_id, s_m)
        return 0.5 * (inner[0] + outer[0]), 0.5 * (inner[1] + outer[1])

    def width(self, lane_id: int, s_m: np.ndarray) -> np.ndarray:
        """Width of a lane [m]."""
        inner, outer = self.inner(lane_id, s_m), self.outer(lane_id, s_m)
        width: np.ndarray = np.abs(outer[0] - inner[0])
        return width

    def lane_at(self, s_m: np.ndarray, t_m: np.ndarray) -> np.ndarray:
        """Ids of the lanes in which places lie, 0 where there is none; the centre line belongs to
        lane -1, other borders to the lane inside of them."""
        found = np.zeros(np.shape(s_m), int)
        base, _ = self.outer(0, s_m)
        for lane in self.section.lanes:
            outer, inner = self.outer(lane.id, s_m)[0], self.inner(lane.id, s_m)[0]
            if lane.id > 0:
                inside = (t_m > inner) & (t_m <= outer)
            else:
                inside = (t_m >= outer) & ((t_m < inner) | ((lane.id == -1) & (t_m == base)))
            found = np.where(inside & (found == 0), lane.id, found)
        return found

    def level_from(self, sign: int) -> int:
        """The innermost level lane of a side (1: left, -1: right), 0 if there is none; those
        outside of it are level with it."""
        side = self.section.left if sign > 0 else self.section.right
        return next((lane.id for lane in side if lane.level), 0)
