"""twin.road.walk: places, headings, lanes against RoadFrame, which computes them exactly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_networks import SHAPES, composed, junction, shapes, turned
from road_walks import Walks

from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.records import DRIVEN_TYPES, RoadNetwork
from twin.road.opendrive.road_frame import traffic_sign
from twin.road.opendrive.road_map import RoadMap
from twin.road.tables.road_tables import LANE_TYPE_CODES, flat_tables, road_tables

FILES = Path(__file__).parents[3] / "shared" / "data" / "openscenario"
PLACE_M = 1e-5
HEADING_RAD = 1e-6
NETWORKS = {
    "shapes": shapes,
    "shapes, left-hand": lambda: shapes("LHT"),
    "composed": composed,
    "turned": turned,
    "junction": junction,
}


def turn(angle: np.ndarray) -> np.ndarray:
    return np.abs(np.mod(angle + math.pi, 2.0 * math.pi) - math.pi)


def compare_poses(network: RoadNetwork, count: int = 2000) -> tuple[float, float]:
    """Largest errors of places [m], where t is 0, and of headings [rad]; other columns too."""
    walks = Walks(road_tables(network))
    rng = np.random.default_rng(7)
    worst = [0.0, 0.0]
    for number, frame in enumerate(RoadMap(network).frames.values()):
        s = np.append(rng.uniform(0.0, frame.road.length_m, count), [0.0, frame.road.length_m])
        for t in (0.0, rng.uniform(-9.0, 9.0, len(s))):
            exact, rows = frame.pose(s, t), walks.pose(number, s, t)
            off = np.sqrt(
                (exact.x_m - rows[:, 0]) ** 2
                + (exact.y_m - rows[:, 1]) ** 2
                + (exact.z_m - rows[:, 2]) ** 2
            )
            # Beside the line the error of the heading comes on top, times t.
            assert off.max() < PLACE_M + 9.0 * HEADING_RAD
            heading = turn(exact.heading_rad - rows[:, 3]).max()
            worst = [
                max(worst[0], off.max()) if np.all(t == 0.0) else worst[0],
                max(worst[1], heading),
            ]
            np.testing.assert_allclose(rows[:, 4], exact.pitch_rad, atol=2e-5)
            np.testing.assert_allclose(rows[:, 5], exact.roll_rad, atol=2e-5)
        np.testing.assert_allclose(rows[:, 6], frame.curvature(s), rtol=2e-5, atol=2e-5)
    return worst[0], worst[1]


@pytest.mark.parametrize("name", NETWORKS)
def test_poses_are_within_the_promised_error(name):
    place, heading = compare_poses(NETWORKS[name]())
    assert place < PLACE_M
    assert heading < HEADING_RAD


@pytest.mark.slow
@pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")
def test_poses_on_roads_of_others():
    paths = sorted(FILES.rglob("*.xodr"))
    assert len(paths) == 12
    worst = np.max([compare_poses(load_network(path), 500) for path in paths], axis=0)
    print(f"12 files: {worst[0]:.2e} m, {worst[1]:.2e} rad")
    assert worst[0] < PLACE_M
    assert worst[1] < HEADING_RAD


def test_a_way_along_a_lane_heads_as_the_lane():
    network = shapes()
    walks = Walks(road_tables(network))
    for number, frame in enumerate(RoadMap(network).frames.values()):
        s = np.linspace(0.5, 10.5, 50)
        lanes = walks.lanes(number, s, lane=-2)
        rows = walks.pose(number, s, lanes[:, 0], lanes[:, 1])
        exact = frame.lane_pose(-2, s)
        assert turn(exact.heading_rad - rows[:, 3]).max() < 2.0 * HEADING_RAD
        np.testing.assert_allclose(rows[:, 4], exact.pitch_rad, atol=2e-5)
        np.testing.assert_allclose(rows[:, 5], exact.roll_rad, atol=2e-5)


def compare_lanes(network: RoadNetwork, count: int = 400) -> int:
    """Every lane function at many places; how many lanes were met."""
    walks = Walks(road_tables(network))
    rng = np.random.default_rng(3)
    met = 0
    for number, frame in enumerate(RoadMap(network).frames.values()):
        starts = [section.start_m for section in frame.road.sections]
        s = np.append(rng.uniform(0.0, frame.road.length_m, count), [*starts, frame.road.length_m])
        t = rng.uniform(-12.0, 12.0, len(s))
        rows = walks.lanes(number, s, t)
        assert rows[:, 3].tolist() == frame.lane_at(s, t).tolist()
        assert np.all(rows[:, 10] == frame.road.length_m)
        index = frame.section_at(s)
        for k, cross in enumerate(frame.sections):
            at, section = s[index == k], cross.section
            assert np.all(rows[index == k, 8] == len(section.left))
            assert np.all(rows[index == k, 9] == len(section.right))
            for lane in section.lanes:
                rows_of = walks.lanes(number, at, lane=lane.id)
                centre, slope = cross.centre(lane.id, at)
                np.testing.assert_allclose(rows_of[:, 0], centre, atol=1e-12)
                np.testing.assert_allclose(rows_of[:, 1], slope, atol=1e-12)
                np.testing.assert_allclose(rows_of[:, 2], cross.width(lane.id, at), atol=1e-12)
                assert np.all(rows_of[:, 4] == 1.0)
                assert np.all(rows_of[:, 5] == traffic_sign(frame.road, lane))
                assert np.all(rows_of[:, 6] == LANE_TYPE_CODES.index(lane.type))
                assert np.all(rows_of[:, 12] == (lane.type in DRIVEN_TYPES))
                met += len(at)
    return met


@pytest.mark.parametrize("name", NETWORKS)
def test_lanes_are_those_of_the_frame(name):
    assert compare_lanes(NETWORKS[name]()) > 400


@pytest.mark.slow
@pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")
def test_lanes_on_roads_of_others():
    for path in sorted(FILES.rglob("*.xodr")):
        assert compare_lanes(load_network(path), 100) > 100, path


def test_a_lane_that_is_not_there():
    walks = Walks(road_tables(turned()))
    for lane in (5, 3, -3, -90, 0):
        row = walks.lanes(0, 10.0, lane=lane)[0]
        assert row[[2, 4, 5, 12]].tolist() == [0.0, 0.0, 0.0, 0.0]
        assert row[6] == -1.0


@pytest.mark.parametrize(
    ("lane", "steps", "expected"),
    [
        (1, 1, 2),
        (1, -1, -1),
        (-1, 1, 1),
        (-2, 2, 1),
        (2, -3, -2),
        (1, 0, 1),
        (2, 1, 0),
        (-1, -2, 0),
    ],
)
def test_lanes_beside_skip_the_centre(lane, steps, expected):
    walks = Walks(road_tables(turned()))
    assert walks.lanes(0, 10.0, lane=lane, steps=steps)[0, 7] == expected


def test_arcs_are_cut_by_their_error_and_lines_are_not():
    tables = road_tables(shapes())
    parts = dict(zip(SHAPES, np.diff(tables.roads[:, 0]).tolist(), strict=True))
    assert parts["line"] == 1
    assert 60 <= parts["left arc"] <= 128
    assert parts["right arc"] <= 64
    assert sum(parts.values()) < 600


def test_flat_ground():
    walks = Walks(flat_tables())
    row = walks.pose(-1, 3.0, -4.0)[0]
    assert row.tolist() == [3.0, -4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert walks.lanes(-1, 3.0, 1.0, -1, 1)[0].tolist() == [0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0]
