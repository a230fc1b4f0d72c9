"""Positions of OpenSCENARIO: those that depend on no moving entity are resolved here, once.

A position on a lane heads the way the lane is driven, one on a road along its reference line, one
on a route by road coordinates along the route. A relative orientation is added to that, an absolute
one stands alone.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from twin.road.opendrive.georeference import projection_of
from twin.road.opendrive.grid import cosine, sine
from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
    only_child,
)
from twin.scenario.storyboard.compile.routes import RoutePath
from twin.scenario.storyboard.compile.trajectories import point_of
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RelativeFrame,
    RelativePosition,
    Trajectory,
)

RELATIVE_SINCE = 3
"""Minor version from which an orientation without a type is relative."""


def _world(element: ScenarioElement, context: Compilation) -> FixedPosition:
    x, y = float(element.values["x"]), float(element.values["y"])
    given_z = element.values.get("z")
    heading, pitch, roll = (number_of(element, key, 0.0) for key in "hpr")
    z = None if given_z is None else float(given_z)
    return _in_the_world(context, x, y, z, (heading, pitch, roll))


def _in_the_world(
    context: Compilation,
    x: float,
    y: float,
    given_z: float | None,
    angles: tuple[float, float, float],
) -> FixedPosition:
    """A place of the world; without a height on the road below it."""
    heading, pitch, roll = angles
    z = given_z or 0.0
    if context.roads is None:
        return FixedPosition(x, y, z, heading, pitch, roll)
    under = context.roads.lane_under(x, y, given_z)
    road = int(under.road)
    if road < 0:
        return FixedPosition(x, y, z, heading, pitch, roll)
    s, t, lane = float(under.s_m), float(under.t_m), int(under.lane)
    frame = list(context.roads.frames.values())[road]
    if given_z is None:
        z = float(frame.pose(s, t).z_m)
    offset = t - _centre(frame, lane, s)
    return FixedPosition(x, y, z, heading, pitch, roll, road, s, t, lane, offset)


def _geo(element: ScenarioElement, context: Compilation) -> FixedPosition:
    """A place by latitude and longitude (``GeoPosition``), on the road there or so far above it.

    Coordinates of the road file are those of its projection less its offset. Angles without an
    orientation, and absolute ones, count from the x axis as those of a ``WorldPosition``.
    """
    network = context.road_map(element).network
    angles = [_angle(element, "latitude"), _angle(element, "longitude")]
    height_m = number_of(element, "altitude", number_of(element, "height", 0.0))
    off_x, off_y, _, turned = network.offset or (0.0, 0.0, 0.0, 0.0)
    if turned != 0.0:
        raise RefusalError(element, "the road file has an offset with hdg; only x, y, z are played")
    try:
        x, y = projection_of(network.geo_reference).place(*angles)
    except ValueError as error:
        raise RefusalError(element, str(error)) from None
    place = _in_the_world(context, x - off_x, y - off_y, None, (0.0, 0.0, 0.0))
    return oriented(context, element, replace(place, z_m=place.z_m + height_m))


def _angle(element: ScenarioElement, name: str) -> float:
    """Latitude or longitude [rad]: in degrees since version 1.2, in radians before."""
    given = [key for key in (f"{name}Deg", name) if key in element.values]
    if len(given) != 1:
        raise RefusalError(element, f"give either {name}Deg or {name}")
    value = float(element.values[given[0]])
    return math.radians(value) if given[0].endswith("Deg") else value


def road_position(
    context: Compilation, element: ScenarioElement, road_id: str, s_m: float, t_m: float
) -> FixedPosition:
    """A place of a road, headed along it."""
    roads = context.road_map(element)
    try:
        frame = roads.frame(road_id)
        pose = frame.pose(s_m, t_m)
    except ValueError as error:
        raise RefusalError(element, str(error)) from None
    lane = int(frame.lane_at(s_m, t_m))
    number, offset = context.road_numbers[road_id], t_m - _centre(frame, lane, s_m)
    x, y, z, heading, pitch, roll = map(float, pose)
    return FixedPosition(x, y, z, heading, pitch, roll, number, s_m, t_m, lane, offset)


def lane_position(
    context: Compilation,
    element: ScenarioElement,
    road_id: str,
    lane: int,
    s_m: float,
    offset_m: float,
) -> FixedPosition:
    """A place of a lane, headed the way it is driven."""
    roads = context.road_map(element)
    try:
        frame = roads.frame(road_id)
        pose = frame.lane_pose(lane, s_m, offset_m, with_traffic=True)
    except ValueError as error:
        raise RefusalError(element, str(error)) from None
    t = _centre(frame, lane, s_m) + offset_m
    number = context.road_numbers[road_id]
    x, y, z, heading, pitch, roll = map(float, pose)
    return FixedPosition(x, y, z, heading, pitch, roll, number, s_m, t, lane, offset_m)


def _centre(frame: object, lane: int, s_m: float) -> float:
    section = frame.sections[int(frame.section_at(s_m))]  # type: ignore[attr-defined]
    return float(section.centre(lane, np.array(s_m))[0])


def lane_number(element: ScenarioElement, key: str = "laneId") -> int:
    """A lane's id, which is a string in the file."""
    try:
        return int(str(element.values[key]))
    except ValueError:
        raise RefusalError(
            element, f"{key}='{element.values[key]}' is no lane of OpenDRIVE"
        ) from None


def _is_relative(orientation: ScenarioElement, context: Compilation) -> bool:
    """What its angles count from; without a word the place since version 1.3, before the world."""
    default = "relative" if context.minor >= RELATIVE_SINCE else "absolute"
    return orientation.values.get("type", default) == "relative"


def oriented(
    context: Compilation, element: ScenarioElement, position: FixedPosition
) -> FixedPosition:
    """The position with the orientation that its element gives."""
    orientation = element.first("Orientation")
    if orientation is None:
        return position
    h, p, r = (number_of(orientation, key, 0.0) for key in "hpr")
    if _is_relative(orientation, context):
        h, p, r = position.heading_rad + h, position.pitch_rad + p, position.roll_rad + r
    return replace(position, heading_rad=h, pitch_rad=p, roll_rad=r)


def _road(element: ScenarioElement, context: Compilation) -> FixedPosition:
    values = element.values
    place = road_position(
        context, element, str(values["roadId"]), float(values["s"]), float(values["t"])
    )
    return oriented(context, element, place)


def _lane(element: ScenarioElement, context: Compilation) -> FixedPosition:
    values = element.values
    place = lane_position(
        context,
        element,
        str(values["roadId"]),
        lane_number(element),
        float(values["s"]),
        number_of(element, "offset", 0.0),
    )
    return oriented(context, element, place)


def _route(element: ScenarioElement, context: Compilation) -> FixedPosition:
    reference = element.first("RouteRef")
    inside = element.first("InRoutePosition")
    assert reference is not None
    assert inside is not None
    path: RoutePath = context.compile(only_child(reference))
    where = only_child(inside)
    if where.name == "FromCurrentEntity":
        raise RefusalError(where, "a place on a route that moves with an entity is not played")
    leg, s_m, forward = path.at(where, float(where.values["pathS"]))
    if where.name == "FromLaneCoordinates":
        offset = number_of(where, "laneOffset", 0.0)
        place = lane_position(context, where, leg, lane_number(where), s_m, offset)
    else:
        place = road_position(context, where, leg, s_m, float(where.values["t"]))
        place = place if forward else turned_round(place)
    return oriented(context, element, place)


def turned_round(place: FixedPosition) -> FixedPosition:
    """The same place, headed the other way."""
    heading = math.remainder(place.heading_rad + math.pi, 2.0 * math.pi)
    return replace(place, heading_rad=heading, pitch_rad=-place.pitch_rad, roll_rad=-place.roll_rad)


def _trajectory(element: ScenarioElement, context: Compilation) -> FixedPosition:
    reference = element.first("TrajectoryRef")
    assert reference is not None
    trajectory: Trajectory = context.compile(only_child(reference))
    if trajectory.from_actor:
        raise RefusalError(
            element, "its trajectory begins where an entity is, so it has no fixed place"
        )
    s_m, t_m = float(element.values["s"]), number_of(element, "t", 0.0)
    x, y, z, heading = point_of(trajectory, s_m, element)
    place = FixedPosition(
        x - t_m * float(sine(heading)), y + t_m * float(cosine(heading)), z, heading
    )
    return oriented(context, element, on_road(context, place))


def on_road(context: Compilation, place: FixedPosition) -> FixedPosition:
    """The place with the lane that lies under it."""
    if context.roads is None:
        return place
    under = context.roads.lane_under(place.x_m, place.y_m)
    road = int(under.road)
    if road < 0:
        return place
    s, t, lane = float(under.s_m), float(under.t_m), int(under.lane)
    frame = list(context.roads.frames.values())[road]
    offset = t - _centre(frame, lane, s)
    return replace(place, road=road, s_m=s, t_m=t, lane=lane, lane_offset_m=offset)


def _relative(
    element: ScenarioElement,
    context: Compilation,
    frame: RelativeFrame,
    keys: tuple[str, str, str],
    lanes: int = 0,
) -> RelativePosition:
    orientation = element.first("Orientation")
    h, p, r = (
        (number_of(orientation, key, 0.0) for key in "hpr") if orientation else (0.0, 0.0, 0.0)
    )
    relative = orientation is None or _is_relative(orientation, context)
    a, b, c = (number_of(element, key, 0.0) for key in keys)
    by_road = frame in (RelativeFrame.ROAD, RelativeFrame.LANE)
    return RelativePosition(
        frame, context.entity(element), a, b, c, lanes, h, p, r, relative, by_road
    )


def _relative_world(element: ScenarioElement, context: Compilation) -> RelativePosition:
    return _relative(element, context, RelativeFrame.WORLD, ("dx", "dy", "dz"))


def _relative_object(element: ScenarioElement, context: Compilation) -> RelativePosition:
    return _relative(element, context, RelativeFrame.OBJECT, ("dx", "dy", "dz"))


def _relative_road(element: ScenarioElement, context: Compilation) -> RelativePosition:
    context.road_map(element)
    return _relative(element, context, RelativeFrame.ROAD, ("ds", "dt", ""))


def _relative_lane(element: ScenarioElement, context: Compilation) -> RelativePosition:
    context.road_map(element)
    lanes = int(element.values["dLane"])
    if ("ds" in element.values) == ("dsLane" in element.values):
        raise RefusalError(element, "give either ds or dsLane")
    if "dsLane" in element.values:
        keys, frame = ("dsLane", "offset", ""), RelativeFrame.LANE_LENGTH
    else:
        keys, frame = ("ds", "offset", ""), RelativeFrame.LANE
    return _relative(element, context, frame, keys, lanes)


POSITIONS: dict[str, Handler] = {
    "WorldPosition": _world,
    "RelativeWorldPosition": _relative_world,
    "RelativeObjectPosition": _relative_object,
    "RoadPosition": _road,
    "RelativeRoadPosition": _relative_road,
    "LanePosition": _lane,
    "RelativeLanePosition": _relative_lane,
    "RoutePosition": _route,
    "TrajectoryPosition": _trajectory,
    "GeoPosition": _geo,
}
"""Handlers of positions by element type."""
