"""Echoes by other ways: walls that mirror, and the road below a vehicle."""

import math

import numpy as np
import pytest
from lidar_rigs import world
from radar_rigs import (
    AZIMUTH,
    ELEVATION,
    HEIGHT_M,
    RANGE,
    RCS,
    SPEED,
    measure,
    radar,
    small_profile,
    vehicle_row,
)

from twin.sensors.radar.bodies import LOBE, Reflector
from twin.world.meshes import materials

PROFILE = small_profile()
METAL = 0.9
"""Reflectance of a sign's face."""


def rail(y_m, start_m=-10.0, end_m=60.0):
    """An upright face along x."""
    return [(start_m, y_m, 0.0), (end_m, y_m, 0.0), (end_m, y_m, 3.0), (start_m, y_m, 3.0)]


def point(x_m, y_m=0.0, m2=100.0, velocity=(0.0, 0.0), z_m=HEIGHT_M):
    return Reflector(LOBE, (x_m, y_m, z_m), size_m=(m2, 100.0), velocity_mps=velocity)


def seen(*quads, reflectors, material=materials.SIGN, row=None, boxes=(), **state):
    """Detections without the road's second way, which would disturb the levels."""
    scene = world(*quads, material=material, boxes=boxes)
    sensor = radar(reflectors=reflectors, scene=scene, multipath=1, **state)
    return measure(sensor, *([] if row is None else [row]))[0]


def nearest(rows, range_m, azimuth_rad):
    off = np.hypot(rows[:, RANGE] - range_m, 10.0 * (rows[:, AZIMUTH] - azimuth_rad))
    return rows[np.argmin(off)]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_mirrors_a_target_behind_it(side):
    """Image of (20, 0) in the plane y = 5 is (20, 10); the other two lie half way."""
    rows = seen(rail(5.0 * side), reflectors=[point(20.0)])
    angle, far = side * math.atan2(10.0, 20.0), math.hypot(20.0, 10.0)
    image = nearest(rows, far, angle)
    cell = PROFILE.range_cell_m
    assert image[RANGE] == pytest.approx(far, abs=0.15 * cell)
    assert image[AZIMUTH] == pytest.approx(angle, abs=0.01)
    assert image[RCS] == pytest.approx(20.0 + 20.0 * math.log10(METAL), abs=0.7)
    for azimuth in (0.0, angle):
        once = nearest(rows, 0.5 * (20.0 + far), azimuth)
        assert once[RANGE] == pytest.approx(0.5 * (20.0 + far), abs=0.15 * cell)
        assert once[AZIMUTH] == pytest.approx(azimuth, abs=0.03)


def test_a_ghost_moves_as_the_mirrored_target():
    rows = seen(rail(-5.0), reflectors=[point(20.0, velocity=(4.0, -3.0))],
                row=vehicle_row(speed_mps=2.0))  # fmt: skip
    far = math.hypot(20.0, 10.0)
    unit = np.array([20.0, -10.0]) / far
    image = nearest(rows, far, -math.atan2(10.0, 20.0))
    expected = unit @ np.array([4.0 - 2.0, 3.0])
    assert image[SPEED] == pytest.approx(expected, abs=0.1 * PROFILE.speed_cell_mps)


def test_no_ghost_without_a_face_at_the_place_of_reflection():
    """The way by the wall meets it at x = 10."""
    assert len(seen(rail(-5.0), reflectors=[point(20.0)])) > 1
    short = seen(rail(-5.0, 12.0, 60.0), reflectors=[point(20.0)])
    assert len(short) == 1
    assert short[0, RANGE] == pytest.approx(20.0, abs=0.05)


def test_no_ghost_by_leaves_and_none_without_multipath():
    leaves = seen(rail(-5.0), reflectors=[point(20.0)], material=materials.FOLIAGE)
    assert len(leaves) == 1
    scene = world(rail(-5.0), material=materials.SIGN)
    assert len(measure(radar(reflectors=[point(20.0)], scene=scene))[0]) == 1


def car(rear_m, floor_m):
    """A box with a length of 4.5 m whose floor is so high."""
    return ((rear_m, -0.9, floor_m), (rear_m + 4.5, 0.9, 1.5))


def test_the_vehicle_before_the_leader_is_seen_below_it():
    """By one reflection at x = 13.6 m; with a floor at 5 cm nothing gets through."""
    target = point(30.0, z_m=0.6)
    far = [(900.0, 0.0, 0.0), (901.0, 0.0, 0.0), (901.0, 1.0, 0.0), (900.0, 1.0, 0.0)]
    rows = seen(far, reflectors=[target], boxes=[car(12.0, 0.24)])
    assert len(rows) == 1
    assert rows[0, RANGE] == pytest.approx(math.hypot(30.0, 1.1), abs=0.1 * PROFILE.range_cell_m)
    assert rows[0, ELEVATION] == pytest.approx(-math.atan2(1.1, 30.0), abs=0.003)
    sine = 1.1 / math.hypot(30.0, 1.1)
    root = math.sqrt(3.0 + sine**2)
    fresnel = (4.0 * sine - root) / (4.0 * sine + root)
    assert rows[0, RCS] == pytest.approx(20.0 + 40.0 * math.log10(abs(fresnel)), abs=0.5)
    assert len(seen(far, reflectors=[target], boxes=[car(12.0, 0.05)])) == 0
    direct = measure(radar(reflectors=[target], scene=world(far, boxes=[car(12.0, 0.24)])))
    assert len(direct[0]) == 0, "without second ways it is hidden"
