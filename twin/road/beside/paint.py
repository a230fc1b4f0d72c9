"""Paint of crosswalks and parking spaces, a little above the lanes.

Stripes of a crosswalk are 0.5 m wide with gaps of 0.5 m and lie along the road (RMS 1993, sign
293); a parking space has a line of 0.12 m inside its outline.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from twin.road.beside.bodies import OutlineBody, RoadsideBody, StandingBody, body_axes
from twin.road.beside.polygons import band_of, signed_area, triangles_of
from twin.road.opendrive.road_frame import RoadFrame, lane_heights
from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.mark_strips import ABOVE_M
from twin.road.surface.patch import SurfacePatch

STRIPE_M = 0.5
"""Width of a stripe and of a gap of a crosswalk [m]."""
LINE_M = 0.12
"""Width of the line around a parking space [m]."""
STRIPES_MAX = 1000
"""Most stripes of one crosswalk; the others are left out."""
PAINTED = frozenset({"crosswalk", "parkingSpace"})
"""Types of objects that are paint and nothing else."""
_CUT_M = 4.0
"""Longest piece of a line: paint follows the road [m]."""


def object_paint(roads: RoadMap, body: RoadsideBody) -> list[SurfacePatch]:
    """The paint of a body whose type is painted; empty: it has no area."""
    frame = roads.frames[body.road]
    ring = _ring(body)
    if ring is None:
        return []
    if body.thing.type == "crosswalk":
        parts = list(_stripes(frame, body, ring))
    else:
        parts = list(_border(ring))
    patches = []
    for part in parts:
        faces = triangles_of(part)
        points = _on_road(frame, body.thing.s_m, part)
        if len(faces):
            patches.append(SurfacePatch("mark", "white", points, faces))
    return patches


def _ring(body: RoadsideBody) -> np.ndarray | None:
    """Ground plan in the world, counterclockwise [N, 2]."""
    if isinstance(body, OutlineBody):
        ring = body.base_m[:, :2]
    elif isinstance(body, StandingBody):
        half = 0.5 * np.array(body.size_m[:2])
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
        axes = body_axes(body.heading_rad, 0.0, 0.0)[:2, :2]
        ring = np.array(body.position_m[:2]) + corners @ axes
    else:
        ring = np.concatenate([body.right_m[:, :2], body.left_m[::-1, :2]])
    area = signed_area(ring)
    if len(ring) < 3 or abs(area) < 1e-4:
        return None
    return ring if area > 0.0 else ring[::-1]


def _stripes(frame: RoadFrame, body: RoadsideBody, ring: np.ndarray) -> Iterator[np.ndarray]:
    s = min(body.thing.s_m, frame.road.length_m)
    axes = body_axes(float(frame.pose(s).heading_rad), 0.0, 0.0)[:2, :2]
    local = ring @ axes.T
    low, high = local[:, 1].min(), local[:, 1].max()
    count = min(int((high - low + STRIPE_M) / (2.0 * STRIPE_M) + 1e-9), STRIPES_MAX)
    first = 0.5 * (low + high) - (count - 0.5) * STRIPE_M
    for index in range(count):
        begin = first + 2.0 * STRIPE_M * index
        stripe = band_of(local, begin, begin + STRIPE_M)
        if len(stripe) >= 3:
            yield stripe @ axes


def _border(ring: np.ndarray) -> Iterator[np.ndarray]:
    """Quadrilaterals inside the edges of a ring."""
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        way = b - a
        length = float(np.hypot(*way))
        if length < LINE_M:
            continue
        inward = np.array((-way[1], way[0])) / length * LINE_M
        cuts = np.linspace(0.0, 1.0, min(int(length / _CUT_M) + 2, 1000))
        for low, high in pairwise(cuts.tolist()):
            c, d = a + low * way, a + high * way
            yield np.array([c, d, d + inward, c + inward])


def _on_road(frame: RoadFrame, near_s_m: float, ring: np.ndarray) -> np.ndarray:
    """Points [N, 3] above the lanes at places of the plane [N, 2]."""
    place = frame.locate(ring[:, 0], ring[:, 1], near_s_m=np.full(len(ring), near_s_m))
    height = lane_height(frame, place.s_m, place.t_m)
    pose = frame.pose(np.clip(place.s_m, 0.0, frame.road.length_m), place.t_m, height + ABOVE_M)
    return np.column_stack([ring, pose.z_m])


def lane_height(frame: RoadFrame, s_m: np.ndarray, t_m: np.ndarray) -> np.ndarray:
    """Heights of lanes above the road's surface at places, 0 beside them [N] [m]."""
    s, t = np.atleast_1d(s_m), np.atleast_1d(t_m)
    height = np.zeros(s.shape)
    lanes, sections = frame.lane_at(s, t), frame.section_at(s)
    for number, lane_id in sorted(set(zip(sections.tolist(), lanes.tolist(), strict=True))):
        section = frame.sections[number]
        lane = section.section.lane(lane_id) if lane_id else None
        if lane is None or not lane.heights:
            continue
        mine = (sections == number) & (lanes == lane_id)
        inner, outer = lane_heights(lane, s[mine] - section.section.start_m)
        inside = section.inner(lane_id, s[mine])[0]
        width = np.maximum(section.width(lane_id, s[mine]), 1e-9)
        share = np.clip(np.abs(t[mine] - inside) / width, 0.0, 1.0)
        height[mine] = inner + (outer - inner) * share
    return height
