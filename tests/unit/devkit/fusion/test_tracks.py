"""devkit.fusion.tracks: the filters against closed forms, gate, assignment, existence."""

from __future__ import annotations

import numpy as np
import pytest

from devkit.fusion.parameters import TrackingParameters
from devkit.fusion.path import CarPath, EyePlaces
from devkit.fusion.sightings import LABELS, Sightings
from devkit.fusion.tracks import (
    EDGE_SHARE,
    LATERAL_SIGMA_M,
    PLACES_KEPT,
    TRACKS_MAX,
    TrackStore,
)

PERIOD_S = 0.1
PARAMETERS = TrackingParameters()


def sightings(x_m, y_m, half_m: float = 0.9, places: int = 0) -> Sightings:
    """Things of one width at x and y, [S, M] or [S]."""
    x, y = (np.atleast_2d(np.asarray(v, float)) for v in (x_m, y_m))
    seen = Sightings.empty(x.shape[0], max(places, x.shape[1]))
    n = x.shape[1]
    seen.valid[:, :n] = np.isfinite(x)
    seen.x_m[:, :n] = seen.path_x_m[:, :n] = np.nan_to_num(x)
    seen.sigma_m[:, :n] = PARAMETERS.lidar_sigma_m
    seen.right_m[:, :n], seen.left_m[:, :n] = np.nan_to_num(y) - half_m, np.nan_to_num(y) + half_m
    seen.inside[:, :n] = np.abs(seen.right_m[:, :n] + half_m) < 2.0
    return seen


def step(store: TrackStore, seen: Sightings, speed_mps: float = 0.0, yaw: float = 0.0) -> None:
    slots = len(seen.valid)
    ones = np.ones(slots)
    store.predict(PERIOD_S * ones, speed_mps * ones, yaw * ones)
    store.update(seen, store.lidar, np.ones(slots, bool))


def test_a_constant_velocity_is_found_from_exact_places():
    store = TrackStore(1, PARAMETERS)
    for k in range(60):
        step(store, sightings([30.0 + 3.0 * k * PERIOD_S], [1.0 - 0.5 * k * PERIOD_S]))
    assert store.live.sum() == 1
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.vx_mps[at] == pytest.approx(3.0, abs=0.01)
    assert store.vy_mps[at] == pytest.approx(-0.5, abs=0.01)
    assert store.x_m[at] == pytest.approx(30.0 + 3.0 * 5.9, abs=0.01)


def test_the_variance_settles_at_the_closed_form_of_the_alpha_beta_filter():
    """Kalata's tracking index L = a T^2 / s gives the steady gain alpha, and P_xx = alpha s^2."""
    store = TrackStore(1, PARAMETERS)
    for _ in range(300):
        step(store, sightings([20.0], [0.0]))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    index = PARAMETERS.acceleration_mps2 * PERIOD_S**2 / PARAMETERS.lidar_sigma_m
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    assert store.p_xx[at] == pytest.approx((1.0 - r**2) * PARAMETERS.lidar_sigma_m**2, rel=1e-3)


def test_errors_are_as_large_as_the_filter_says():
    """Normalised estimation error squared: its mean over runs lies in the chi-square interval."""
    runs, rng = 60, np.random.default_rng(5)
    store = TrackStore(runs, PARAMETERS)
    x, vx = np.full(runs, 300.0), PARAMETERS.start_speed_mps * rng.standard_normal(runs)
    for k in range(50):
        if k:
            accel = PARAMETERS.acceleration_mps2 * rng.standard_normal(runs)
            x = x + vx * PERIOD_S + 0.5 * accel * PERIOD_S**2
            vx = vx + accel * PERIOD_S
        noise = PARAMETERS.lidar_sigma_m * rng.standard_normal(runs)
        step(store, sightings((x + noise)[:, None], np.zeros((runs, 1))))
    assert (store.live.sum(axis=1) == 1).all()
    ex, ev = (store.x_m - x[:, None])[store.live], (store.vx_mps - vx[:, None])[store.live]
    xx, xv, vv = (p[store.live] for p in (store.p_xx, store.p_xv, store.p_vv))
    nees = (vv * ex * ex - 2.0 * xv * ex * ev + xx * ev * ev) / (xx * vv - xv * xv)
    # 95 % of chi-square with 120 degrees of freedom: 91.57 to 152.21.
    assert 91.57 < nees.sum() < 152.21


def test_what_stands_keeps_its_place_in_the_world_while_the_car_turns():
    store = TrackStore(1, PARAMETERS)
    step(store, sightings([20.0], [3.0]))
    nothing = Sightings.empty(1, 1)
    for _ in range(5):
        store.predict(np.full(1, PERIOD_S), np.full(1, 6.0), np.full(1, 0.2))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    # Euler's way of the car: straight for a period, then the turn.
    angle = 0.2 * PERIOD_S
    x, y = 20.0, 3.0
    for _ in range(5):
        x -= 6.0 * PERIOD_S
        x, y = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    assert (store.x_m[at], store.y_m[at]) == pytest.approx((x, y), abs=1e-9)
    assert not nothing.valid.any()


def test_a_sighting_outside_the_gate_begins_a_track_of_its_own():
    deviation = np.sqrt(2.0) * PARAMETERS.lidar_sigma_m
    edge_m = np.sqrt(PARAMETERS.gate) * deviation
    for shift_m, tracks in ((0.99 * edge_m, 1), (1.01 * edge_m, 2)):
        store = TrackStore(1, PARAMETERS)
        store.update(sightings([20.0], [0.0]), store.lidar, np.ones(1, bool))
        store.update(sightings([20.0 + shift_m], [0.0]), store.lidar, np.ones(1, bool))
        assert store.live.sum() == tracks


def test_pairs_are_made_by_distance_and_equal_ones_by_number():
    store = TrackStore(1, PARAMETERS)
    both = sightings([20.0, 20.6], [0.0, 0.0])
    store.update(both, store.lidar, np.ones(1, bool))
    assert store.x_m[0, :2].tolist() == [20.0, 20.6]
    store.update(sightings([20.3, 20.58], [0.0, 0.0]), store.lidar, np.ones(1, bool))
    # 20.58 is the second's; the first gets what is left, though both are as far from 20.3.
    assert store.live.sum() == 2
    assert store.x_m[0, 0] == pytest.approx(20.15)
    assert store.x_m[0, 1] == pytest.approx(20.59)


def test_existence_rises_and_falls_by_bayes_rule():
    store = TrackStore(1, PARAMETERS)
    expected = PARAMETERS.born
    seen, nothing = sightings([20.0], [0.0]), Sightings.empty(1, 1)
    step(store, seen)
    for _ in range(2):
        step(store, seen)
        there = expected * PARAMETERS.detection
        expected = there / (there + (1.0 - expected) * PARAMETERS.clutter)
        assert store.probability[0, 0] == pytest.approx(expected)
    step(store, nothing)
    there = expected * (1.0 - PARAMETERS.detection)
    expected = there / (there + (1.0 - expected) * (1.0 - PARAMETERS.clutter))
    assert store.probability[0, 0] == pytest.approx(expected)
    for _ in range(4):
        step(store, nothing)
    assert not store.live.any()


def test_a_radial_speed_is_believed_at_once():
    store = TrackStore(1, PARAMETERS)
    seen = sightings([40.0], [0.0])
    seen.radial_mps[0, 0] = -7.0
    store.update(seen, store.radar, np.ones(1, bool))
    assert store.vx_mps[0, 0] == -7.0
    seen.radial_mps[0, 0] = -7.4
    store.update(seen, store.radar, np.ones(1, bool))
    assert store.vx_mps[0, 0] == pytest.approx(-7.2)


def test_a_radial_speed_is_the_part_of_the_velocity_along_the_ray():
    """Somebody crosses at 5 m/s, 45 to 15 degrees aside of a radar that stands."""
    store = TrackStore(1, PARAMETERS)
    for k in range(25):
        x, y = 15.0, -15.0 + 5.0 * 0.1 * k
        seen = sightings([x], [y], 0.3)
        away_m = float(np.hypot(x, y))
        seen.radial_mps[0, 0], seen.radial_sigma_mps[0, 0] = 5.0 * y / away_m, 0.3
        seen.ray_y[0, 0] = y / away_m
        store.predict(np.full(1, 0.1), np.zeros(1), np.zeros(1))
        store.update(seen, store.radar, np.ones(1, bool))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.live.sum() == 1
    assert store.vx_mps[at] == pytest.approx(0.0, abs=0.3)
    assert store.vy_mps[at] == pytest.approx(5.0, abs=0.3)
    assert store.from_y_m[at] == pytest.approx(-13.0, abs=0.5), "at half a second"


@pytest.mark.parametrize(("ray_y", "across"), [(0.7, True), (0.1, False)])
def test_who_moves_along_a_ray_that_leads_aside_may_as_well_cross(ray_y, across):
    """A first radial speed says nothing of the speed at right angles to it."""
    store = TrackStore(1, PARAMETERS)
    seen = sightings([14.0], [10.0])
    seen.ray_y[0, 0], seen.radial_mps[0, 0], seen.radial_sigma_mps[0, 0] = ray_y, -4.0, 0.3
    store.update(seen, store.radar, np.ones(1, bool))
    assert (store.q_vv[0, 0] > 50.0) == across
    later = TrackStore(1, PARAMETERS)
    later.update(sightings([14.0], [10.0]), later.lidar, np.ones(1, bool))
    assert later.q_vv[0, 0] < 5.0
    later.update(seen, later.radar, np.ones(1, bool))
    assert (later.vy_mps[0, 0] < -1.5) == across


def test_radial_speeds_that_a_velocity_does_not_explain_are_counted_against_it():
    """LiDAR has gone from one thing to the next at 10 m/s; radar sees that it stands."""
    store = TrackStore(1, PARAMETERS)
    for k in range(6):
        step(store, sightings([20.0], [8.0 - k]))
    assert store.vy_mps[0, 0] == pytest.approx(-9.0, abs=1.5)
    assert store.agrees[0, 0] == 1.0
    seen = sightings([20.0], [2.0])
    seen.ray_y[0, 0], seen.radial_mps[0, 0], seen.radial_sigma_mps[0, 0] = 0.4, 0.0, 0.3
    velocity = store.vy_mps[0, 0]
    for left in (0.6, 0.36):
        store.update(seen, store.radar, np.ones(1, bool))
        assert store.agrees[0, 0] == pytest.approx(left)
    assert store.vy_mps[0, 0] == velocity, "it may have been a wheel"
    seen.radial_mps[0, 0] = 0.4 * velocity
    store.update(seen, store.radar, np.ones(1, bool))
    assert store.agrees[0, 0] == pytest.approx(0.616)


def test_where_a_track_came_from_stays_on_the_road_while_the_car_turns():
    store = TrackStore(1, PARAMETERS)
    heading = x = y = 0.0
    for k in range(40):
        dx, dy = 40.0 - x, 3.0 - y
        c, s = np.cos(heading), np.sin(heading)
        step(store, sightings([dx * c + dy * s], [dy * c - dx * s]), 10.0 if k else 0.0, 0.1)
        heading += 0.1 * PERIOD_S
        x, y = x + 10.0 * PERIOD_S * np.cos(heading), y + 10.0 * PERIOD_S * np.sin(heading)
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.from_x_m[at] == pytest.approx(store.x_m[at], abs=0.7)
    assert store.from_y_m[at] == pytest.approx(store.y_m[at], abs=0.7)


def test_a_camera_box_is_in_the_path_at_the_distance_of_the_radar():
    """Its edge at 12 m, by its own distance, is outside; at the radar's 20 m it is far outside."""
    eye = EyePlaces(np.zeros(1), np.zeros(1), CarPath(np.zeros(1)), 1.1)
    for radar_x_m, inside in ((12.0, True), (20.0, False)):
        store = TrackStore(1, PARAMETERS)
        echo = sightings([radar_x_m], [-1.9 * radar_x_m / 12.0], half_m=0.3)
        store.update(echo, store.radar, np.ones(1, bool))
        box = sightings([12.0], [-1.9])
        box.sigma_m[0, 0] = 6.0
        for _ in range(3):
            store.take_boxes(box, eye, np.ones(1, bool))
        assert store.live.sum() == 1
        assert (store.camera.inside[0, 0] > 0.5) == inside
        assert store.x_m[0, 0] == radar_x_m


def test_a_box_that_is_too_large_for_the_radars_distance_is_no_wider_there():
    """A box around two cars that come along the other lane, 34 m away by its size: 50 m away its
    edge would reach into the path, though the middle of the box is where radar sees the nearer."""
    eye = EyePlaces(np.zeros(1), np.zeros(1), CarPath(np.zeros(1)), 1.1)
    for right_m, inside in ((0.65, False), (-0.2, True)):
        store = TrackStore(1, PARAMETERS)
        middle_m = (right_m + 1.0) * 50.0 / 34.0
        store.update(sightings([50.0], [middle_m], half_m=0.5), store.radar, np.ones(1, bool))
        box = sightings([34.0], [right_m + 1.0], half_m=1.0)
        box.sigma_m[0, 0] = 6.0
        for _ in range(3):
            store.take_boxes(box, eye, np.ones(1, bool))
        assert store.live.sum() == 1
        assert (store.camera.inside[0, 0] > 0.5) == inside


def test_no_more_tracks_than_places():
    store = TrackStore(1, PARAMETERS)
    many = TRACKS_MAX + 8
    seen = sightings(5.0 + 1.5 * np.arange(many)[None], np.zeros((1, many)))
    store.update(seen, store.lidar, np.ones(1, bool))
    assert store.live.sum() == TRACKS_MAX
    assert store.x_m[0].max() == 5.0 + 1.5 * (TRACKS_MAX - 1)


def test_what_is_beside_the_road_leaves_places_to_what_is_along_it():
    store = TrackStore(1, PARAMETERS)
    many = TRACKS_MAX
    seen = sightings(5.0 + 1.5 * np.arange(many)[None], np.zeros((1, many)))
    seen.beside[0, 2:] = True
    store.update(seen, store.lidar, np.ones(1, bool))
    assert store.live.sum() == TRACKS_MAX - PLACES_KEPT
    assert store.live[0, :2].all()
    seen.beside[:] = False
    store.update(seen, store.lidar, np.ones(1, bool))
    assert store.live.sum() == TRACKS_MAX


def test_beside_the_road_lidar_begins_tracks_and_radar_corrects_them():
    store = TrackStore(1, PARAMETERS)
    seen = sightings([20.0], [-18.0])
    seen.beside[0, 0] = True
    store.update(seen, store.radar, np.ones(1, bool))
    assert not store.live.any()
    store.update(seen, store.lidar, np.ones(1, bool))
    store.update(seen, store.radar, np.ones(1, bool))
    assert store.live.sum() == 1
    assert (store.lidar.hits[0, 0], store.radar.hits[0, 0]) == (1.0, 1.0)


def test_who_crosses_fast_has_his_speed_after_four_sweeps():
    """17 m/s from the side: a speed across that were thought to be small would take a second."""
    store = TrackStore(1, PARAMETERS)
    for k in range(5):
        seen = sightings([20.0], [-25.0 + 17.0 * k * PERIOD_S], half_m=2.0)
        seen.beside[0, 0] = True
        step(store, seen)
    assert store.live.sum() == 1
    assert store.vy_mps[0, 0] == pytest.approx(17.0, abs=1.0)
    assert 25.0 * store.q_vv[0, 0] < 17.0**2


def test_ends_follow_what_is_seen():
    store = TrackStore(1, PARAMETERS)
    step(store, sightings([20.0], [0.0], half_m=0.5))
    step(store, sightings([20.0], [0.0], half_m=0.9))
    assert store.left_m[0, 0] == pytest.approx(0.5 + EDGE_SHARE * 0.4)
    assert store.right_m[0, 0] == -store.left_m[0, 0]
    assert store.q_xx[0, 0] < LATERAL_SIGMA_M**2


@pytest.mark.parametrize("turn_radps", [0.25, -0.25, 0.0])
def test_a_turn_rate_is_found_and_the_velocity_turns_with_it(turn_radps):
    """8 m/s on a circle; the turn rate is known within 0.1 rad/s after 4 s."""
    store, speed, x, y, heading = TrackStore(1, PARAMETERS), 8.0, 15.0, 0.0, 0.0
    for _ in range(40):
        x += speed * np.cos(heading) * PERIOD_S
        y += speed * np.sin(heading) * PERIOD_S
        heading += turn_radps * PERIOD_S
        step(store, sightings([x], [y]))
    assert store.live.sum() == 1
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.turn_radps[at] == pytest.approx(turn_radps, abs=0.1)
    assert store.vx_mps[at] == pytest.approx(speed * np.cos(heading), abs=1.2)
    assert store.vy_mps[at] == pytest.approx(speed * np.sin(heading), abs=1.2)


def test_the_noise_of_a_walker_is_no_turn():
    """2.5 m/s along a footway; what LiDAR sees of limbs goes to and fro."""
    store = TrackStore(1, PARAMETERS)
    for k in range(40):
        step(store, sightings([12.0 + 0.25 * k], [-1.9 + 0.25 * np.sin(1.7 * k)], half_m=0.25))
    assert store.live.sum() == 1
    assert store.turn_radps[store.live] == 0.0


def test_a_leader_that_brakes_has_a_deceleration_by_radar():
    store, x, v = TrackStore(1, PARAMETERS), 30.0, 20.0
    for k in range(60):
        v -= 4.0 * 0.05 if k >= 30 else 0.0
        x += v * 0.05
        seen = sightings([x], [0.0])
        seen.radial_mps[0, 0], seen.radial_sigma_mps[0, 0] = v, 0.3
        store.predict(np.full(1, 0.05), np.zeros(1), np.zeros(1))
        store.update(seen, store.radar, np.ones(1, bool))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.accel_mps2[at] == pytest.approx(-4.0, abs=1.5)
    assert store.vx_mps[at] == pytest.approx(v, abs=0.5)


def test_what_another_sensor_sees_is_not_lost_by_one_that_misses_it():
    store, ones = TrackStore(1, PARAMETERS), np.ones(1, bool)
    for k in range(30):
        store.predict(np.full(1, PERIOD_S), np.zeros(1), np.zeros(1))
        store.update(sightings([20.0], [0.0]), store.lidar, ones)
        there = sightings([20.0 if k < 5 else np.nan], [0.0])
        store.update(there, store.radar, ones)
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert store.probability[at] > 0.99


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_another_part_of_what_stands_is_no_speed_across(side):
    """A lorry that radar and a camera have seen for 0.2 s; then LiDAR sees its near edge alone,
    0.8 m aside."""
    store, ones = TrackStore(1, PARAMETERS), np.ones(1, bool)
    for k in range(4):
        store.predict(np.full(1, 0.05), np.full(1, 8.0), np.zeros(1))
        store.update(sightings([20.0 - 0.4 * k], [side * 3.3]), store.radar, ones)
    for k in range(2):
        x_m = 18.0 - 0.8 * k
        step(store, sightings([x_m], [side * 2.45], half_m=0.05), speed_mps=8.0)
        assert abs(store.vy_mps[0, 0]) < 1.0
        assert store.y_m[0, 0] == pytest.approx(side * 2.45, abs=0.2)
    assert store.live.sum() == 1


def whole_after_edge(whole_x_m, half_m=2.0):
    """A track that LiDAR has seen as an edge 13.5 m ahead, and a sweep later as a whole."""
    store = TrackStore(1, PARAMETERS)
    step(store, sightings([13.5], [-7.9], half_m=0.08))
    step(store, sightings([whole_x_m], [-7.3], half_m=half_m))
    assert store.live.sum() == 1
    return store


def test_another_part_of_what_stands_is_no_speed_along():
    """A car that waits aslant: first its far corner is seen, then all of it, 1.5 m nearer."""
    store = whole_after_edge(12.0)
    assert store.vx_mps[0, 0] == 0.0
    assert store.p_vv[0, 0] == pytest.approx(100.0, rel=0.01), "its speed is not known yet"
    assert store.x_m[0, 0] == pytest.approx(12.0, abs=0.01)
    assert store.p_xx[0, 0] == pytest.approx(PARAMETERS.lidar_sigma_m**2, rel=0.01)
    for _ in range(2):
        step(store, sightings([12.0], [-7.3], half_m=2.0))
    assert abs(store.vx_mps[0, 0]) < 0.2
    assert store.p_vv[0, 0] < 4.0


def test_a_car_that_comes_is_as_fast_as_it_is_a_sweep_after_its_other_part_was_seen():
    store = whole_after_edge(11.5)
    for k in range(1, 3):
        step(store, sightings([11.5 - 0.8 * k], [-7.3], half_m=2.0))
    assert store.vx_mps[0, 0] == pytest.approx(-8.0, abs=0.5)
    assert store.p_vv[0, 0] < 4.0


@pytest.mark.parametrize(
    ("whole_x_m", "half_m", "why"),
    [
        (10.5, 1.0, "further than the width has changed: it moved"),
        (13.2, 2.0, "within its noise: it tells of a speed as ever"),
        (12.5, 0.4, "as wide as before"),
    ],
)
def test_what_is_no_other_part_tells_a_speed_at_once(whole_x_m, half_m, why):
    store = whole_after_edge(whole_x_m, half_m)
    way_m = whole_x_m - 13.5
    assert store.vx_mps[0, 0] == pytest.approx(way_m / PERIOD_S, rel=0.15), why
    assert store.p_vv[0, 0] < 13.0


def test_who_walks_is_as_fast_as_before_though_his_width_changes():
    """Arms and legs swing by 0.2 m; LiDAR knows his middle no better anyway."""
    store = TrackStore(1, PARAMETERS)
    for k in range(8):
        step(store, sightings([20.0], [-3.0 + 0.15 * k], half_m=0.2 + 0.1 * (k % 2)))
    assert store.vy_mps[0, 0] == pytest.approx(1.5, abs=0.3)


def test_the_first_estimate_of_a_velocity_is_no_turn():
    """Boxes tell hardly how fast somebody is, and take him for going away; the first echo says
    that he comes."""
    store, ones = TrackStore(1, PARAMETERS), np.ones(1, bool)
    for k in range(4):
        box = sightings([38.0 + 2.0 * k], [1.9 + 0.2 * k])
        box.sigma_m[0, 0] = 6.0
        store.predict(np.full(1, PERIOD_S), np.zeros(1), np.zeros(1))
        store.update(box, store.lidar, ones)
    assert store.vx_mps[0, 0] > 2.0
    store.predict(np.full(1, 0.05), np.zeros(1), np.zeros(1))
    echo = sightings([store.x_m[0, 0]], [2.5], half_m=0.3)
    echo.radial_mps[0, 0], echo.radial_sigma_mps[0, 0] = -11.0, 0.3
    store.update(echo, store.radar, ones)
    assert store.live.sum() == 1
    assert store.vx_mps[0, 0] == pytest.approx(-11.0, abs=1.0)
    assert store.turn_radps[0, 0] == 0.0


def test_one_box_of_a_person_does_not_make_one_of_a_car_that_two_have_shown():
    store = TrackStore(1, PARAMETERS)
    car, person = LABELS.index("car"), LABELS.index("pedestrian")
    step(store, sightings([15.0], [0.0]))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    eye = EyePlaces(np.zeros(1), np.zeros(1), CarPath(np.zeros(1)), 1.1)

    def said(label):
        seen = sightings([15.0], [0.0])
        seen.label[:] = label
        store.confirm(seen, eye)
        return int(store.label[at])

    assert [said(label) for label in (car, car, person)] == [car, car, car]
    assert said(person) == person, "as many boxes say otherwise"
    assert store.named[at] == 1.0
    assert said(LABELS.index("bicycle")) == LABELS.index("bicycle"), "he may have a bicycle"
    assert store.named[at] == 2.0


def test_the_place_from_which_a_track_comes_is_that_of_its_second_sweep():
    """The first may be of a post before the car that is seen then."""
    store = TrackStore(1, PARAMETERS)
    for y_m in (2.5, 1.0, 1.0, 1.0):
        step(store, sightings([15.0], [y_m], half_m=0.3))
    at = 0, int(np.flatnonzero(store.live[0])[0])
    assert abs(store.from_y_m[at] - 1.0) < 0.6


def test_places_that_a_way_does_not_explain_are_counted_against_it():
    store = TrackStore(1, TrackingParameters())
    for i in range(12):
        step(store, sightings([20.0], [-9.0 + 0.5 * i]))
    assert store.steady[0, 0] > 0.9
    for _ in range(4):  # what stood behind it is seen now
        step(store, sightings([20.0], [-5.0]))
    assert store.live[0, 0]
    assert store.steady[0, 0] < 0.6
    for _ in range(30):
        step(store, sightings([20.0], [-5.0]))
    assert store.steady[0, 0] > 0.9


def test_lidar_that_has_lost_a_track_begins_to_count_anew():
    store = TrackStore(1, TrackingParameters())
    for _ in range(5):
        step(store, sightings([20.0], [0.0]))
    assert store.lidar.hits[0, 0] == 5
    for _ in range(4):
        store.predict(np.array([0.1]), np.zeros(1), np.zeros(1))
    step(store, sightings([20.0], [0.0]))
    assert store.lidar.hits[0, 0] == store.ends.sweeps[0, 0] == 1


def test_lidar_that_goes_on_to_another_thing_has_not_seen_it_come_from_there():
    """A post between parked cars, then the corner of one: no walk of 0.7 m in a sweep."""
    store = TrackStore(1, TrackingParameters())
    for _ in range(4):
        step(store, sightings([20.0], [-3.4], half_m=0.3))
    came_from_m = store.from_y_m[0, 0]
    assert store.ends.sweeps[0, 0] == 4
    for sweeps in (1, 2, 3):
        step(store, sightings([20.0], [-2.7], half_m=0.2))
        assert store.ends.sweeps[0, 0] == sweeps
    assert store.live.sum() == 1
    assert store.vy_mps[0, 0] ** 2 < 2.0 * store.q_vv[0, 0], "it does not walk"
    assert store.y_m[0, 0] == pytest.approx(-2.7, abs=0.05)
    assert store.from_y_m[0, 0] - came_from_m == pytest.approx(0.7, abs=0.1), "nor has it come far"


def test_another_part_is_counted_anew_and_a_walk_is_not():
    store = TrackStore(1, TrackingParameters())
    for i in range(10):
        step(store, sightings([20.0], [-3.0 + 0.2 * i], half_m=0.3))
    assert store.ends.sweeps[0, 0] == 10
    assert store.ends.go_along()[0, 0]
    step(store, sightings([20.0], [-1.0], half_m=1.3))
    assert store.ends.sweeps[0, 0] == 1
    assert not store.ends.go_along()[0, 0]


def test_a_new_track_has_no_ends_of_one_that_had_its_place():
    store = TrackStore(1, TrackingParameters())
    for i in range(5):
        step(store, sightings([20.0], [-3.0 + 0.2 * i], half_m=0.3))
    store.reset(0)
    for _ in range(2):
        step(store, sightings([20.0], [4.0], half_m=0.3))
    assert store.live[0, 0]
    assert store.ends.along[0, 0] < 0.3


@pytest.mark.parametrize("velocity", [(0.0, 5.0), (-5.0, 1.0)])
def test_who_moves_goes_on_though_another_part_of_him_is_seen(velocity):
    store = TrackStore(1, TrackingParameters())
    vx, vy = velocity
    for i in range(12):
        step(store, sightings([30.0 + 0.1 * vx * i], [-9.0 + 0.1 * vy * i], half_m=0.3))
    step(store, sightings([30.0 + 1.2 * vx], [-9.0 + 1.2 * vy + 0.8], half_m=0.3))
    assert store.vy_mps[0, 0] > 0.8 * vy
    assert store.q_vv[0, 0] < 1.0
