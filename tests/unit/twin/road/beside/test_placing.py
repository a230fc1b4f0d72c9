"""Bodies of a road file's objects: places computed by hand, rows, outlines, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import geometry
from road_furniture import repeat, road_object, with_furniture

from twin.road.beside.bodies import OutlineBody, StandingBody, SweptBody
from twin.road.beside.paint import object_paint
from twin.road.beside.placing import BODIES_MAX, CHORD_M, roadside_bodies
from twin.road.beside.polygons import band_of, signed_area, triangles_of
from twin.road.opendrive.check_network import network_mistakes
from twin.road.opendrive.reading.read_furniture import CORNERS_MAX, REPEATS_MAX
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.road_map import RoadMap

ARC = geometry('<arc curvature="0.02"/>', 100.0)
"""Radius 50 m to the left, centre at (0, 50)."""


def roads_with(objects: str, **more: object) -> RoadMap:
    network = read_network(with_furniture(objects, **more), "t.xodr")
    assert network_mistakes(network) == []
    return RoadMap(network)


def bodies_of(objects: str, **more: object) -> list[object]:
    return roadside_bodies(roads_with(objects, **more))


def test_a_box_stands_at_s_and_t_and_turns_with_the_road():
    (body,) = bodies_of(
        road_object(
            "obstacle", 25 * math.pi, -3, length=2, width=1, height=4, zOffset=0.5, hdg=0.1
        ),
        plan=ARC,
    )
    # A quarter of the circle: the road leads to +y at (50, 50); 3 m to its right is x = 53.
    assert isinstance(body, StandingBody)
    assert body.position_m == pytest.approx((53.0, 50.0, 0.5), abs=1e-6)
    assert body.heading_rad == pytest.approx(0.5 * math.pi + 0.1, abs=1e-6)
    assert body.size_m == (2.0, 1.0, 4.0)
    assert body.above_m == 0.5


def test_objects_stand_on_the_surface_of_hills_and_tilted_roads():
    profiles = '<elevationProfile><elevation s="0" a="2" b="0.1" c="0" d="0"/></elevationProfile>'
    profiles += (
        '<lateralProfile><superelevation s="0" a="0.05" b="0" c="0" d="0"/></lateralProfile>'
    )
    (body,) = bodies_of(road_object("pole", 40, -4, radius=0.1, height=3), more=profiles)
    assert body.position_m == pytest.approx(
        (40.0, -4.0 * math.cos(0.05), 6.0 - 4.0 * math.sin(0.05)), abs=1e-6
    )


def test_a_row_changes_evenly_and_takes_the_place_of_the_object():
    row = repeat(10, 60, 20, tStart=5, tEnd=8, heightStart=1, heightEnd=4, radiusStart=0.1)
    rows = bodies_of(road_object("pole", 3, 0, row, radius=9, height=9))
    assert [body.position_m for body in rows] == [
        pytest.approx((10.0 + 20.0 * k, 5.0 + k, 0.0), abs=1e-9) for k in range(4)
    ]
    assert [body.size_m[2] for body in rows] == pytest.approx([1.0, 2.0, 3.0, 4.0])
    assert [body.radius_m for body in rows] == pytest.approx([0.1] * 4)
    assert [body.number for body in rows] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("length", "distance", "count"), [(60, 7, 9), (60, 0.1, 601), (0, 5, 1), (0, 0, 1), (5, 6, 1)]
)
def test_as_many_stand_in_a_row_as_fit(length, distance, count):
    assert len(bodies_of(road_object("pole", 0, 5, repeat(20, length, distance)))) == count


def test_a_row_that_leaves_the_road_is_cut_and_said():
    roads = roads_with(road_object("pole", 0, 5, repeat(90, 50, 5)))
    assert [body.position_m[0] for body in roadside_bodies(roads)] == pytest.approx([90, 95, 100])
    assert any("the road is 100 m long" in note for note in roads.network.notes)


def test_a_rail_follows_a_curve_within_a_centimetre():
    rail = repeat(0, 100, 0, tStart=-4, tEnd=-4, heightStart=0.7, widthStart=0.2, widthEnd=0.4)
    (body,) = bodies_of(road_object("barrier", 0, 0, rail), plan=ARC)
    assert isinstance(body, SweptBody)
    left, right = body.left_m[:, :2], body.right_m[:, :2]
    inner, outer = (np.hypot(*(line - (0.0, 50.0)).T) for line in (left, right))
    assert inner[[0, -1]] == pytest.approx([53.9, 53.8], abs=1e-6)
    assert outer[[0, -1]] == pytest.approx([54.1, 54.2], abs=1e-6)
    middle = np.hypot(*(0.5 * (left[1:] + left[:-1]) - (0.0, 50.0)).T)
    assert (0.5 * (inner[1:] + inner[:-1]) - middle).max() < 1.01 * CHORD_M
    assert body.height_m == pytest.approx(0.7)
    assert len(left) < 80


def test_outlines_in_both_kinds_of_coordinates():
    local = "".join(
        f'<cornerLocal u="{u}" v="{v}" z="0.2" height="{h}"/>'
        for u, v, h in ((-1, -2, 3), (1, -2, 3), (1, 2, 5), (-1, 2, 5), (-1, -2, 3))
    )
    along = '<cornerRoad s="10" t="6" dz="0.1" height="1"/><cornerRoad s="30" t="7" height="2"/>'
    outlines = f'<outlines><outline id="0">{local}</outline>'
    outlines += f'<outline id="1" closed="false">{along}</outline></outlines>'
    box, wall = bodies_of(road_object("building", 50, 10, outlines, hdg=0.5 * math.pi))
    assert isinstance(box, OutlineBody)
    assert isinstance(wall, OutlineBody)
    assert box.base_m == pytest.approx(
        np.array([(52, 9, 0.2), (52, 11, 0.2), (48, 11, 0.2), (48, 9, 0.2)]), abs=1e-6
    ), "a corner that is named again is left out"
    assert box.height_m.tolist() == [3, 3, 5, 5]
    assert box.closed
    assert wall.base_m == pytest.approx(np.array([(10, 6, 0.1), (30, 7, 0.0)]), abs=1e-9)
    assert not wall.closed


def test_local_outlines_are_repeated_and_those_of_the_road_stand_once():
    corners = [(0, 0), (2, 0), (2, 1)]
    local = "".join(f'<cornerLocal u="{u}" v="{v}" z="0" height="1"/>' for u, v in corners)
    fixed = "".join(f'<cornerRoad s="{s}" t="{t}" dz="0" height="1"/>' for s, t in corners)
    row = repeat(10, 40, 10, tStart=5, tEnd=5)
    turning = bodies_of(road_object("obstacle", 0, 0, f"<outline>{local}</outline>{row}"))
    assert [body.base_m[0].tolist() for body in turning] == [
        pytest.approx([10.0 + 10.0 * k, 5.0, 0.0]) for k in range(5)
    ]
    assert len(bodies_of(road_object("obstacle", 0, 0, f"<outline>{fixed}</outline>{row}"))) == 1


def test_a_crosswalk_has_stripes_along_the_road():
    roads = roads_with(road_object("crosswalk", 50, 0, length=4, width=7, hdg=0.0))
    patches = object_paint(roads, roadside_bodies(roads)[0])
    spans = [(p.points_m.min(axis=0), p.points_m.max(axis=0)) for p in patches]
    assert len(spans) == 7
    for number, (low, high) in enumerate(spans):
        begin = -3.25 + number
        assert low == pytest.approx((48.0, begin, 0.006), abs=1e-6)
        assert high == pytest.approx((52.0, begin + 0.5, 0.006), abs=1e-6)


def test_a_crosswalk_that_is_turned_still_has_stripes_along_the_road():
    roads = roads_with(road_object("crosswalk", 50, 0, length=7, width=4, hdg=0.5 * math.pi))
    patches = object_paint(roads, roadside_bodies(roads)[0])
    assert len(patches) == 7
    assert np.ptp(patches[0].points_m, axis=0) == pytest.approx((4.0, 0.5, 0.0), abs=1e-6)


def test_a_parking_space_has_a_line_inside_its_outline():
    roads = roads_with(road_object("parkingSpace", 50, -5, length=5, width=2))
    patches = object_paint(roads, roadside_bodies(roads)[0])
    points = np.concatenate([patch.points_m for patch in patches])
    assert points[:, :2].min(axis=0) == pytest.approx((47.5, -6.0), abs=1e-6)
    assert points[:, :2].max(axis=0) == pytest.approx((52.5, -4.0), abs=1e-6)
    area = sum(
        abs(signed_area(patch.points_m[face][:, :2])) for patch in patches for face in patch.faces
    )
    assert area == pytest.approx(0.12 * 2 * (5 + 2), rel=1e-6)


@pytest.mark.parametrize("turn", [1, -1])
def test_triangles_cover_a_polygon_that_is_not_convex(turn):
    ring = np.array([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (4, 3), (4, 4), (0, 4)], float)[::turn]
    faces = triangles_of(ring)
    areas = [signed_area(ring[face]) for face in faces]
    assert sum(areas) == pytest.approx(10.0)
    assert min(areas) > 0.0


def test_polygons_that_are_none_give_no_trouble():
    assert triangles_of(np.zeros((2, 2))).shape == (0, 3)
    assert triangles_of(np.zeros((6, 2))).shape == (4, 3)
    bow = np.array([(0, 0), (2, 2), (2, 0), (0, 2)], float)
    assert triangles_of(bow).shape == (2, 3)
    assert not len(band_of(bow, 5.0, 6.0))


def many_corners(count: int) -> str:
    corner = '<cornerLocal u="{}" v="{}" z="0" height="1"/>'
    text = "".join(corner.format(k, k**3) for k in range(count))
    return f"<outline>{text}</outline>"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (road_object("pole", 5, 5, height=-1), "height='-1'; at least 0"),
        (road_object("pole", 5, 5, radius="nan"), "radius='nan'"),
        (road_object("pole", 5, 5, repeat(0, 50, -1)), "distance='-1'; at least 0"),
        (road_object("pole", 5, 5, repeat(0, 50, 1, heightStart=-2)), "heightStart='-2'"),
        (road_object("pole", 5, 5, repeat(0, 50, 1, widthEnd="inf")), "widthEnd='inf'"),
        (road_object("pole", 5, 5, repeat(200, 5, 1)), "s=200, but the road is 100 m long"),
        (road_object("pole", 5, 5, repeat(0, 100, 1e-4)), "1000001 objects in a row; at most"),
        (road_object("pole", 5, 5, repeat(0, 100, 1e-99)), f"at most {REPEATS_MAX}"),
        (road_object("pole", 5, 5, '<repeat s="0" length="9"/>'), "distance is missing"),
        (road_object("pole", 5, 5, many_corners(CORNERS_MAX + 1)), f"at most {CORNERS_MAX}"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_file_and_line(text, words):
    with pytest.raises(ValueError, match=r"^t\.xodr:\d+: <") as error:
        read_network(with_furniture(text), "t.xodr")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_too_many_objects_are_one_line():
    row = repeat(0, 100, 0.011)
    rows = "".join(road_object("pole", 5, 5, row, id=number) for number in range(6))
    with pytest.raises(ValueError, match=f"at most {BODIES_MAX} are shown") as error:
        bodies_of(rows)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (road_object("building", 5, 5, length=9e8, width=5, height=3), "9e+08 m large"),
        (road_object("pole", 5, 1e6, height=3), "1000000 m from the origin"),
        (road_object("pole", 5, 5, height=3, zOffset=-2e5), "200000 m from the origin"),
        (road_object("barrier", 0, 5, repeat(0, 50, 0, heightStart=5000)), "5000 m large"),
        (road_object("obstacle", 5, 5, many_corners(60)), "m large"),
    ],
)
def test_what_is_too_large_or_too_far_is_one_line(text, words):
    with pytest.raises(ValueError, match=r"^t\.xodr:\d+: <object>: ") as error:
        bodies_of(text)
    assert words in str(error.value)
