"""Where everybody starts: places of a scenario file, resolved on its roads."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec

from schemas.validation import suggest
from twin.scenario.storyboard.native.bodies import BODIES, ActorBody, body_of
from twin.scenario.storyboard.native.ground import NativeMistakes, ScenarioGround, SpotError
from twin.scenario.storyboard.native.recorded import body_ahead_m, recorded_places
from twin.scenario.storyboard.native.sections import ActorStart, EgoStart, NativeScenario
from twin.scenario.storyboard.native.watches import ScenarioSpot
from twin.scenario.storyboard.program.places import FixedPosition


@dataclass(frozen=True, slots=True)
class StartPlace:
    """Where an actor starts."""

    name: str
    body: ActorBody
    road: int
    lane: int
    """OpenDRIVE id; 0: on none."""
    s_m: float
    """Of the middle of its box."""
    offset_m: float
    """Of the middle of its box, to the left of the lane's middle along s."""
    sign: int
    """1: it goes along s, -1: against it."""
    middle: FixedPosition
    origin: FixedPosition
    """Of its origin, which may lie on the rear axle."""
    recorded: tuple[FixedPosition, ...] = ()
    """Of its origin at each of its recorded poses."""

    @property
    def half_m(self) -> float:
        """Half of what it takes up along its direction of travel."""
        turn = self.origin.heading_rad - self.travel_rad
        return 0.5 * (
            abs(math.cos(turn)) * self.body.length_m + abs(math.sin(turn)) * self.body.width_m
        )

    @property
    def travel_rad(self) -> float:
        """Heading of its direction of travel; that of its body may be turned."""
        return self.middle.heading_rad


def places_of(
    scenario: NativeScenario,
    ego: ActorBody,
    ground: ScenarioGround,
    mistakes: NativeMistakes,
) -> dict[str, StartPlace]:
    """Places of the ego and of all actors by name; what cannot be placed is noted and left out."""
    places: dict[str, StartPlace] = {}
    place = mistakes.attempt("ego", lambda: _ego_place(scenario.ego, ego, ground))
    if place is not None:
        places["ego"] = place
    waiting = dict(scenario.actors)
    while waiting:
        ready = [
            name
            for name, start in waiting.items()
            if start.s_m is not None or start.poses is not None or _before(start) not in waiting
        ]
        if not ready:
            for name, start in waiting.items():
                other = _before(start)
                words = f"'{other}' is itself placed by others, in a circle: give one of them"
                mistakes.add(f"actors.{name}.{_key(start)}", f"{words} s_m")
            break
        for name in ready:
            place = _attempt(name, waiting.pop(name), scenario, ground, places, mistakes)
            if place is not None:
                places[name] = place
    _check_room(places, scenario, mistakes)
    return {name: places[name] for name in ("ego", *scenario.actors) if name in places}


def _attempt(
    name: str,
    start: ActorStart,
    scenario: NativeScenario,
    ground: ScenarioGround,
    places: dict[str, StartPlace],
    mistakes: NativeMistakes,
) -> StartPlace | None:
    path, other = f"actors.{name}", _before(start)
    if start.poses is not None:
        poses, kind = start.poses, body_of(start)
        return mistakes.attempt(path, lambda: _recorded_place(name, poses, kind, ground))
    if start.s_m is None and other != "ego" and other not in scenario.actors:
        names = suggest(other, ["ego", *scenario.actors])
        mistakes.add(f"{path}.{_key(start)}", f"no actor '{other}'; {names}")
        return None
    if start.s_m is None and other not in places:
        return None  # what that one lacks is told
    if start.towed_by:
        return mistakes.attempt(path, lambda: _towed_place(name, start, ground, places[other]))
    body = BODIES[start.kind]
    if start.speed_mps > body.speed_max_mps:
        mistakes.add(
            f"{path}.speed_mps",
            f"given {start.speed_mps:g}, kind {start.kind} goes at most {body.speed_max_mps:g} m/s",
        )
    if start.ahead_s is not None:
        ahead_of = scenario.actors.get(start.of, scenario.ego)
        along = math.cos(math.radians(start.heading_deg or 0.0))
        if start.oncoming is not ahead_of.oncoming:
            along = -along
        closing_mps = ahead_of.speed_mps - along * start.speed_mps
        if closing_mps <= 0.0:
            words = f"'{start.of}' does not come nearer, as both move: give ahead_m"
            mistakes.add(f"{path}.ahead_s", words)
            return None
        start = msgspec.structs.replace(start, ahead_s=None, ahead_m=start.ahead_s * closing_mps)
    return mistakes.attempt(path, lambda: _actor_place(name, start, ground, places))


def _before(start: ActorStart) -> str:
    """Whom an actor is placed by."""
    return start.towed_by or start.of


def _key(start: ActorStart) -> str:
    return "towed_by" if start.towed_by else "of"


def _towed_place(
    name: str, start: ActorStart, ground: ScenarioGround, tractor: StartPlace
) -> StartPlace:
    """Straight behind a tractor; the player then puts its coupler to the hitch."""
    body, hitch = body_of(start), tractor.body.hitch_x_m
    if hitch is None:
        raise SpotError("towed_by", f"'{tractor.name}' tows nothing: it needs a rear axle")
    behind = tractor.body.centre_x_m - hitch + body.coupler_m - body.centre_x_m
    s = tractor.s_m - tractor.sign * behind
    ground.section(tractor.road, s, "towed_by")
    turn = math.remainder(tractor.origin.heading_rad - tractor.travel_rad, 2.0 * math.pi)
    if abs(turn) > 1e-9:
        raise SpotError("towed_by", f"'{tractor.name}' has a heading_deg: leave it out")
    place = tractor.road, tractor.lane, s, tractor.offset_m, tractor.sign
    return _place(name, body, ground, *place)


def _ego_place(start: EgoStart, body: ActorBody, ground: ScenarioGround) -> StartPlace:
    if start.poses is not None:
        return _recorded_place("ego", start.poses, body, ground)
    assert start.lane is not None
    assert start.s_m is not None
    road, sign = ground.road_number(start.road), -1 if start.oncoming else 1
    lane = ground.lane(road, start.s_m, sign, start.lane)
    return _place("ego", body, ground, road, lane, start.s_m, start.offset_m * sign, sign)


def _recorded_place(
    name: str, poses: list[list[float]], body: ActorBody, ground: ScenarioGround
) -> StartPlace:
    """Where it was recorded first: on no lane, since it follows none."""
    places = recorded_places(poses, body_ahead_m(body, name == "ego"), ground)
    first = places[0]
    road = max(first.road, 0)
    return StartPlace(
        name, body, road, 0, first.s_m, first.t_m, 1, first, first, recorded=tuple(places)
    )


def _actor_place(
    name: str, start: ActorStart, ground: ScenarioGround, places: dict[str, StartPlace]
) -> StartPlace:
    body = body_of(start)
    reference = places.get(start.of)
    if start.road or reference is None or start.s_m is not None:
        road = ground.road_number(start.road)
    else:
        road = reference.road
    turn = math.radians(start.heading_deg or 0.0)
    if start.s_m is not None:
        s, key = start.s_m, "s_m"
    else:
        assert reference is not None
        if road != reference.road:
            label = ground.label(reference.road)
            raise SpotError("road", f"'{start.of}' is on road {label}: leave road out, or give s_m")
        key = "ahead_m" if start.ahead_m is not None else "behind_m"
        half = 0.5 * (abs(math.cos(turn)) * body.length_m + abs(math.sin(turn)) * body.width_m)
        gap = (start.ahead_m or 0.0) - (start.behind_m or 0.0)
        way = 1.0 if start.ahead_m is not None else -1.0
        s = reference.s_m + reference.sign * (gap + way * (half + reference.half_m))
    ground.section(road, s, key)
    lane, offset, sign = _across(start, ground, road, s)
    return _place(name, body, ground, road, lane, s, offset + start.offset_m * sign, sign, turn)


def _across(
    start: ActorStart, ground: ScenarioGround, road: int, s_m: float
) -> tuple[int, float, int]:
    """Lane, offset to the left of its middle along s, and direction of travel."""
    sign = -1 if start.oncoming else 1
    if start.lane is not None:
        return ground.lane(road, s_m, sign, start.lane), 0.0, sign
    for kind in ("footway", "parked", "shoulder"):
        side = getattr(start, kind)
        if side is not None:
            # What is parked faces as the traffic on its side does.
            left = (side == "left") == (ground.frame(road).road.rule == "RHT")
            faces = -sign if left and kind != "footway" else sign
            return ground.beside(road, s_m, kind, side), 0.0, faces
    assert start.lateral_m is not None
    lane, offset = ground.lateral(road, s_m, start.lateral_m)
    return lane, offset, sign


def _place(
    name: str,
    body: ActorBody,
    ground: ScenarioGround,
    road: int,
    lane: int,
    s_m: float,
    offset_m: float,
    sign: int,
    turn_rad: float = 0.0,
) -> StartPlace:
    middle = ground.fixed(road, lane, s_m, offset_m, sign)
    place = StartPlace(name, body, road, lane, s_m, offset_m, sign, middle, middle)
    return turned_place(place, ground, turn_rad)


def turned_place(place: StartPlace, ground: ScenarioGround, turn_rad: float) -> StartPlace:
    """The same place for a body that is turned to the left of its direction of travel.

    Raises:
        SpotError: its origin lies beyond the road.
    """
    back = place.body.centre_x_m
    # Along the road for a body that heads along it, so that it stays in the middle of its lane.
    s = place.s_m - place.sign * back * math.cos(turn_rad)
    offset = place.offset_m - place.sign * back * math.sin(turn_rad)
    ground.section(place.road, s)
    origin = ground.fixed(place.road, place.lane, s, offset, place.sign, turn_rad)
    return replace(place, origin=origin)


def spot_position(
    spot: ScenarioSpot, ground: ScenarioGround, start: StartPlace
) -> tuple[FixedPosition, int]:
    """The place that a spot says, and the direction of travel there; ``start`` gives the road.

    Raises:
        SpotError: there is no such place.
    """
    road = ground.road_number(spot.road) if spot.road else start.road
    sign = -1 if spot.oncoming else 1
    ground.section(road, spot.s_m)
    if spot.lateral_m is not None:
        lane, offset = ground.lateral(road, spot.s_m, spot.lateral_m)
    else:
        lane, offset = ground.lane(road, spot.s_m, sign, spot.lane or 1), 0.0
    return ground.fixed(road, lane, spot.s_m, offset, sign), sign


def origin_at(spot: ScenarioSpot, ground: ScenarioGround, place: StartPlace) -> FixedPosition:
    """Where the origin of an actor is while its middle is at a spot, headed along the road.

    Raises:
        SpotError: there is no such place.
    """
    position, sign = spot_position(spot, ground, place)
    s = position.s_m - sign * place.body.centre_x_m
    try:
        ground.section(position.road, s)
        return ground.fixed(position.road, position.lane, s, position.lane_offset_m, sign)
    except (SpotError, ValueError):
        return position  # at the very beginning of a road, or where its lane begins


def _check_room(
    places: dict[str, StartPlace], scenario: NativeScenario, mistakes: NativeMistakes
) -> None:
    """Two bodies in one place."""
    names = list(places)
    for index, name in enumerate(names):
        for other in names[:index]:
            # Trackers tell of one body twice, and of bodies where another one was before.
            recorded = places[name].recorded or places[other].recorded
            if not recorded and overlap(places[name], places[other]):
                mistakes.add(
                    f"actors.{name}" if name in scenario.actors else name,
                    f"starts in the same place as '{other}': move one of them",
                )


def overlap(one: StartPlace, other: StartPlace) -> bool:
    """Whether the boxes of two actors overlap, seen from above (separating axes)."""
    if abs(one.origin.z_m - other.origin.z_m) > 3.0:
        return False  # a bridge
    dx = _middle(other)[0] - _middle(one)[0]
    dy = _middle(other)[1] - _middle(one)[1]
    for angle in (one.origin.heading_rad, other.origin.heading_rad):
        for axis in (angle, angle + 0.5 * math.pi):
            apart = abs(dx * math.cos(axis) + dy * math.sin(axis))
            if apart >= _reach(one, axis) + _reach(other, axis):
                return False
    return True


def _middle(place: StartPlace) -> tuple[float, float]:
    origin, ahead = place.origin, place.body.centre_x_m
    return (
        origin.x_m + ahead * math.cos(origin.heading_rad),
        origin.y_m + ahead * math.sin(origin.heading_rad),
    )


def _reach(place: StartPlace, axis: float) -> float:
    turn = place.origin.heading_rad - axis
    return 0.5 * (
        abs(math.cos(turn)) * place.body.length_m + abs(math.sin(turn)) * place.body.width_m
    )
