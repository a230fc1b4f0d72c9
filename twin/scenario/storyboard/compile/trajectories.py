"""Trajectories: polylines, clothoids, splines of clothoids and NURBS become pieces.

Along a polyline without orientations the heading is that of the segment; between two vertices with
orientations it turns evenly. Clothoids and NURBS head along the curve.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from twin.road.opendrive.grid import angle_of
from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
    only_child,
)
from twin.scenario.storyboard.compile.curves import (
    cut,
    end_of,
    place_on,
    spiral,
    trajectory_piece,
)
from twin.scenario.storyboard.compile.nurbs import NurbsCurve
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.places import FixedPosition, Trajectory, TrajectoryPiece

_ORIGIN = FixedPosition(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class TrajectoryShape:
    """Pieces of a shape, before they belong to a trajectory."""

    pieces: tuple[TrajectoryPiece, ...]
    timed: bool
    from_actor: bool = False


def _trajectory(element: ScenarioElement, context: Compilation) -> Trajectory:
    shape_element = element.first("Shape")
    assert shape_element is not None
    leaf = only_child(shape_element)
    shape: TrajectoryShape = context.compile(leaf)
    if not shape.pieces:
        raise RefusalError(leaf, "it has no length")
    closed = bool(element.values["closed"])
    pieces = shape.pieces
    if closed:
        pieces = _closed(leaf, shape)
    return Trajectory(element.label, closed, shape.timed, pieces, shape.from_actor)


def _closed(element: ScenarioElement, shape: TrajectoryShape) -> tuple[TrajectoryPiece, ...]:
    """Pieces with a straight one back to the first, if the ends are apart."""
    first, last = shape.pieces[0], shape.pieces[-1]
    start = (first.x[0], first.y[0], first.z[0])
    there = end_of(last)
    end = (there.x_m, there.y_m, there.z_m)
    gap = math.dist(start, end)
    if gap < 1e-6:
        return shape.pieces
    if shape.timed:
        raise RefusalError(element, "a closed trajectory with times must end where it begins")
    return (*shape.pieces, _straight(last.start_s_m + last.length_m, end, start))


def _straight(
    start_s_m: float,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    heading: tuple[float, float] | None = None,
    time: tuple[float, float] = (0.0, 0.0),
) -> TrajectoryPiece:
    length = math.dist(start, end)
    x, y, z = (
        (a, (b - a) / length if length else 0.0, 0.0, 0.0) for a, b in zip(start, end, strict=True)
    )
    if heading is None:
        along = _direction(end[0] - start[0], end[1] - start[1])
        turn = (along, 0.0, 0.0, 0.0)
    else:
        difference = math.remainder(heading[1] - heading[0], 2.0 * math.pi)
        turn = (heading[0], difference / length if length else 0.0, 0.0, 0.0)
    return TrajectoryPiece(start_s_m, length, x, y, z, turn, time[0], time[1])


def _polyline(element: ScenarioElement, context: Compilation) -> TrajectoryShape:
    vertices = element.all("Vertex")
    places: list[FixedPosition] = []
    headings: list[float | None] = []
    for vertex in vertices:
        position = vertex.first("Position")
        assert position is not None
        place = context.fixed(position)
        leaf = only_child(position)
        given = leaf.first("Orientation") is not None or "h" in leaf.values
        places.append(place)
        headings.append(place.heading_rad if given else None)
    times = _times(element, vertices)
    pieces: list[TrajectoryPiece] = []
    s = 0.0
    for index, (one, other) in enumerate(itertools.pairwise(places)):
        start, end = (one.x_m, one.y_m, one.z_m), (other.x_m, other.y_m, other.z_m)
        span = (times[index], times[index + 1] - times[index]) if times else (0.0, 0.0)
        if start == end and span[1] == 0.0:
            continue
        along = _direction(end[0] - start[0], end[1] - start[1])
        turn = None
        first, second = headings[index], headings[index + 1]
        if start == end:
            stands = first if first is not None else pieces[-1].heading[0] if pieces else 0.0
            turn = (stands, stands)
        elif first is not None or second is not None:
            turn = (along if first is None else first, along if second is None else second)
        pieces.append(_straight(s, start, end, turn, span))
        s += pieces[-1].length_m
    return TrajectoryShape(tuple(pieces), bool(times))


def _times(element: ScenarioElement, vertices: list[ScenarioElement]) -> list[float]:
    """Times of vertices, none if no vertex has one."""
    timed = [vertex for vertex in vertices if "time" in vertex.values]
    if not timed:
        return []
    if len(timed) < len(vertices):
        raise RefusalError(element, "either every vertex has a time or none has")
    times = [float(vertex.values["time"]) for vertex in vertices]
    for vertex, (one, other) in zip(vertices[1:], itertools.pairwise(times), strict=True):
        if other < one:
            raise RefusalError(
                vertex, f"its time {other:g} s is before that of the vertex before it"
            )
    return times


def _clothoid(element: ScenarioElement, context: Compilation) -> TrajectoryShape:
    position = element.first("Position")
    assert position is not None
    start = context.fixed(position)
    rate = number_of(element, "curvaturePrime", number_of(element, "curvatureDot", 0.0))
    curvature, length = float(element.values["curvature"]), float(element.values["length"])
    if not 0.0 < length < 1e6:
        raise RefusalError(element, f"length is {length:g} m, it must be above 0 and below 1e6")
    pieces = spiral(start, (curvature, curvature + rate * length), length, 0.0)
    begin, end = element.values.get("startTime"), element.values.get("stopTime")
    if (begin is None) != (end is None):
        raise RefusalError(element, "give both startTime and stopTime, or neither")
    if begin is None or end is None:
        return TrajectoryShape(pieces, False)
    if not float(end) > float(begin):
        raise RefusalError(element, "stopTime must be after startTime")
    return TrajectoryShape(_spread(pieces, float(begin), float(end)), True)


def _clothoid_spline(element: ScenarioElement, context: Compilation) -> TrajectoryShape:
    segments = element.all("ClothoidSplineSegment")
    times = _spline_times(element, segments)
    first = segments[0].first("PositionStart")
    place = _ORIGIN if first is None else context.fixed(first)
    pieces: list[TrajectoryPiece] = []
    s = 0.0
    for index, segment in enumerate(segments):
        start = segment.first("PositionStart")
        if index and start is not None:
            place = context.fixed(start)
        place = replace(place, heading_rad=place.heading_rad + number_of(segment, "hOffset", 0.0))
        ends = float(segment.values["curvatureStart"]), float(segment.values["curvatureEnd"])
        length = float(segment.values["length"])
        if not 0.0 <= length < 1e6:
            raise RefusalError(
                segment, f"length is {length:g} m, it must be 0 or more and below 1e6"
            )
        if length == 0.0:
            continue
        stretch = spiral(place, ends, length, s)
        if times:
            stretch = _spread(stretch, times[index], times[index + 1])
        pieces += stretch
        s += length
        place = end_of(stretch[-1])
    return TrajectoryShape(tuple(pieces), bool(times), from_actor=first is None)


def _spline_times(element: ScenarioElement, segments: list[ScenarioElement]) -> list[float]:
    given = [segment.values.get("timeStart") for segment in segments]
    given.append(element.values.get("timeEnd"))
    times = [float(time) for time in given if time is not None]
    if not times:
        return []
    if len(times) < len(given):
        raise RefusalError(element, "give timeStart of every segment and timeEnd, or none of them")
    if any(not other > one for one, other in itertools.pairwise(times)):
        raise RefusalError(element, "times must rise from segment to segment")
    return times


def _spread(
    pieces: tuple[TrajectoryPiece, ...], begin_s: float, end_s: float
) -> tuple[TrajectoryPiece, ...]:
    """Pieces with times: an even speed from the first to the last."""
    start = pieces[0].start_s_m
    per_metre = (end_s - begin_s) / math.fsum(piece.length_m for piece in pieces)
    return tuple(
        replace(
            piece,
            start_time_s=begin_s + (piece.start_s_m - start) * per_metre,
            duration_s=piece.length_m * per_metre,
        )
        for piece in pieces
    )


def _nurbs(element: ScenarioElement, context: Compilation) -> TrajectoryShape:
    controls = element.all("ControlPoint")
    rows = []
    for control in controls:
        position = control.first("Position")
        assert position is not None
        place = context.fixed(position)
        rows.append((place.x_m, place.y_m, place.z_m, number_of(control, "weight", 1.0)))
    times = [control.values.get("time") for control in controls]
    timed = any(time is not None for time in times)
    if timed and any(time is None for time in times):
        raise RefusalError(element, "either every control point has a time or none has")
    try:
        curve = NurbsCurve(
            np.array(rows),
            np.array([float(knot.values["value"]) for knot in element.all("Knot")]),
            int(element.values["order"]),
            np.array([float(time or 0.0) for time in times]),
        )
        pieces = cut(curve.line, curve.stations)
    except ValueError as error:
        raise RefusalError(element, str(error)) from None
    out = [trajectory_piece(piece, 0.0) for piece in pieces]
    if timed:
        out = [_timed(piece, curve) for piece in out]
        if any(piece.duration_s < 0.0 for piece in out):
            raise RefusalError(element, "times of control points must not fall along the curve")
    return TrajectoryShape(tuple(out), timed)


def _timed(piece: TrajectoryPiece, curve: NurbsCurve) -> TrajectoryPiece:
    ends = curve.times(np.array([piece.start_s_m, piece.start_s_m + piece.length_m]))
    return replace(piece, start_time_s=float(ends[0]), duration_s=float(ends[1] - ends[0]))


def point_of(
    trajectory: Trajectory, s_m: float, element: ScenarioElement
) -> tuple[float, float, float, float]:
    """x, y, z and the heading of the line at a distance from the beginning of a trajectory."""
    last = trajectory.pieces[-1]
    end = last.start_s_m + last.length_m
    if not -1e-6 <= s_m <= end + 1e-6:
        raise RefusalError(element, f"s={s_m:g} m on a trajectory of {end:g} m")
    piece = next((p for p in reversed(trajectory.pieces) if p.start_s_m <= s_m), None)
    piece = piece or trajectory.pieces[0]
    ahead = s_m - piece.start_s_m
    place = place_on(piece, ahead)
    dx, dy = (c[1] + ahead * (2.0 * c[2] + 3.0 * ahead * c[3]) for c in (piece.x, piece.y))
    heading = _direction(dx, dy) if dx or dy else piece.heading[0]
    return place.x_m, place.y_m, place.z_m, heading


def _direction(dx: float, dy: float) -> float:
    return float(angle_of(np.array(dy), np.array(dx)))


TRAJECTORIES: dict[str, Handler] = {
    "Trajectory": _trajectory,
    "Polyline": _polyline,
    "Clothoid": _clothoid,
    "ClothoidSpline": _clothoid_spline,
    "Nurbs": _nurbs,
}
"""Handlers of trajectories and their shapes by element type."""
