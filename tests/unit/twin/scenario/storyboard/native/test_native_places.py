"""Where everybody starts: lanes from the right, gaps, sides, turned bodies."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from native_scenarios import EGO, mistakes_of, program_of, scenario_text

from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.shipped.library import road_path
from twin.scenario.storyboard.native.bodies import BODIES
from twin.scenario.storyboard.native.document import load_native
from twin.scenario.storyboard.native.outline import native_outline

CAR = BODIES["car"]


def start_of(tmp_path, actor: str, *, ego: str = EGO, road: str = "motorway"):
    program = program_of(tmp_path, scenario_text(f"other: {{{actor}}}", ego=ego, road=road))
    entity = program.entities[1]
    assert entity.name == "other"
    return entity.start


def middle_x(place, body=CAR) -> float:
    return place.x_m + body.centre_x_m * math.cos(place.heading_rad)


@pytest.mark.parametrize(
    ("lane", "oncoming", "opendrive"),
    [(1, False, -4), (2, False, -3), (3, False, -2), (1, True, 4), (2, True, 3), (3, True, 2)],
)
def test_lanes_count_from_the_right_of_those_who_drive_there(tmp_path, lane, oncoming, opendrive):
    place = start_of(tmp_path, f"kind: car, lane: {lane}, oncoming: {oncoming}, s_m: 300".lower())
    assert place.lane == opendrive
    assert abs(place.heading_rad) == pytest.approx(math.pi if oncoming else 0.0)
    assert middle_x(place) == pytest.approx(300.0)
    assert (place.y_m > 0.0) == oncoming
    frame = RoadMap(load_network(road_path("motorway", Path()))).frame("0")
    assert place.y_m == pytest.approx(float(frame.lane_pose(opendrive, 300.0).y_m))


def test_where_an_actor_is_means_the_middle_of_its_box(tmp_path):
    program = program_of(tmp_path, scenario_text())
    ego = program.entities[0]
    assert ego.start.x_m + ego.box.centre_x_m == pytest.approx(100.0)
    assert ego.box.centre_x_m == pytest.approx(2.25 - 0.83)
    assert ego.start.s_m == pytest.approx(ego.start.x_m)


@pytest.mark.parametrize(("key", "way"), [("ahead_m", 1.0), ("behind_m", -1.0)])
def test_gaps_are_those_between_boxes(tmp_path, key, way):
    place = start_of(tmp_path, f"kind: truck, lane: 2, {key}: 30")
    truck = BODIES["truck"]
    between = way * (middle_x(place, truck) - 100.0)
    assert between == pytest.approx(30.0 + 0.5 * (CAR.length_m + truck.length_m))


def test_ahead_of_one_who_drives_against_s_is_nearer_to_the_beginning(tmp_path):
    text = scenario_text(
        "first: {kind: car, lane: 1, oncoming: true, s_m: 500}\n"
        "second: {kind: car, lane: 1, oncoming: true, ahead_m: 10, of: first}"
    )
    second = program_of(tmp_path, text).entities[2].start
    assert middle_x(second) == pytest.approx(500.0 - 10.0 - CAR.length_m)


def test_actors_may_be_placed_by_those_that_stand_below(tmp_path):
    text = scenario_text(
        "second: {kind: car, lane: 1, ahead_m: 10, of: first}\n"
        "first: {kind: car, lane: 1, ahead_m: 10}"
    )
    program = program_of(tmp_path, text)
    assert [entity.name for entity in program.entities] == ["ego", "second", "first"]
    assert program.entities[1].start.x_m == pytest.approx(100.0 + 2 * 14.5 - CAR.centre_x_m)


@pytest.mark.parametrize(
    ("where", "t", "heading"),
    [
        ("footway: right", -6.5, 0.0),
        ("footway: left", 6.5, 0.0),
        ("footway: right, oncoming: true", -6.5, math.pi),
        ("parked: right", -4.25, 0.0),
        ("parked: left", 4.25, math.pi),
        ("lateral_m: 0.5", 0.5, 0.0),
        ("lateral_m: -9", -9.0, 0.0),
        ("lane: 1, offset_m: 0.4", -1.225, 0.0),
        ("lane: 1, oncoming: true, offset_m: 0.4", 1.225, math.pi),
        ("lane: 1, heading_deg: 90", -1.625, 0.5 * math.pi),
    ],
)
def test_places_across_the_street(tmp_path, where, t, heading):
    actor = f"kind: pedestrian, {where}, s_m: 60"
    place = start_of(tmp_path, actor, ego="{lane: 1, s_m: 20}", road="street")
    assert (place.x_m, place.y_m) == pytest.approx((60.0, t))
    assert abs(place.heading_rad) == pytest.approx(heading)
    assert place.t_m == pytest.approx(t)


def test_a_footway_lies_on_its_kerb(tmp_path):
    actor = "kind: pedestrian, footway: right, s_m: 60"
    place = start_of(tmp_path, actor, ego="{lane: 1, s_m: 20}", road="street")
    assert place.z_m == pytest.approx(0.12)


def test_bodies_lie_on_the_slope_of_the_road(tmp_path):
    ego = "{lane: 1, s_m: 200}"
    along = start_of(tmp_path, "kind: car, lane: 1, s_m: 350", ego=ego, road="rural")
    against = start_of(
        tmp_path, "kind: car, lane: 1, oncoming: true, s_m: 350", ego=ego, road="rural"
    )
    assert along.pitch_rad == pytest.approx(-math.atan(0.05), abs=2e-3)  # uphill: nose up
    assert against.pitch_rad == pytest.approx(math.atan(0.05), abs=2e-3)
    across = start_of(
        tmp_path, "kind: animal, lane: 1, s_m: 350, heading_deg: 90", ego=ego, road="rural"
    )
    assert across.pitch_rad == pytest.approx(-along.roll_rad, abs=2e-3)
    assert across.roll_rad == pytest.approx(along.pitch_rad, abs=2e-3)


def test_roads_are_named_by_id_or_name(tmp_path):
    ego = "{road: south, lane: 1, s_m: 100}"
    one = start_of(tmp_path, "kind: car, road: north, lane: 1, s_m: 50", ego=ego, road="junction")
    other = start_of(tmp_path, "kind: car, road: '1', lane: 1, s_m: 50", ego=ego, road="junction")
    assert one == other
    assert one.road == 1


def test_an_actor_stands_on_the_road_of_the_one_it_is_placed_by(tmp_path):
    ego = "{road: south, lane: 1, s_m: 100}"
    place = start_of(tmp_path, "kind: car, lane: 2, ahead_m: 5", ego=ego, road="junction")
    assert place.road == 3
    assert place.lane == -1


@pytest.mark.parametrize(
    ("actor", "line"),
    [
        (
            "kind: car, lane: 4, s_m: 300",
            "actors.other.lane: lane 4 is not on road motorway at 300 ",
        ),
        (
            "kind: car, lane: 1, s_m: 1501",
            "actors.other.s_m: 1501 m along the road, allowed: 0 to ",
        ),
        ("kind: car, lane: 1, ahead_m: 1400", "actors.other.ahead_m: 1504.5 m along the road, all"),
        ("kind: car, lane: 1, behind_m: 100", "actors.other.behind_m: -4.5 m along the road, allo"),
        ("kind: car, parked: right, s_m: 9", "actors.other.parked: no parking lane on the right o"),
        ("kind: car, footway: left, s_m: 9", "actors.other.footway: no footway on the left of roa"),
        (
            "kind: car, lane: 1, s_m: 9, road: a1",
            "actors.other.road: no road 'a1'; allowed: motorw",
        ),
        ("kind: car, lane: 1, ahead_m: 9, of: van", "actors.other.of: no actor 'van'; allowed: eg"),
        ("kind: car, lane: 2, s_m: 103", "actors.other: starts in the same place as 'ego': move o"),
        ("kind: car, lane: 2, s_m: 100", "actors.other: starts in the same place as 'ego'"),
        (
            "kind: child, lane: 1, s_m: 9, speed_mps: 7",
            "actors.other.speed_mps: given 7, kind child ",
        ),
        (
            "kind: animal, lane: 1, s_m: 9, behaviour: idm",
            "actors.other.behaviour: no driver model",
        ),
        ("kind: car, lane: 1, s_m: 9, behaviour: idm", "actors.other.idm.desired_speed_mps: need"),
        ("kind: car, lane: 1, s_m: 9, turns: [left]", "actors.other.turns: 'left': no junction li"),
        ("kind: car, lane: 1, s_m: 1", "actors.other.s_m: -0.42 m along the road, allowed: 0 to"),
    ],
)
def test_places_that_do_not_exist(tmp_path, actor, line):
    lines = mistakes_of(tmp_path, scenario_text(f"other: {{{actor}}}"))
    assert lines
    assert lines[0].startswith(line)


def test_actors_that_are_placed_by_each_other(tmp_path):
    lines = mistakes_of(
        tmp_path,
        scenario_text(
            "one: {kind: car, lane: 1, ahead_m: 10, of: two}\n"
            "two: {kind: car, lane: 1, ahead_m: 10, of: one}"
        ),
    )
    assert [line.split(":")[0] for line in lines] == ["actors.one.of", "actors.two.of"]
    assert "in a circle" in lines[0]


def test_a_road_that_is_not_there(tmp_path):
    (line,) = mistakes_of(tmp_path, scenario_text(road="autobahn"))
    assert line.startswith("road: road 'autobahn' is not shipped; allowed: bend, crossroads,")
    (line,) = mistakes_of(tmp_path, scenario_text(road="town.xodr"))
    assert line.startswith("road: ")
    assert "town.xodr" in line


def test_bodies_side_by_side_do_not_overlap_and_crossed_ones_do(tmp_path):
    beside = "other: {kind: truck, lane: 1, s_m: 100}"
    assert mistakes_of(tmp_path, scenario_text(beside)) == []
    crossed = "other: {kind: truck, lane: 1, s_m: 100, offset_m: 0.6, heading_deg: 45}"
    assert len(mistakes_of(tmp_path, scenario_text(crossed))) == 1


def test_measures_of_a_body_are_those_of_the_file(tmp_path):
    text = scenario_text("box: {kind: obstacle, lane: 1, s_m: 300, length_m: 0.4, width_m: 0.3}")
    box = program_of(tmp_path, text).entities[1].box
    assert (box.length_m, box.width_m, box.height_m) == (0.4, 0.3, 1.0)


TRUCK = "truck: {kind: truck, lane: 1, s_m: 200, speed_mps: 20}"


def test_a_towed_trailer_begins_straight_behind(tmp_path):
    actors = f"trailer: {{kind: trailer, towed_by: truck}}\n{TRUCK}"
    program = program_of(tmp_path, scenario_text(actors))
    _, trailer, truck = program.entities
    assert trailer.tractor == 2
    assert truck.tractor == -1
    assert (trailer.start.y_m, trailer.start.heading_rad) == pytest.approx((truck.start.y_m, 0.0))
    hitch, coupler = truck.start.x_m + truck.hitch_x_m, trailer.start.x_m + trailer.coupler_x_m
    assert hitch == pytest.approx(coupler)
    front = middle_x(trailer.start, BODIES["trailer"]) + 0.5 * BODIES["trailer"].length_m
    rear = middle_x(truck.start, BODIES["truck"]) - 0.5 * BODIES["truck"].length_m
    assert 1.0 < rear - front < 2.0
    lines = native_outline(load_native(tmp_path / "scenario.yaml"), program)
    assert [line.rpartition(", ")[2] for line in lines[2:4]] == ["towed by truck", "20 m/s"]


def test_a_trailer_of_its_own_is_an_actor_like_others(tmp_path):
    place = start_of(
        tmp_path, "kind: trailer, parked: right, s_m: 60", road="street", ego="{lane: 1, s_m: 20}"
    )
    assert middle_x(place, BODIES["trailer"]) == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("trailer", "words"),
    [
        ("kind: trailer, towed_by: lorry", "no actor 'lorry'; allowed: ego"),
        ("kind: car, towed_by: truck", "towed_by is for `kind: trailer`, not for car"),
        ("kind: trailer, towed_by: truck, lane: 2", "lane has no effect beside towed_by"),
        ("kind: trailer, towed_by: truck, speed_mps: 2", "speed_mps has no effect"),
        ("kind: trailer, towed_by: walker", "'walker' tows nothing: it needs a rear axle"),
        ("kind: trailer, towed_by: other", "'other' is itself placed by others, in a circle"),
    ],
)
def test_trailers_that_cannot_be_towed(tmp_path, trailer, words):
    walker = "walker: {kind: pedestrian, lane: 1, s_m: 250}"
    text = scenario_text(f"other: {{{trailer}}}\n{TRUCK}\n{walker}")
    assert any(words in line for line in mistakes_of(tmp_path, text))


def test_a_hitch_holds_one_trailer_and_that_takes_no_orders(tmp_path):
    actors = (
        f"{TRUCK}\none: {{kind: trailer, towed_by: truck}}\ntwo: {{kind: trailer, towed_by: truck}}"
    )
    lines = mistakes_of(tmp_path, scenario_text(actors, "go: {do: {one: {speed_mps: 5}}}"))
    assert any("actors.two.towed_by: 'one' hangs there already" in line for line in lines)
    assert any(
        "events.go.do.one: a towed trailer goes where 'truck' goes" in line for line in lines
    )
    lamps = f"{TRUCK}\none: {{kind: trailer, towed_by: truck}}"
    assert program_of(tmp_path, scenario_text(lamps, "go: {do: {one: {lamps: {brake: on}}}}"))
