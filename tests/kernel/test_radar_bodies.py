"""Vehicles and people: cross sections in the ranges that are published, and spread of speeds.

Ranges at 76 to 81 GHz, wide ones: what the publications agree on, not the table of one.
Pedestrians: Fortuny-Guasch, Chareau 2013, radar cross section measurements of pedestrian dummies
and humans, JRC report EUR 25762 EN, and Schubert et al. 2013 (human RCS measurements, International
Radar Symposium): means of about -8 dBsm over all directions. Cars: Matsunami, Nakamura, Kajiwara
2012, RCS measurements for vehicles and pedestrian at 26 and 79 GHz, and Suzuki 2000: a maximum like
that of a plate from the side, 15 to 30 dBsm, and 5 to 20 dBsm from front and rear.
"""

import math

import numpy as np
import pytest
import warp as wp
from lidar_rigs import CPU
from radar_rigs import measure, radar, small_profile

from schemas.messages import OBJECT_CLASSES
from twin.render.trace.geometry import ObjectPose
from twin.sensors.radar.bodies import LIMB, RIM, Reflector, Scatterer, templates
from twin.sensors.radar.scatter import point_of_body

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RANGE_M = 20.0
HALF_M = {
    "car": (2.25, 0.9),
    "truck": (5.9, 1.25),
    "bus": (6.0, 1.25),
    "pedestrian": (0.25, 0.25),
    "bicycle": (0.9, 0.3),
}


def mean_dbsm(name, seen_from_deg):
    """Sum of the cross sections of a body's points, which is the mean over all phases, from so far
    to the left of its front."""
    half = HALF_M[name]
    turn = math.pi - math.radians(seen_from_deg)
    c, s = math.cos(turn), math.sin(turn)
    reflectors = []
    for row in templates()[OBJECT_CLASSES.index(name)]:
        if row["shape"] < 0:
            continue
        x = row["at"][0] + row["share"][0] * half[0]
        y = row["at"][1] + row["share"][1] * half[1]
        facing = turn + math.atan2(row["normal"][1], row["normal"][0])
        place = (RANGE_M + c * x - s * y, s * x + c * y, float(row["at"][2]))
        size = tuple(float(v) for v in row["size"])
        reflectors.append(Reflector(int(row["shape"]), place, facing, size))
    sensor = radar(small_profile(beam_deg=[3000.0, 3000.0]), reflectors=reflectors)
    measure(sensor)
    echoes = sensor.echoes.numpy()[0]
    far = np.maximum(echoes["row"].astype(float) * sensor.profile.range_cell_m, 1.0)
    return 10.0 * math.log10((echoes["power"] * far**4).sum() / sensor.model.signal)


@pytest.mark.parametrize(
    ("name", "seen_from_deg", "low", "high"),
    [
        ("car", 180.0, 5.0, 20.0),
        ("car", 0.0, 5.0, 20.0),
        ("car", 90.0, 15.0, 30.0),
        ("car", 45.0, -2.0, 12.0),
        ("truck", 180.0, 12.0, 30.0),
        ("truck", 90.0, 20.0, 40.0),
        ("pedestrian", 0.0, -12.0, -3.0),
        ("pedestrian", 90.0, -12.0, -3.0),
        ("bicycle", 90.0, -5.0, 10.0),
        ("bicycle", 180.0, -8.0, 5.0),
    ],
)
def test_cross_sections_are_in_published_ranges(name, seen_from_deg, low, high):
    assert low < mean_dbsm(name, seen_from_deg) < high


def test_a_car_is_brightest_from_its_side_and_faintest_from_its_corners():
    by_angle = {angle: mean_dbsm("car", angle) for angle in (0.0, 45.0, 90.0, 135.0, 180.0)}
    assert by_angle[90.0] == max(by_angle.values())
    assert min(by_angle, key=by_angle.get) in (45.0, 135.0)


@wp.kernel
def points_kernel(
    items: wp.array(dtype=Scatterer),
    poses: wp.array(dtype=ObjectPose),
    at_out: wp.array2d(dtype=wp.vec3d),
    velocity_out: wp.array2d(dtype=wp.vec3d),
):
    t, k = wp.tid()
    body = point_of_body(items[k], poses[t])
    at_out[t, k] = body.at
    velocity_out[t, k] = body.velocity


def walked(name, speed_mps, seconds=2.0, step_s=0.002):
    """Places and velocities of a body's points that goes along x, [time, points, 3]; its rows."""
    rows = templates()[OBJECT_CLASSES.index(name)]
    rows = rows[rows["shape"] >= 0]
    times = np.arange(0.0, seconds, step_s)
    poses = np.zeros(len(times), ObjectPose.numpy_dtype())
    poses["cosine"], poses["half"] = 1.0, HALF_M[name]
    poses["position"][:, 0] = speed_mps * times
    poses["velocity"][:, 0] = speed_mps
    shape = (len(times), len(rows))
    at, velocity = (wp.zeros(shape, dtype=wp.vec3d, device=CPU) for _ in range(2))
    inputs = [wp.array(rows, dtype=Scatterer, device=CPU)]
    inputs.append(wp.array(poses, dtype=ObjectPose, device=CPU))
    wp.launch(points_kernel, shape, inputs=inputs, outputs=[at, velocity], device=CPU)
    return at.numpy(), velocity.numpy(), rows


def test_limbs_spread_the_speeds_of_a_walking_person():
    """A foot rests on the ground and swings at two to three times the body's speed (Boulic,
    Thalmann, Thalmann 1990; Chen 2006, the micro-Doppler effect in radar)."""
    speed = 1.4
    _, velocity, rows = walked("pedestrian", speed)
    ahead = velocity[..., 0]
    limbs = rows["motion"] == LIMB
    assert limbs.sum() == 6
    assert ahead[:, ~limbs] == pytest.approx(speed, abs=1e-6), "trunk and head do not swing"
    feet = limbs & (rows["at"][:, 2] < 0.3)
    assert ahead[:, feet].min() == pytest.approx(0.0, abs=0.05 * speed)
    assert 1.9 * speed < ahead[:, feet].max() < 3.0 * speed
    assert ahead.mean(axis=0) == pytest.approx(speed, abs=0.1), "on the average it moves along"
    left, right = np.flatnonzero(feet)
    assert np.corrcoef(ahead[:, left], ahead[:, right])[0, 1] < -0.99, "one foot after the other"


def test_limbs_move_as_their_speeds_say():
    at, velocity, _ = walked("pedestrian", 1.4)
    moved = np.diff(at[..., 0], axis=0) / 0.002
    between = 0.5 * (velocity[1:, :, 0] + velocity[:-1, :, 0])
    assert moved == pytest.approx(between, abs=0.02)


@pytest.mark.parametrize(("name", "count"), [("car", 4), ("bicycle", 8)])
def test_a_wheels_points_go_from_standstill_to_twice_the_speed(name, count):
    speed = 8.0
    at, velocity, rows = walked(name, speed)
    rims = rows["motion"] == RIM
    assert rims.sum() == count
    ahead, up = velocity[:, rims, 0], velocity[:, rims, 2]
    assert ahead.min() == pytest.approx(0.0, abs=0.02 * speed)
    assert ahead.max() == pytest.approx(2.0 * speed, abs=0.02 * speed)
    assert np.hypot(ahead - speed, up) == pytest.approx(speed, abs=1e-6)
    rise = np.diff(at[:, rims, 2], axis=0) / 0.002
    assert rise == pytest.approx(0.5 * (up[1:] + up[:-1]), abs=0.2)
