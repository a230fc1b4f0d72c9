"""twin.road.opendrive.lane_course: how far a lane leads, and what ends it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from road_files import LINE, WIDTH, crossing, end, geometry, lane, link, road, section, xodr

from twin.road.opendrive import lane_course as module
from twin.road.opendrive.lane_course import LaneCourse, lane_course
from twin.road.opendrive.lane_graph import DrivenLane, LaneKey, lane_graph
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap


def course_of(data: bytes, road_id: str = "0", lane_id: int = -1, sign: int = 1) -> LaneCourse:
    roads = RoadMap(read_network(data, "t"))
    first = DrivenLane(LaneKey(road_id, 0, lane_id), sign)
    return lane_course(roads, lane_graph(roads.network), first)


def way_m(course: LaneCourse) -> float:
    return float(np.hypot(np.diff(course.x_m), np.diff(course.y_m)).sum())


def chain(*, kink_rad: float = 0.0, gap_m: float = 0.0) -> bytes:
    """Two roads of 50 m, the second of which follows the first."""
    inside = section(left="", right=lane(-1, link((-1,), (-1,)) + WIDTH))
    first = road(50.0, None, inside, road_id="0", link=end("successor", "road", "1", "start"))
    plan = geometry(LINE, 50.0, at=(50.0 + gap_m, 0.0, kink_rad))
    second = road(50.0, plan, inside, road_id="1", link=end("predecessor", "road", "0", "end"))
    return xodr(first, second)


def test_it_follows_the_next_road_and_says_height_and_width() -> None:
    course = course_of(chain())
    assert way_m(course) == pytest.approx(100.0, abs=0.01)
    assert course.y_m == pytest.approx(-1.75)
    assert course.width_m == pytest.approx(3.5)
    assert course.z_m == pytest.approx(0.0)
    assert np.hypot(np.diff(course.x_m), np.diff(course.y_m)).max() <= 1.0 + 1e-9
    assert not course.closed


@pytest.mark.parametrize(("kink_rad", "gap_m"), [(0.06, 0.0), (-0.06, 0.0), (0.0, 0.06)])
def test_where_the_next_lane_does_not_continue_it_ends(kink_rad: float, gap_m: float) -> None:
    course = course_of(chain(kink_rad=kink_rad, gap_m=gap_m))
    assert way_m(course) == pytest.approx(50.0, abs=0.01)


def test_a_lane_against_s_is_driven_backwards() -> None:
    course = course_of(xodr(road(80.0)), lane_id=1, sign=-1)
    assert (course.x_m[0], course.x_m[-1]) == (pytest.approx(80.0), pytest.approx(0.0))
    assert np.abs(course.heading_rad) == pytest.approx(math.pi)


def test_it_goes_through_a_junction() -> None:
    course = course_of(crossing())
    assert way_m(course) == pytest.approx(50.0 + 20.0 + 50.0, abs=0.05)


def test_it_ends_where_it_is_too_narrow() -> None:
    taper = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    taper += '<width sOffset="50" a="3.5" b="-0.05" c="0" d="0"/>'
    course = course_of(xodr(road(120.0, lanes=section(right=lane(-1, taper)))))
    assert course.x_m[-1] == pytest.approx(80.0, abs=1.1)
    assert course.width_m.min() >= 2.0


def test_a_road_round_is_closed() -> None:
    arc = geometry('<arc curvature="0.02"/>', 2.0 * math.pi * 50.0)
    joined = end("predecessor", "road", "0", "end") + end("successor", "road", "0", "start")
    inside = section(left="", right=lane(-1, link((-1,), (-1,)) + WIDTH))
    course = course_of(xodr(road(2.0 * math.pi * 50.0, arc, inside, link=joined)))
    assert course.closed
    assert (course.x_m[0], course.y_m[0]) == (course.x_m[-1], course.y_m[-1])
    assert way_m(course) == pytest.approx(2.0 * math.pi * 51.75, abs=0.05)


def test_a_ring_that_it_enters_is_driven_once() -> None:
    """A road that leads into a circle, which leads to itself and not back."""
    round_m = 2.0 * math.pi * 50.0
    inside = section(left="", right=lane(-1, link((-1,), (-1,)) + WIDTH))
    into = road(30.0, geometry(LINE, 30.0, at=(-30.0, 0.0, 0.0)), inside, road_id="0",
                link=end("successor", "road", "1", "start"))  # fmt: skip
    joined = end("predecessor", "road", "1", "end") + end("successor", "road", "1", "start")
    arc = geometry('<arc curvature="0.02"/>', round_m)
    course = course_of(xodr(into, road(round_m, arc, inside, road_id="1", link=joined)))
    assert not course.closed
    assert 30.0 + 300.0 < way_m(course) < 30.0 + 2.0 * math.pi * 51.75


@pytest.mark.parametrize("sign", [1, -1])
def test_a_lane_is_followed_so_far(monkeypatch: pytest.MonkeyPatch, sign: int) -> None:
    monkeypatch.setattr(module, "COURSE_MAX_M", 60.0)
    course = course_of(xodr(road(200.0)), lane_id=-sign, sign=sign)
    assert way_m(course) == pytest.approx(60.0)
    assert course.x_m[0] == pytest.approx(0.0 if sign > 0 else 200.0)
    assert way_m(course_of(chain())) == pytest.approx(60.0, abs=1.1)
    monkeypatch.setattr(module, "STRETCHES_MAX", 1)
    assert way_m(course_of(chain())) == pytest.approx(50.0, abs=0.01)


def test_it_ends_before_it_comes_over_itself() -> None:
    """A bend of 450 degrees leads over its own beginning."""
    straight = 120.0
    bend_m = 1.5 * math.pi * 40.0
    plan = geometry(LINE, straight)
    plan += geometry('<arc curvature="0.025"/>', bend_m, straight, (straight, 0.0, 0.0))
    plan += geometry(LINE, 200.0, straight + bend_m, (straight - 40.0, 40.0, 1.5 * math.pi))
    course = course_of(xodr(road(straight + bend_m + 200.0, plan)))
    assert not course.closed
    # The way down at x = 80 m meets the lane that goes along y = -1.75 m.
    assert course.y_m[-1] == pytest.approx(-1.75 + 4.0, abs=1.1)


def test_of_a_lane_inside_of_its_bend_only_what_leads_ahead_counts() -> None:
    """The middle of a lane 12 m inside of a bend of 10 m would run backwards."""
    wide = '<width sOffset="0" a="24" b="0" c="0" d="0"/>'
    plan = geometry(LINE, 30.0) + geometry('<arc curvature="-0.1"/>', 15.0, 30.0, (30.0, 0.0, 0.0))
    course = course_of(xodr(road(45.0, plan, section(right=lane(-1, wide)))))
    assert way_m(course) == pytest.approx(30.0, abs=1.1)
