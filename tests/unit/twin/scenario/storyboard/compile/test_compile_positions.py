"""Positions of every type become places; orientations are relative or absolute."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import ROADS, TELEPORT, compiled, scenario_text

from twin.scenario.storyboard.program.actions import TeleportAction
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    Position,
    RelativeFrame,
    RelativePosition,
)


def _position(folder: Path, text: str, roads: str = ROADS) -> Position:
    init = f"<PrivateAction>{TELEPORT.format(text)}</PrivateAction>"
    program = compiled(folder, scenario_text(init=init), roads).program
    action = program.init[0].action
    assert isinstance(action, TeleportAction)
    return action.position


def _fixed(folder: Path, text: str) -> FixedPosition:
    position = _position(folder, text)
    assert isinstance(position, FixedPosition)
    return position


def _close(place: FixedPosition, x: float, y: float, heading: float) -> None:
    assert place.x_m == pytest.approx(x, abs=1e-6)
    assert place.y_m == pytest.approx(y, abs=1e-6)
    turn = math.remainder(place.heading_rad - heading, 2.0 * math.pi)
    assert turn == pytest.approx(0.0, abs=1e-6)


ORIENTATION = '<Orientation h="0.1" type="{}"/>'


@pytest.mark.parametrize(
    ("text", "x", "y", "heading"),
    [
        ('<LanePosition roadId="a" laneId="-1" s="50" offset="0.5"/>', 50, -1.25, 0.0),
        ('<LanePosition roadId="a" laneId="2" s="50" offset="0.5"/>', 50, 5.75, math.pi),
        (
            f'<LanePosition roadId="a" laneId="1" s="9">{ORIENTATION.format("relative")}'
            "</LanePosition>",
            *(9, 1.75, math.pi + 0.1),
        ),
        (
            f'<LanePosition roadId="a" laneId="1" s="9">{ORIENTATION.format("absolute")}'
            "</LanePosition>",
            *(9, 1.75, 0.1),
        ),
        ('<RoadPosition roadId="a" s="50" t="3"/>', 50, 3, 0.0),
        (
            f'<RoadPosition roadId="a" s="50" t="3">{ORIENTATION.format("relative")}'
            "</RoadPosition>",
            *(50, 3, 0.1),
        ),
        ('<WorldPosition x="3" y="4" h="1"/>', 3, 4, 1.0),
    ],
)
def test_place_and_heading(tmp_path: Path, text: str, x: float, y: float, heading: float) -> None:
    _close(_fixed(tmp_path, text), x, y, heading)


@pytest.mark.parametrize(("version", "heading"), [("3", math.pi + 0.1), ("2", 0.1)])
def test_orientations_without_a_type(tmp_path: Path, version: str, heading: float) -> None:
    lane = '<LanePosition roadId="a" laneId="1" s="9"><Orientation h="0.1"/></LanePosition>'
    text = scenario_text(init=f"<PrivateAction>{TELEPORT.format(lane)}</PrivateAction>")
    program = compiled(tmp_path, text.replace('revMinor="3"', f'revMinor="{version}"')).program
    action = program.init[0].action
    assert isinstance(action, TeleportAction)
    assert isinstance(action.position, FixedPosition)
    _close(action.position, 9, 1.75, heading)


def test_on_an_arc(tmp_path: Path) -> None:
    place = _fixed(tmp_path, '<LanePosition roadId="b" laneId="-2" s="100"/>')
    radius = 100 + 5.25
    _close(place, 200 + radius * math.sin(1.0), 100 - radius * math.cos(1.0), 1.0)
    assert (place.road, place.s_m, place.lane) == (1, 100.0, -2)
    assert place.t_m == pytest.approx(-5.25)


def test_the_lane_under_a_place_of_the_world(tmp_path: Path) -> None:
    place = _fixed(tmp_path, '<WorldPosition x="60" y="-4"/>')
    assert (place.road, place.lane) == (0, -2)
    assert place.s_m == pytest.approx(60)
    assert place.lane_offset_m == pytest.approx(-4 + 5.25)
    beside = _fixed(tmp_path, '<WorldPosition x="60" y="-40"/>')
    assert (beside.road, beside.lane) == (-1, 0)


ROUTE = (
    '<RoutePosition><RouteRef><Route name="r" closed="false">'
    '<Waypoint routeStrategy="shortest"><Position><LanePosition roadId="{0}" laneId="{2}" '
    's="{3}"/></Position></Waypoint><Waypoint routeStrategy="shortest"><Position>'
    '<LanePosition roadId="{1}" laneId="{2}" s="{4}"/></Position></Waypoint></Route></RouteRef>'
    "<InRoutePosition>{5}</InRoutePosition></RoutePosition>"
)


def test_on_a_route_along_both_roads(tmp_path: Path) -> None:
    inside = '<FromRoadCoordinates pathS="{}" t="-1"/>'
    place = _fixed(tmp_path, ROUTE.format("a", "b", "-1", 20, 30, inside.format(100)))
    _close(place, 120, -1, 0.0)
    place = _fixed(tmp_path, ROUTE.format("a", "b", "-1", 20, 30, inside.format(190)))
    assert (place.road, place.s_m) == (1, pytest.approx(10))


def test_on_a_route_against_the_roads(tmp_path: Path) -> None:
    road = '<FromRoadCoordinates pathS="50" t="1"/>'
    place = _fixed(tmp_path, ROUTE.format("b", "a", "1", 30, 20, road))
    _close(place, 180, 1, math.pi)
    lane = '<FromLaneCoordinates pathS="50" laneId="-1"/>'
    place = _fixed(tmp_path, ROUTE.format("b", "a", "1", 30, 20, lane))
    _close(place, 180, -1.75, 0.0)


def test_on_a_trajectory(tmp_path: Path) -> None:
    corner = "".join(
        f'<Vertex><Position><WorldPosition x="{x}" y="{y}"/></Position></Vertex>'
        for x, y in ((0, 0), (10, 0), (10, 10))
    )
    text = (
        '<TrajectoryPosition s="14" t="1"><TrajectoryRef><Trajectory name="t" closed="false">'
        f"<Shape><Polyline>{corner}</Polyline></Shape></Trajectory></TrajectoryRef>"
        "</TrajectoryPosition>"
    )
    _close(_fixed(tmp_path, text), 9, 4, math.pi / 2)


@pytest.mark.parametrize(
    ("text", "frame", "values", "lanes"),
    [
        ('<RelativeWorldPosition entityRef="Other" dx="1" dy="2"/>', "WORLD", (1, 2, 0), 0),
        (
            '<RelativeObjectPosition entityRef="Other" dx="1" dy="2" dz="3"/>',
            "OBJECT",
            (1, 2, 3),
            0,
        ),
        ('<RelativeRoadPosition entityRef="Other" ds="5" dt="1"/>', "ROAD", (5, 1, 0), 0),
        (
            '<RelativeLanePosition entityRef="Other" dLane="-1" ds="5" offset="0.5"/>',
            *("LANE", (5, 0.5, 0), -1),
        ),
        (
            '<RelativeLanePosition entityRef="Other" dLane="1" dsLane="7"/>',
            *("LANE_LENGTH", (7, 0, 0), 1),
        ),
    ],
)
def test_relative_ones_stay(
    tmp_path: Path, text: str, frame: str, values: tuple[float, ...], lanes: int
) -> None:
    position = _position(tmp_path, text)
    assert isinstance(position, RelativePosition)
    assert position.frame is RelativeFrame[frame]
    assert (position.a, position.b, position.c) == values
    assert (position.entity, position.lanes, position.relative_orientation) == (1, lanes, True)


def test_absolute_heading_of_a_relative_one(tmp_path: Path) -> None:
    position = _position(
        tmp_path,
        '<RelativeObjectPosition entityRef="Other" dx="1" dy="2"><Orientation h="1" '
        'type="absolute"/></RelativeObjectPosition>',
    )
    assert isinstance(position, RelativePosition)
    assert (position.heading_rad, position.relative_orientation) == (1.0, False)


PROJ = "+proj=tmerc +lat_0=48 +lon_0=11 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
METRE_DEG = math.degrees(1.0 / 6367.0e3)
"""About a metre to the north, near enough for places within a few metres."""


def _with_reference(reference: str, offset: str = "") -> str:
    inner = f"<geoReference><![CDATA[{reference}]]></geoReference>{offset}"
    return re.sub(r"<header ([^>]*)/>", rf"<header \1>{inner}</header>", ROADS)


def test_by_latitude_and_longitude(tmp_path: Path) -> None:
    """The origin of the map, and places on the road near it."""
    text = '<GeoPosition latitudeDeg="48" longitudeDeg="11">{}</GeoPosition>'
    roads = _with_reference(PROJ)
    place = _position(tmp_path, text.format('<Orientation h="0.1"/>'), roads)
    assert isinstance(place, FixedPosition)
    _close(place, 0.0, 0.0, 0.1)
    assert (place.road, place.lane) == (0, -1)
    moved = _with_reference(PROJ, '<offset x="-20" y="1.75" z="5" hdg="0"/>')
    place = _position(tmp_path, text.format(""), moved)
    assert isinstance(place, FixedPosition)
    _close(place, 20.0, -1.75, 0.0)
    assert (place.lane, place.s_m) == (-1, pytest.approx(20.0))


def test_in_radians_and_above_the_road(tmp_path: Path) -> None:
    latitude, longitude = math.radians(48.0 + 2 * METRE_DEG), math.radians(11.0)
    text = f'<GeoPosition latitude="{latitude!r}" longitude="{longitude!r}" altitude="1.5"/>'
    place = _position(tmp_path, text, _with_reference(PROJ))
    assert isinstance(place, FixedPosition)
    assert place.y_m == pytest.approx(2.0, abs=0.01)
    assert (place.z_m, place.lane) == (1.5, 1)


@pytest.mark.parametrize(
    ("attributes", "roads", "words"),
    [
        ('latitudeDeg="48" longitudeDeg="11"', ROADS, "the road file has no geoReference"),
        ('latitudeDeg="48"', _with_reference(PROJ), "give either longitudeDeg or longitude"),
        (
            'latitudeDeg="48" latitude="0.8" longitudeDeg="11"',
            _with_reference(PROJ),
            "give either latitudeDeg or latitude",
        ),
        ('latitudeDeg="90" longitudeDeg="11"', _with_reference(PROJ), "latitude 90 degrees"),
        (
            'latitudeDeg="48" longitudeDeg="11"',
            _with_reference("+proj=merc"),
            "+proj=merc is not understood",
        ),
        (
            'latitudeDeg="48" longitudeDeg="11"',
            _with_reference(PROJ, '<offset x="0" y="0" z="0" hdg="0.1"/>'),
            "an offset with hdg",
        ),
    ],
)
def test_what_has_no_place_on_the_map(
    tmp_path: Path, attributes: str, roads: str, words: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(words)) as failure:
        _position(tmp_path, f"<GeoPosition {attributes}/>", roads)
    assert f"{tmp_path}/s.xosc:" in str(failure.value)
    assert "GeoPosition" in str(failure.value)
