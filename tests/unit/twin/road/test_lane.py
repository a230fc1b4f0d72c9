"""The lane's centre line: places to stations and back, exactly."""

import numpy as np
import pytest

from twin.road.lane import Piece, end_of, trace

QUARTER = np.pi / 2


def arc(radius_m, turn_deg):
    return Piece(radius_m * np.radians(abs(turn_deg)), np.sign(turn_deg) / radius_m)


def stadium(radius_m=25.0, straight_m=60.0):
    """Two straights joined by two half circles to the left, from the origin to +x."""
    half = arc(radius_m, 180.0)
    pieces = [Piece(straight_m, 0.0), half, Piece(straight_m, 0.0), half]
    return trace((0.0, 0.0, 0.0), pieces, closed=True)


def winding():
    """Left and right curves, closed; its first piece is a curve."""
    start = (5.0, -3.0, 0.4)
    pieces = [arc(30.0, 90.0), arc(20.0, -90.0), arc(25.0, 180.0), Piece(100.0, 0.0)]
    pieces.append(arc(25.0, 90.0))
    x, y, heading = end_of(start, pieces)
    gap = np.array((start[0] - x, start[1] - y))
    # A straight and a quarter of a circle lead back to the start.
    ahead = gap @ (np.cos(heading), np.sin(heading))
    radius = gap @ (-np.sin(heading), np.cos(heading))
    assert ahead > radius > 5.0
    pieces += [Piece(ahead - radius, 0.0), arc(radius, 90.0)]
    return trace(start, pieces, closed=True)


def test_a_straight_lane_is_the_x_axis_beyond_its_ends_too():
    lane = trace((-65.0, 0.0, 0.0), [Piece(410.0, 0.0)])
    x = np.array([-100.0, -65.0, 0.25, 345.0, 400.5])
    y = np.array([1.5, 0.0, -0.125, 2.0, -3.0])
    place = lane.locate(x, y)
    assert place.s_m.tolist() == (x + 65.0).tolist()
    assert place.lateral_m.tolist() == y.tolist()
    assert not place.heading_rad.any()
    assert not place.curvature_per_m.any()
    back = lane.at(place.s_m, place.lateral_m)
    assert back.x_m.tolist() == x.tolist()
    assert back.y_m.tolist() == y.tolist()


def test_known_places_of_a_stadium():
    lane = stadium()
    assert lane.length_m == pytest.approx(120.0 + 50.0 * np.pi, abs=1e-9)
    found = lane.at(60.0 + 25.0 * QUARTER)  # at the far end of the first half circle
    assert (found.x_m, found.y_m) == pytest.approx((85.0, 25.0), abs=1e-8)
    assert found.yaw_rad == pytest.approx(QUARTER, abs=1e-8)
    assert found.curvature_per_m == 1 / 25.0
    place = lane.locate([30.0, 30.0, 84.0, 86.0, -26.0], [50.5, -1.0, 25.0, 25.0, 25.0])
    assert place.lateral_m == pytest.approx([-0.5, -1.0, 1.0, -1.0, -1.0], abs=1e-9)
    ways = [90.0 + 25.0 * np.pi, 30.0, *[60.0 + 25.0 * QUARTER] * 2, 120.0 + 37.5 * np.pi]
    assert place.s_m == pytest.approx(ways, abs=1e-8)
    assert place.heading_rad == pytest.approx([-np.pi, 0, *[QUARTER] * 2, -QUARTER], abs=1e-8)


@pytest.mark.parametrize("lane", [stadium(), winding()], ids=["stadium", "winding"])
def test_there_and_back(lane):
    rng = np.random.default_rng(3)
    s = np.concatenate([rng.uniform(0.0, lane.length_m, 500), lane.station_m])
    lateral = np.concatenate([rng.uniform(-8.0, 8.0, 500), np.zeros(len(lane.station_m))])
    pose = lane.at(s, lateral)
    place = lane.locate(pose.x_m, pose.y_m)
    apart = np.abs(place.s_m - s)
    assert np.minimum(apart, lane.length_m - apart).max() < 1e-7
    assert np.abs(place.lateral_m - lateral).max() < 1e-8
    turned = np.mod(place.heading_rad - pose.yaw_rad + np.pi, 2 * np.pi) - np.pi
    assert np.abs(turned).max() < 1e-7
    # Curvature jumps at the ends of pieces only.
    assert (place.curvature_per_m[:500] == pose.curvature_per_m[:500]).all()


@pytest.mark.parametrize("lane", [stadium(), winding()], ids=["stadium", "winding"])
def test_the_nearest_place_is_nearest(lane):
    """Beside all points of a fine sampling, also from far inside and outside."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-60.0, 160.0, 200), rng.uniform(-60.0, 160.0, 200)
    place = lane.locate(x, y)
    s = np.arange(0.0, lane.length_m, 0.05)
    line = lane.at(s)
    apart = np.hypot(x[:, None] - line.x_m, y[:, None] - line.y_m).min(axis=1)
    assert np.abs(place.lateral_m) == pytest.approx(apart, abs=2e-3)
    assert (np.abs(place.lateral_m) <= apart + 1e-8).all()


def test_a_closed_lane_goes_round():
    lane = winding()
    s = np.linspace(0.0, lane.length_m, 7)
    assert np.array(lane.at(s + 3 * lane.length_m)) == pytest.approx(np.array(lane.at(s)), abs=1e-6)
    start = lane.locate(lane.at(0.0).x_m, lane.at(0.0).y_m)
    assert float(start.s_m) == 0.0
    assert abs(float(start.lateral_m)) < 1e-8
    before = lane.at(lane.length_m - 0.5)
    assert lane.locate(before.x_m, before.y_m).s_m == pytest.approx(lane.length_m - 0.5, abs=1e-7)
    # It is one smooth line: a step of 1 mm moves 1 mm, also over the joint.
    fine = lane.at(np.arange(-0.01, 0.01, 0.001))
    steps = np.hypot(np.diff(fine.x_m), np.diff(fine.y_m))
    assert steps == pytest.approx(np.full(len(steps), 0.001), abs=1e-7)


def test_places_along_it():
    lane = trace((-65.0, 0.0, 0.0), [Piece(410.0, 0.0)])
    assert lane.places(3.0).tolist() == [[-65.0, 0.0, 0.0], [345.0, 0.0, 0.0]]
    places = stadium().places(3.0)
    assert places[0].tolist() == places[-1].tolist() == [0.0, 0.0, 0.0]
    steps = np.hypot(*np.diff(places[:, :2], axis=0).T)
    assert steps.max() <= 3.0
    assert len(places) == int(stadium().length_m / 3.0) + 2


def test_shapes_broadcast_and_each_point_stands_alone():
    lane = stadium()
    x, y = np.meshgrid(np.linspace(-20, 90, 5), np.linspace(-5, 55, 4))
    many = lane.locate(x, y)
    assert many.s_m.shape == (4, 5)
    for i in range(4):
        for j in range(5):
            one = lane.locate(float(x[i, j]), float(y[i, j]))
            assert [float(v) for v in one] == [float(v[i, j]) for v in many]
