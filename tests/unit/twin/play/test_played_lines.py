"""Lanes, marks, trajectories and routes of a played scenario against the roads themselves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from played_files import bend_place, write_cut_in

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, geometry, road, xodr

from twin.play import drawn_roads as drawing
from twin.play.drawn_paths import BegunAction, drawn_paths, route_points, trajectory_points
from twin.play.drawn_roads import AROUND_M, drawn_roads
from twin.records.play_file import points_of
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.road_map import RoadMap
from twin.road.thinning import ERROR_M, kept_points
from twin.scenario.storyboard.program.actions import (
    AcquirePositionAction,
    AssignRouteAction,
    FollowTrajectoryAction,
    VisibilityAction,
)
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
    TrajectoryPiece,
)
from twin.scenario.storyboard.program.program import Program

NEAR = (0.0, 0.0, 600.0, 200.0)


@pytest.fixture
def bend(tmp_path: Path) -> RoadMap:
    write_cut_in(tmp_path)
    return RoadMap(load_network(tmp_path / "bend.xodr"))


def away(points: np.ndarray, polyline: np.ndarray) -> np.ndarray:
    """Distances of points from a polyline in the plane [m]."""
    points, polyline = points[:, None, :2], polyline[None, :, :2]
    first, along = polyline[:, :-1], np.diff(polyline, axis=1)
    length = np.maximum((along**2).sum(axis=2), 1e-12)
    share = np.clip(((points - first) * along).sum(axis=2) / length, 0.0, 1.0)
    foot = first + share[:, :, None] * along
    return np.sqrt(((points - foot) ** 2).sum(axis=2)).min(axis=1)


def on_bend(t_m: float, low_m: float = 0.0, high_m: float = 600.0) -> np.ndarray:
    return np.array([bend_place(s, t_m) for s in np.linspace(low_m, high_m, 2000)])


def test_borders_are_within_5_cm_with_few_points(bend: RoadMap) -> None:
    drawn = drawn_roads(bend, NEAR)
    assert [lane.type for lane in drawn.lanes] == ["driving"] * 3 + ["sidewalk"]
    for lane, (left_m, right_m) in zip(
        drawn.lanes, [(3.5, 0.0), (0.0, -3.5), (-3.5, -7.0), (-7.0, -9.0)], strict=True
    ):
        left, right = points_of(lane.left), points_of(lane.right)
        assert len(left) == len(right) < 120
        for side, t_m in ((left, left_m), (right, right_m)):
            assert away(on_bend(t_m), side).max() <= ERROR_M
            assert away(side, on_bend(t_m)).max() <= ERROR_M


def test_marks_have_their_colours_strokes_and_places(bend: RoadMap) -> None:
    marks = drawn_roads(bend, NEAR).marks
    told = sorted((mark.color, mark.stroke_m, mark.gap_m, mark.width_m) for mark in marks)
    assert told == [
        ("white", 0.0, 0.0, 0.15),
        ("white", 0.0, 0.0, 0.15),
        ("white", 3.0, 6.0, 0.12),
        ("yellow", 0.0, 0.0, 0.12),
        ("yellow", 0.0, 0.0, 0.12),
    ]
    places = {
        t_m
        for mark in marks
        for t_m in (3.5, 0.12, -0.12, -3.5, -7.0)
        if away(points_of(mark.points), on_bend(t_m)).max() <= ERROR_M
    }
    assert places == {3.5, 0.12, -0.12, -3.5, -7.0}


def test_an_error_of_twice_as_much_would_be_seen(bend: RoadMap, monkeypatch) -> None:
    """The measure above is no tautology: with a coarser line it fails."""
    monkeypatch.setattr(drawing, "_THINNED_M", 4.0 * ERROR_M)
    lane = drawn_roads(bend, NEAR).lanes[0]
    assert away(on_bend(3.5), points_of(lane.left)).max() > ERROR_M


def three_roads(folder: Path) -> RoadMap:
    """Parallel ones, 200 m and 400 m from the first."""
    roads = [
        road(100.0, geometry(LINE, 100.0, at=(0.0, y, 0.0)), road_id=str(number))
        for number, y in enumerate((0.0, 200.0, 400.0))
    ]
    (folder / "three.xodr").write_bytes(xodr(*roads))
    return RoadMap(load_network(folder / "three.xodr"))


def test_roads_far_from_all_are_left_out(tmp_path: Path) -> None:
    roads = three_roads(tmp_path)
    at_first = (0.0, 0.0, 100.0, 0.0)
    assert AROUND_M == 300.0
    assert len(drawn_roads(roads, at_first).lanes) == 4
    assert len(drawn_roads(roads, (0.0, 0.0, 100.0, 150.0)).lanes) == 6


def test_of_too_many_roads_the_nearest_are_drawn_and_a_note_says_so(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(drawing, "_POINTS_MAX", 10)
    drawn = drawn_roads(three_roads(tmp_path), (0.0, 190.0, 100.0, 200.0))
    assert {points_of(lane.left)[0, 1] for lane in drawn.lanes} == {200.0, 203.5}
    assert drawn.notes == ["2 roads are not drawn: they have too many points"]


def test_thinning_keeps_corners_and_ends() -> None:
    at = np.arange(7.0)
    corner = np.array([(x, max(x - 3.0, 0.0), 0.0) for x in at])
    straight = np.stack([at, np.zeros(7), np.zeros(7)], axis=-1)
    assert kept_points(at, straight[:, None], 0.01).tolist() == [0, 6]
    both = np.stack([straight, corner], axis=1)
    assert kept_points(at, both, 0.01).tolist() == [0, 3, 6]
    assert kept_points(at[:1], straight[:1, None], 0.01).tolist() == [0]


def quarter(from_actor: bool = False) -> Trajectory:
    """A cubic that bends to the left, and a straight piece."""
    bent = TrajectoryPiece(
        start_s_m=0.0, length_m=20.0,
        x=(0.0, 1.0, 0.0, 0.0), y=(0.0, 0.0, 0.01, 0.0), z=(0.0,) * 4, heading=(0.0,) * 4,
    )  # fmt: skip
    on = TrajectoryPiece(
        start_s_m=20.0, length_m=10.0,
        x=(20.0, 1.0, 0.0, 0.0), y=(4.0, 0.4, 0.0, 0.0), z=(0.0,) * 4, heading=(0.0,) * 4,
    )  # fmt: skip
    return Trajectory(
        name="quarter", closed=False, timed=False, pieces=(bent, on), from_actor=from_actor
    )


def program(**parts: object) -> Program:
    return Program(name="p", entities=(), elements=(), init=(), **parts)  # type: ignore[arg-type]


def follow(index: int = 0) -> FollowTrajectoryAction:
    return FollowTrajectoryAction(
        trajectory=index, timed=False, absolute_time=False, time_scale=1.0, time_offset_s=0.0,
        follow=False, initial_distance_m=0.0,
    )  # fmt: skip


def test_a_trajectory_is_within_5_cm_of_its_pieces() -> None:
    points = trajectory_points(quarter())
    s = np.linspace(0.0, 20.0, 500)
    exact = np.stack([s, 0.01 * s * s, 0.0 * s], axis=-1)
    assert away(exact, points).max() <= ERROR_M
    assert points[-1].tolist() == pytest.approx([30.0, 8.0, 0.0])
    assert 5 <= len(points) <= 20
    assert trajectory_points(Trajectory("none", False, False, ())).shape == (0, 3)


def test_a_trajectory_of_the_world_is_drawn_once_and_one_of_the_actor_where_it_began() -> None:
    begun = [BegunAction(follow(), actor, (5.0, 6.0, 1.0, math.pi / 2)) for actor in (0, 1)]
    [drawn] = drawn_paths(program(trajectories=(quarter(),)), None, begun)
    assert (drawn.kind, drawn.name) == ("trajectory", "quarter")
    assert points_of(drawn.points)[0, :2].tolist() == [0.0, 0.0]
    moved = drawn_paths(program(trajectories=(quarter(from_actor=True),)), None, begun)
    assert len(moved) == 2
    first, last = points_of(moved[0].points)[[0, -1]]
    assert first.tolist() == pytest.approx([5.0, 6.0, 1.05])
    assert last.tolist() == pytest.approx([5.0 - 8.0, 6.0 + 30.0, 1.05])


def test_a_route_runs_in_the_middle_of_its_lanes_and_backwards_where_it_goes_so(
    bend: RoadMap,
) -> None:
    legs = (RouteLeg(road=0, from_s_m=100.0, to_s_m=400.0, lane=-2),)
    points = route_points(RoadRoute("r", False, legs), bend)
    assert away(on_bend(-5.25, 100.0, 400.0), points).max() <= ERROR_M
    back = (RouteLeg(road=0, from_s_m=400.0, to_s_m=100.0, lane=-2),)
    assert np.array_equal(route_points(RoadRoute("r", False, back), bend), points[::-1])
    # A lane that the road does not have: its centre line.
    lost = (RouteLeg(road=0, from_s_m=0.0, to_s_m=600.0, lane=7),)
    assert away(on_bend(0.0), route_points(RoadRoute("r", False, lost), bend)).max() <= ERROR_M


def test_only_what_was_begun_is_drawn(bend: RoadMap) -> None:
    legs = (RouteLeg(road=0, from_s_m=0.0, to_s_m=50.0, lane=-1),)
    whole = program(
        trajectories=(quarter(),), routes=(RoadRoute("r", False, legs), RoadRoute("s", False, legs))
    )
    here = (0.0, 0.0, 0.0, 0.0)
    assert drawn_paths(whole, bend, []) == []
    begun = [
        BegunAction(AssignRouteAction(route=1), 0, here),
        BegunAction(VisibilityAction(True, True, True), 0, here),
        BegunAction(AssignRouteAction(route=1), 1, here),
    ]
    assert [(path.kind, path.name) for path in drawn_paths(whole, bend, begun)] == [("route", "s")]


def test_an_acquired_position_is_reached_along_the_road_the_actor_stands_on(bend: RoadMap) -> None:
    legs = (RouteLeg(road=0, from_s_m=0.0, to_s_m=50.0, lane=-1),)
    routes = tuple(RoadRoute(name, False, legs) for name in ("along", "against"))
    place = FixedPosition(x_m=50.0, y_m=0.0, z_m=0.0, heading_rad=0.0)
    action = AcquirePositionAction(position=place, routes=(0, 1))

    def names(x: float, y: float, heading: float) -> list[str]:
        begun = [BegunAction(action, 0, (x, y, 0.0, heading))]
        return [path.name for path in drawn_paths(program(routes=routes), bend, begun)]

    assert names(20.0, -1.0, 0.1) == ["along"]
    assert names(20.0, 1.0, 3.0) == ["against"]
    assert names(20.0, 99.0, 0.0) == []
