"""Objects of a road file -> bodies in the world (ASAM OpenDRIVE 1.8, section 13).

An object stands on the road's surface at its s and t, raised by its zOffset; its heading counts
from the direction of the reference line. A row (``repeat``) takes the place of the object itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from twin.road.beside.bodies import (
    OutlineBody,
    RoadsideBody,
    StandingBody,
    SweptBody,
    body_axes,
)
from twin.road.opendrive.furniture import ObjectOutline, ObjectRepeat, RoadObject, copies_of
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap

BODIES_MAX = 50_000
"""Most bodies of a network."""
CHORD_M = 0.009
"""Largest distance between a body drawn along a road and its chords; 1 cm is promised [m]."""
REACH_MAX_M = 16_000
"""Farthest that a body may lie from the world's origin [m]."""
SIZE_MAX_M = 2_000
"""Largest box or cylinder, and longest edge of an outline [m]."""
STEP_M = 12.0
"""Longest piece of one [m]."""
POINTS_MAX = 100_000
"""Most places along one."""
_THIN_M = 0.1
"""Width of a body drawn along a road that has none [m]."""


def roadside_bodies(roads: RoadMap) -> list[RoadsideBody]:
    """The bodies of all objects, road by road in the order of the file.

    Raises:
        ValueError: there are too many; one line.
    """
    things = [thing for road in roads.network.roads.values() for thing in road.objects]
    rows = [row for thing in things for row in thing.repeats]
    count = sum(not thing.repeats for thing in things)
    count += sum(copies_of(row) if row.distance_m > 0.0 else 1 for row in rows)
    if count > BODIES_MAX:
        raise ValueError(
            f"{roads.network.file}: {count} objects beside its roads, at most {BODIES_MAX} are "
            "shown; use a part of it"
        )
    bodies: list[RoadsideBody] = []
    for frame in roads.frames.values():
        for thing in frame.road.objects:
            try:
                for body in _bodies(frame, thing):
                    _check_reach(body)
                    bodies.append(body)
            except ValueError as error:
                raise ValueError(f"{roads.network.file}:{thing.line}: <object>: {error}") from None
    return bodies


def _check_reach(body: RoadsideBody) -> None:
    """Refuse an object that reaches too far.

    Raises:
        ValueError: it is too large, or too far away; without its place in the file.
    """
    if isinstance(body, StandingBody):
        places, size = np.array([body.position_m]), max(*body.size_m, 2.0 * body.radius_m)
    elif isinstance(body, OutlineBody):
        places = body.base_m
        edges = np.abs(np.diff(places, axis=0, append=places[:1]))
        size = max(float(edges.max()), float(body.height_m.max()))
    else:
        places = np.concatenate([body.left_m, body.right_m])
        size = max(float(np.abs(body.left_m - body.right_m).max()), float(body.height_m.max()))
    if size > SIZE_MAX_M:
        raise ValueError(f"{size:g} m large, at most {SIZE_MAX_M} m are shown")
    reach = float(np.abs(places).max())
    if reach > REACH_MAX_M:
        raise ValueError(f"it reaches {reach:.0f} m from the origin, at most {REACH_MAX_M} m")


def _bodies(frame: RoadFrame, thing: RoadObject) -> Iterator[RoadsideBody]:
    if not thing.repeats:
        if thing.outlines:
            yield from _outlined(frame, thing, thing.outlines, _origin(frame, thing))
        else:
            yield _standing(frame, thing)
        return
    fixed = [outline for outline in thing.outlines if _on_road(outline)]
    yield from _outlined(frame, thing, fixed, _origin(frame, thing))
    turning = [outline for outline in thing.outlines if not _on_road(outline)]
    first = 0
    for row in thing.repeats:
        if row.distance_m <= 0.0 < row.length_m:
            yield _swept(frame, thing, row)
            continue
        copies = list(_copies(frame, thing, row, first))
        first += len(copies)
        for copy in copies:
            if turning:
                yield from _outlined(frame, thing, turning, copy)
            elif not fixed:
                yield copy


def _on_road(outline: ObjectOutline) -> bool:
    return any(corner.frame == "road" for corner in outline.corners)


def _origin(frame: RoadFrame, thing: RoadObject) -> StandingBody:
    return _standing(frame, thing)


def _standing(frame: RoadFrame, thing: RoadObject) -> StandingBody:
    size = thing.length_m, thing.width_m, thing.height_m
    return _at(frame, thing, (thing.s_m, thing.t_m, thing.z_offset_m), size, thing.radius_m, 0)


def _at(
    frame: RoadFrame,
    thing: RoadObject,
    place: tuple[float, float, float],
    size_m: tuple[float, float, float],
    radius_m: float,
    number: int,
) -> StandingBody:
    s, t, z_offset = place
    pose = frame.pose(min(s, frame.road.length_m), t)
    return StandingBody(
        thing,
        frame.road.id,
        (float(pose.x_m), float(pose.y_m), float(pose.z_m) + z_offset),
        float(pose.heading_rad) + thing.heading_rad,
        thing.pitch_rad,
        thing.roll_rad,
        size_m,
        radius_m,
        z_offset,
        float(pose.heading_rad) + (-0.5 if t > 0.0 else 0.5) * np.pi,
        number,
    )


def _copies(
    frame: RoadFrame, thing: RoadObject, row: ObjectRepeat, first: int
) -> Iterator[StandingBody]:
    """The copies of a row; one that has neither length nor distance is a single copy."""
    count = copies_of(row) if row.distance_m > 0.0 else 1
    for index in range(count):
        ahead = min(index * row.distance_m, row.length_m)
        share = ahead / row.length_m if row.length_m > 0.0 else 0.0

        def now(pair: tuple[float, float], share: float = share) -> float:
            return pair[0] + (pair[1] - pair[0]) * share

        place = row.s_m + ahead, now(row.t_m), now(row.z_offset_m)
        length, width, height = (now(pair) for pair in row.size_m)
        size = length, width, height
        yield _at(frame, thing, place, size, now(row.radius_m), first + index)


def _outlined(
    frame: RoadFrame,
    thing: RoadObject,
    outlines: tuple[ObjectOutline, ...] | list[ObjectOutline],
    origin: StandingBody,
) -> Iterator[OutlineBody]:
    axes = body_axes(origin.heading_rad, origin.pitch_rad, origin.roll_rad)
    for outline in outlines:
        if len(outline.corners) < 2:
            continue
        base = np.zeros((len(outline.corners), 3))
        for index, corner in enumerate(outline.corners):
            if corner.frame == "road":
                s, t, dz = corner.position
                pose = frame.pose(min(s, frame.road.length_m), t)
                base[index] = float(pose.x_m), float(pose.y_m), float(pose.z_m) + dz
            else:
                base[index] = np.array(origin.position_m) + np.array(corner.position) @ axes
        above = [
            corner.position[2] + (origin.above_m if corner.frame == "local" else 0.0)
            for corner in outline.corners
        ]
        heights = np.array([max(corner.height_m, 0.0) for corner in outline.corners])
        # Some files name the first corner again at the end.
        if len(base) > 2 and np.abs(base[0] - base[-1]).max() < 1e-6:
            base, heights = base[:-1], heights[:-1]
        closed = outline.closed and len(base) > 2
        yield OutlineBody(thing, frame.road.id, base, heights, min(above), closed)


def _swept(frame: RoadFrame, thing: RoadObject, row: ObjectRepeat) -> SweptBody:
    def edges(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        share = (s - row.s_m) / row.length_m
        t, z, width, height, radius = (
            begin + (end - begin) * share
            for begin, end in (row.t_m, row.z_offset_m, *row.size_m[1:], row.radius_m)
        )
        half = 0.5 * np.where(width > 0.0, width, np.where(radius > 0.0, 2.0 * radius, _THIN_M))
        sides = []
        for aside in (half, -half):
            pose = frame.pose(s, t + aside)
            sides.append(np.stack([pose.x_m, pose.y_m, pose.z_m + z], axis=1))
        return sides[0], sides[1], np.where(height > 0.0, height, 2.0 * radius)

    end = min(row.s_m + row.length_m, frame.road.length_m)
    knots = [piece.start_m for piece in frame.road.geometry]
    knots += [cubic.start_m for cubic in (*frame.road.elevation, *frame.road.superelevation)]
    inside = sorted({row.s_m, end, *(s for s in knots if row.s_m < s < end)})
    parts = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / STEP_M))), endpoint=False)
        for a, b in pairwise(inside)
    ]
    s = np.concatenate([*parts, [end]])
    while True:
        left, right, height = edges(s)
        middle = edges(0.5 * (s[:-1] + s[1:]))
        off = np.zeros(len(s) - 1, bool)
        for line, exact in ((left, middle[0]), (right, middle[1])):
            off |= np.abs(exact - 0.5 * (line[:-1] + line[1:])).max(axis=1) > CHORD_M
        off &= np.diff(s) > 0.05
        if not off.any():
            return SweptBody(thing, frame.road.id, left, right, height, min(row.z_offset_m))
        s = np.sort(np.append(s, 0.5 * (s[:-1] + s[1:])[off]))
        if len(s) > POINTS_MAX:
            raise ValueError(f"it would have more than {POINTS_MAX} places along the road")
