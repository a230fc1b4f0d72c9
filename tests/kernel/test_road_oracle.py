"""Cars at constant speed on made-up roads, step by step against another player (esmini)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from esmini_play import ESMINI, STEP_S, PlayedCar, play
from road_files import road, xodr
from road_networks import SHAPES, composed_file, junction_file, shapes_file, turned_file
from road_walks import Walks

from twin.road.opendrive.reading.reader import read_network
from twin.road.tables.road_tables import road_tables

pytestmark = pytest.mark.skipif(not ESMINI.is_file(), reason=f"{ESMINI} is missing")

SPEED_MPS = 20.0
SAME_M = 1e-5
SAME_RAD = 2e-6


def compare(
    road_file: bytes,
    cars: list[PlayedCar],
    folder: Path,
    until_s: float,
    route: list[int] | None = None,
) -> np.ndarray:
    """Differences by step and car: in the plane [m], of the heading [rad] [T, cars, 2]."""
    theirs = play(road_file, cars, SPEED_MPS, until_s, folder)
    walks = Walks(road_tables(read_network(road_file, "t")))
    roads = [walks.tables.road_ids.index(car.road) for car in cars]
    s, lane, offset = (np.array([getattr(c, k) for c in cars]) for k in ("s_m", "lane", "offset_m"))
    sign = walks.lanes(roads, s, lane=lane)[:, 5]
    here = (np.array(roads, float), lane, s, offset, sign)
    route_at = 0
    rows = []
    for step in range(len(theirs)):
        moved = walks.advance(
            *here, SPEED_MPS * STEP_S if step else 0.0, route=route, route_at=route_at
        )
        here = (moved.road, moved.lane, moved.s, moved.offset, moved.sign)
        route_at = int(moved.route_at[0])
        pose = walks.pose(moved.road, moved.s, moved.t, moved.slope)
        off = np.hypot(*(theirs[step, :, :2] - pose[:, :2]).T)
        facing = pose[:, 3] + np.where(moved.sign < 0, math.pi, 0.0)
        turned = np.mod(theirs[step, :, 3] - facing + math.pi, 2.0 * math.pi) - math.pi
        rows.append(np.column_stack([off, np.abs(turned)]))
    assert len(rows) == round(until_s / STEP_S) + 2
    return np.array(rows)


def test_over_ends_that_meet_head_on(tmp_path):
    """To the end of the network, where cars of both stop."""
    cars = [
        PlayedCar("0", -1, 5.0, 0.3),
        PlayedCar("0", -2, 5.0, -0.4),
        PlayedCar("2", 1, 45.0, 0.2),
        PlayedCar("1", 2, 5.0, 0.1),
        PlayedCar("1", -1, 5.0),
    ]
    rows = compare(turned_file(), cars, tmp_path, 7.0)
    assert rows[..., 0].max() < SAME_M
    assert rows[..., 1].max() < SAME_RAD


def test_a_spiral_beside_the_line(tmp_path):
    """The way is longer outside and shorter inside of a bend that tightens."""
    cars = [PlayedCar("0", -1, 2.0, o) for o in (0.3, -8.0, 9.0)] + [PlayedCar("0", 1, 119.0)]
    rows = compare(composed_file(), cars, tmp_path, 4.5)
    assert rows[..., 0].max() < SAME_M
    assert rows[..., 1].max() < SAME_RAD


def test_every_shape(tmp_path):
    """Lane -1 has constant width. The other player approximates the lengths of cubics."""
    cars = [PlayedCar(f"r{k}", -1, 1.0, 0.25) for k in range(len(SHAPES))]
    rows = compare(shapes_file(profiles=False), cars, tmp_path, 0.4)
    cubic = np.array(["oly3" in name for name in SHAPES])
    assert rows[:, ~cubic, 0].max() < SAME_M
    assert rows[:, ~cubic, 1].max() < SAME_RAD
    assert rows[:, cubic, 0].max() < 5e-3
    assert rows[:, cubic, 1].max() < 1e-3


@pytest.mark.parametrize(("way", "leg"), [(4, "1"), (5, "2"), (6, "3")])
def test_a_route_through_a_junction(way, leg, tmp_path):
    car = PlayedCar("0", -1, 5.0, 0.3, (("0", -1, 5.0), (leg, -1, 50.0)))
    rows = compare(junction_file(), [car], tmp_path, 4.5, [0, way, int(leg)])
    assert rows[..., 0].max() < SAME_M
    assert rows[..., 1].max() < SAME_RAD


def test_without_a_route_straight_through_a_junction(tmp_path):
    rows = compare(junction_file(), [PlayedCar("0", -1, 5.0)], tmp_path, 5.0)
    assert rows[..., 0].max() < SAME_M
    assert rows[..., 1].max() < SAME_RAD


@pytest.mark.parametrize("rule", ["RHT", "LHT"])
def test_cars_head_the_way_their_lane_is_driven(rule, tmp_path):
    """On a slope with superelevation: heading, pitch and height of both directions."""
    profiles = (
        '<elevationProfile><elevation s="0" a="5" b="0.05" c="0" d="0"/></elevationProfile>'
        '<lateralProfile><superelevation s="0" a="0.02" b="0" c="0" d="0"/></lateralProfile>'
    )
    road_file = xodr(road(more=profiles, attributes=f'rule="{rule}"'))
    cars = [PlayedCar("0", lane, 20.0, 0.25) for lane in (1, -1)]
    theirs = play(road_file, cars, 0.0, 0.01, tmp_path)[0]
    walks = Walks(road_tables(read_network(road_file, "t")))
    lane = walks.lanes(0, 20.0, lane=[1, -1])
    pose = walks.pose(0, 20.0, lane[:, 0] + 0.25)
    sign = lane[:, 5]
    assert sign.tolist() == ([-1.0, 1.0] if rule == "RHT" else [1.0, -1.0])
    heading = np.where(sign < 0.0, math.pi, 0.0)
    np.testing.assert_allclose(theirs[:, 3], heading, atol=1e-6)
    # The other player's cross section leans with the slope: by t sin(0.02) 0.05 = 2 mm here.
    np.testing.assert_allclose(theirs[:, :3], pose[:, :3], atol=2.5e-3)
    pitch = np.mod(theirs[:, 4] + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(pitch, pose[:, 4] * sign, atol=1e-4)
