"""Free lanes beside an entity, on straight and bent roads, over sections and ends of roads."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, WIDTH, end, geometry, lane, link, road, section, xodr
from storyboard_programs import (
    STEP_S,
    EventPlan,
    GroupPlan,
    at,
    car,
    program,
    start_at,
    trigger,
    when,
)

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer
from twin.scenario.storyboard.program.actions import SetVariableAction
from twin.scenario.storyboard.program.conditions import LaneRange, RelativeClearanceCondition
from twin.scenario.storyboard.program.places import FixedPosition
from twin.scenario.storyboard.program.program import ProgramVariable

OWN, LEFT, RIGHT = (LaneRange(k, k) for k in (0, 1, -1))
RADIUS = 50.0


@pytest.fixture(scope="module")
def straight():
    """200 m with lanes 2, 1, -1, -2 of 3.5 m."""
    lanes = section(left=lane(2) + lane(1), right=lane(-1) + lane(-2))
    return read_network(xodr(road(200.0, geometry(LINE, 200.0), lanes)), "straight.xodr")


@pytest.fixture(scope="module")
def bend():
    """Half a turn to the left of 50 m radius with lanes 1 and -1."""
    length = RADIUS * math.pi
    shape = f'<arc curvature="{1 / RADIUS}"/>'
    return read_network(xodr(road(length, geometry(shape, length))), "bend.xodr")


@pytest.fixture(scope="module")
def widening():
    """At 100 m a lane begins on the right between the two that are there: -2 goes on as -3."""
    before = section(
        0.0, lane(1), lane(-1, link((), (-1,)) + WIDTH) + lane(-2, link((), (-3,)) + WIDTH)
    )
    behind = section(
        100.0,
        lane(1),
        lane(-1, link((-1,), ()) + WIDTH) + lane(-2) + lane(-3, link((-2,), ()) + WIDTH),
    )
    return read_network(xodr(road(200.0, geometry(LINE, 200.0), before + behind)), "widening.xodr")


@pytest.fixture(scope="module")
def turned():
    """Two roads whose reference lines meet head on: lane -1 of the first goes on as 1."""
    roads = [
        road(
            100.0,
            geometry(LINE, 100.0, at=at_s),
            section(left=lane(1, link((), (-1,)) + WIDTH), right=lane(-1, link((), (1,)) + WIDTH)),
            link=end("successor", "road", other, "end"),
            road_id=name,
        )
        for name, other, at_s in (("1", "2", (0.0, 0.0, 0.0)), ("2", "1", (200.0, 0.0, math.pi)))
    ]
    return read_network(xodr(*roads), "turned.xodr")


def on_lane(network, s_m, lane_id, *, offset_m=0.0, number=0, against=False):
    frame = list(RoadMap(network).frames.values())[number]
    pose = frame.lane_pose(lane_id, s_m, offset_m, with_traffic=True)
    under = RoadMap(network).lane_under(float(pose.x_m), float(pose.y_m))
    heading = float(pose.heading_rad) + (math.pi if against else 0.0)
    centre = frame.lane_pose(lane_id, s_m, 0.0)
    offset = math.hypot(float(pose.x_m) - float(centre.x_m), float(pose.y_m) - float(centre.y_m))
    signed = math.copysign(offset, offset_m)
    place = (float(pose.x_m), float(pose.y_m), 0.0, heading, 0.0, 0.0)
    return FixedPosition(*place, number, s_m, float(under.t_m), lane_id, signed)


def is_clear(network, places, *ranges, ahead_m=30.0, behind_m=0.0, **changes):
    """Whether the lanes of entity 0 are free of the others at the beginning."""
    condition = RelativeClearanceCondition(
        ahead_m,
        behind_m,
        changes.pop("freespace", False),
        changes.pop("opposite", False),
        changes.pop("entities", ()),
        ranges,
    )
    init = [item for number, place in enumerate(places) for item in start_at(number, place, 0.0)]
    events = [EventPlan(trigger(when(condition, 0)), [SetVariableAction(0, 1.0)])]
    towed = changes.pop("towed", ())
    plan = program(
        [
            car(
                f"car{number}",
                hitch_x_m=-1.0,
                coupler_x_m=4.0,
                tractor=0 if number in towed else -1,
            )
            for number in range(len(places))
        ],
        init,
        [GroupPlan((0,), events)],
        variables=[ProgramVariable("variable v", 0.0)],
    )
    player = StoryboardPlayer([plan], road_tables(network), 1, step_s=STEP_S)
    player.start(0, 0)
    return player.variables(0)["variable v"] == 1.0


def test_only_the_lanes_that_are_asked_for_count(straight):
    me, beside = on_lane(straight, 50.0, -2), on_lane(straight, 60.0, -1)
    assert is_clear(straight, [me, beside], OWN)
    assert not is_clear(straight, [me, beside], LEFT)
    assert not is_clear(straight, [me, beside])
    assert not is_clear(straight, [me, beside], OWN, LEFT)
    assert not is_clear(straight, [me, beside], LaneRange(0, 3))
    assert is_clear(straight, [me])


def test_nobody_is_free_to_leave_the_road(straight):
    """A lane that is not there is not free."""
    assert not is_clear(straight, [on_lane(straight, 50.0, -2)], RIGHT)
    assert is_clear(straight, [on_lane(straight, 50.0, -1)], RIGHT)
    beside = FixedPosition(50.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0, 50.0, 20.0)
    assert not is_clear(straight, [beside])


@pytest.mark.parametrize(
    ("s_m", "clear"), [(79.9, False), (80.1, True), (29.9, True), (30.1, False)]
)
def test_origins_count_by_their_distance(straight, s_m, clear):
    places = [on_lane(straight, 50.0, -1), on_lane(straight, s_m, -1)]
    assert is_clear(straight, places, OWN, ahead_m=30.0, behind_m=20.0) is clear


@pytest.mark.parametrize(
    ("s_m", "clear"), [(81.4, False), (81.6, True), (26.4, True), (26.6, False)]
)
def test_boxes_count_from_their_nearer_ends(straight, s_m, clear):
    """The rear end is 1.5 m behind the origin, the front 3.5 m before it."""
    places = [on_lane(straight, 50.0, -1), on_lane(straight, s_m, -1)]
    options = {"ahead_m": 30.0, "behind_m": 20.0, "freespace": True}
    assert is_clear(straight, places, OWN, **options) is clear


@pytest.mark.parametrize(("offset_m", "clear"), [(0.74, True), (0.76, False)])
def test_a_box_that_reaches_into_a_lane_is_there(straight, offset_m, clear):
    """2 m wide in a lane of 3.5 m: from 0.75 m off its middle on."""
    places = [on_lane(straight, 50.0, -2), on_lane(straight, 60.0, -1, offset_m=-offset_m)]
    assert is_clear(straight, places, OWN, freespace=True) is clear
    assert is_clear(straight, places, OWN, freespace=False)


def test_a_box_at_the_edge_of_the_road_is_still_there(straight):
    """Its origin is on no lane."""
    aside = FixedPosition(60.0, -7.5, 0.0, 0.0, 0.0, 0.0, 0, 60.0, -7.5)
    places = [on_lane(straight, 50.0, -2), aside]
    assert is_clear(straight, places, OWN, freespace=False)
    assert not is_clear(straight, places, OWN, freespace=True)


def test_lanes_of_the_other_direction_count_when_asked(straight):
    places = [on_lane(straight, 50.0, -1), on_lane(straight, 60.0, 1)]
    assert is_clear(straight, places)
    assert not is_clear(straight, places, opposite=True)
    assert not is_clear(straight, places, LEFT, opposite=True)
    # None of the lanes to the left goes the same way.
    assert not is_clear(straight, [places[0]], LEFT)
    assert is_clear(straight, [places[0]], LEFT, opposite=True)


def test_left_and_ahead_are_as_the_entity_is_headed(straight):
    me = on_lane(straight, 100.0, -1, against=True)
    assert not is_clear(straight, [me, on_lane(straight, 80.0, -2)], LEFT)
    assert is_clear(straight, [me, on_lane(straight, 120.0, -2)], LEFT)
    assert not is_clear(straight, [me, on_lane(straight, 120.0, -2)], LEFT, behind_m=20.1)


def test_only_named_entities_count(straight):
    places = [on_lane(straight, s_m, -1) for s_m in (50.0, 60.0, 100.0)]
    assert not is_clear(straight, places, OWN, entities=(1,))
    assert is_clear(straight, places, OWN, entities=(2,))
    assert not is_clear(straight, places, OWN, entities=(2, 1))


@pytest.mark.parametrize("lane_id", [-1, 1])
def test_distances_lie_along_the_middle_of_the_lane(bend, lane_id):
    """At 1.75 m beside an arc of 50 m radius 20 m of it are 20 m (1 -+ 1.75 / 50) long."""
    sign = 1.0 if lane_id < 0 else -1.0
    begin = 40.0 if lane_id < 0 else 60.0
    places = [on_lane(bend, begin, lane_id), on_lane(bend, begin + sign * 20.0, lane_id)]
    way = 20.0 * (1.0 + sign * _half_width(bend) / RADIUS)
    assert is_clear(bend, places, OWN, ahead_m=way - 1e-4)
    assert not is_clear(bend, places, OWN, ahead_m=way + 1e-4)


def _half_width(network):
    frame = next(iter(RoadMap(network).frames.values()))
    return float(frame.lane_width(1, 10.0)) / 2.0


def test_lanes_are_followed_through_sections(widening):
    """Lane -2 leads into -3, so who is on -3 there is in the lane of who is on -2 here."""
    me = on_lane(widening, 90.0, -2)
    assert not is_clear(widening, [me, on_lane(widening, 110.0, -3)], OWN)
    assert is_clear(widening, [me, on_lane(widening, 110.0, -1)], OWN)


def test_lanes_are_followed_over_roads(turned):
    me = on_lane(turned, 90.0, -1)
    ahead = on_lane(turned, 85.0, 1, number=1)
    oncoming = on_lane(turned, 85.0, -1, number=1)
    assert is_clear(turned, [me, ahead], OWN, ahead_m=24.9)
    assert not is_clear(turned, [me, ahead], OWN, ahead_m=25.1)
    assert is_clear(turned, [me, oncoming])
    assert not is_clear(turned, [me, oncoming], LEFT, opposite=True)
    assert is_clear(turned, [me, oncoming], OWN, opposite=True)


def test_who_is_on_no_road_is_in_no_lane(straight):
    away = at(60.0, 500.0)
    assert is_clear(straight, [on_lane(straight, 50.0, -1), away])


def test_the_own_trailer_takes_no_room(straight):
    places = [on_lane(straight, s_m, -1) for s_m in (50.0, 45.0, 35.0)]
    assert is_clear(straight, places[:2], OWN, towed=(1,), behind_m=20.0)
    assert not is_clear(straight, places[:2], OWN, behind_m=20.0)
    assert not is_clear(straight, places, OWN, towed=(1,), behind_m=20.0)
