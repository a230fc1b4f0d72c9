"""Lanes through places: how near they come, that they have no kinks, and what ends them."""

from __future__ import annotations

import numpy as np
import pytest

from twin.road import lane_fit
from twin.road.lane import LanePath, Piece, trace
from twin.road.lane_fit import TOLERANCE_M, LanePoints, fit_lane


def points_of(lane: LanePath, stations_m: np.ndarray) -> LanePoints:
    pose = lane.at(stations_m)
    return LanePoints(pose.x_m, pose.y_m, pose.yaw_rad)


def clothoid(sharpness: float, length_m: float, start_rad: float = 0.0) -> LanePoints:
    """A curve of curvature sharpness * s, by fine sums; a metre between its places."""
    step = 0.001
    s = np.arange(0.0, length_m + step / 2, step)
    heading = start_rad + 0.5 * sharpness * s * s
    middle = start_rad + 0.5 * sharpness * (s[:-1] + step / 2) ** 2
    x = np.append(0.0, np.cumsum(np.cos(middle) * step))
    y = np.append(0.0, np.cumsum(np.sin(middle) * step))
    return LanePoints(x[::1000], y[::1000], heading[::1000])


def check(lane: LanePath, points: LanePoints) -> None:
    place = lane.locate(points.x_m, points.y_m)
    assert np.abs(place.lateral_m).max() <= TOLERANCE_M + 1e-6
    assert (np.diff(place.s_m) > 0.0).all()
    off = np.angle(np.exp(1j * (place.heading_rad - points.heading_rad)))
    assert np.abs(off).max() < 5e-3
    ends = np.append(lane.station_m[1:], lane.length_m)
    before, after = lane.at(ends[:-1] - 1e-9), lane.at(ends[:-1] + 1e-9)
    assert np.allclose(before.x_m, after.x_m, atol=1e-8)
    assert np.allclose(before.yaw_rad, after.yaw_rad, atol=1e-8)


@pytest.mark.parametrize("start_rad", [0.0, 2.9, -1.6])
def test_a_clothoid_becomes_a_few_arcs_within_a_millimetre(start_rad: float) -> None:
    points = clothoid(1.0 / 160.0 / 50.0, 100.0, start_rad)
    lane = fit_lane(points, closed=False)
    check(lane, points)
    assert 10 < len(lane.curvature) < 40
    assert lane.curvature[0] == lane.curvature[-1] == 0.0, "it goes on straight beyond its ends"
    assert (lane.curvature[1:-1] >= 0.0).all()


def test_arcs_and_straights_come_out_as_they_are() -> None:
    drawn = trace((5.0, -3.0, 0.7), [Piece(60.0, 0.0), Piece(40.0, 0.02), Piece(60.0, 0.0)])
    points = points_of(drawn, np.linspace(0.0, drawn.length_m, 161))
    lane = fit_lane(points, closed=False)
    check(lane, points)
    assert lane.length_m == pytest.approx(160.0, abs=0.005)
    assert lane.curvature.max() == pytest.approx(0.02, rel=0.02)


def test_a_straight_lane_is_one_piece() -> None:
    drawn = trace((1.0, 2.0, -2.0), [Piece(500.0, 0.0)])
    lane = fit_lane(points_of(drawn, np.linspace(0.0, 500.0, 501)), closed=False)
    assert len(lane.curvature) == 1
    assert lane.length_m == pytest.approx(500.0, abs=0.002)


def test_a_closed_lane_ends_where_it_begins() -> None:
    stations = np.linspace(0.0, 2.0 * np.pi * 50.0, 315)
    angle = stations / 50.0
    points = LanePoints(50.0 * np.sin(angle), 50.0 - 50.0 * np.cos(angle), angle)
    lane = fit_lane(points, closed=True)
    assert lane.closed
    check(lane, LanePoints(*(column[:-1] for column in points)))
    assert lane.length_m == pytest.approx(stations[-1], abs=0.01)
    end = lane.at(lane.length_m - 1e-6)
    assert (float(end.x_m), float(end.y_m)) == pytest.approx((0.0, 0.0), abs=1e-5)


def test_a_lane_ends_at_its_limit_of_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lane_fit, "PIECES_MAX", 20)
    bends = [Piece(15.0, 0.01 * (-1) ** k) for k in range(40)]
    drawn = trace((0.0, 0.0, 0.0), [Piece(1.0, 0.0), *bends, Piece(1.0, 0.0)])
    points = points_of(drawn, np.linspace(0.0, drawn.length_m, 603))
    lane = fit_lane(points, closed=False)
    assert 18 <= len(lane.curvature) <= 20
    assert 20.0 < lane.length_m < 500.0
    assert not fit_lane(points, closed=True).closed


def test_one_place_is_still_a_start() -> None:
    one = LanePoints(np.array([3.0]), np.array([4.0]), np.array([0.5]))
    lane = fit_lane(one, closed=False)
    pose = lane.at(0.0)
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((3.0, 4.0, 0.5))
    assert lane.length_m < 0.01
