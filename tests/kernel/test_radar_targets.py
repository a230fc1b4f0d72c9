"""The radar against closed forms: cross sections, cells, folding, two targets, angles."""

import math

import numpy as np
import pytest
from radar_rigs import (
    AZIMUTH,
    ELEVATION,
    HEIGHT_M,
    RANGE,
    RCS,
    SNR,
    SPEED,
    measure,
    radar,
    small_profile,
    vehicle_row,
)

from twin.sensors.radar.bodies import CYLINDER, LOBE, PLATE, SPHERE, TRIHEDRAL, Reflector

PROFILE = small_profile()
LAMBDA_M = PROFILE.wavelength_m
TO_RADAR = math.pi


def dbsm(m2):
    return 10.0 * math.log10(m2)


def seen(*reflectors, **state):
    return measure(radar(reflectors=reflectors, **state))[0]


def point(x_m, y_m=0.0, m2=1.0, speed_mps=0.0, z_m=HEIGHT_M):
    return Reflector(LOBE, (x_m, y_m, z_m), size_m=(m2, 100.0), velocity_mps=(speed_mps, 0.0))


@pytest.mark.parametrize(
    ("shape", "size_m", "m2"),
    [
        (SPHERE, (0.3,), math.pi * 0.3**2),
        (PLATE, (0.1, 0.1), 4.0 * math.pi * 0.1**4 / LAMBDA_M**2),
        (PLATE, (0.05, 0.15), 4.0 * math.pi * 0.0075**2 / LAMBDA_M**2),
        (TRIHEDRAL, (0.06,), 12.0 * math.pi * 0.06**4 / LAMBDA_M**2),
        (CYLINDER, (0.03, 0.15), 2.0 * math.pi * 0.03 * 0.15**2 / LAMBDA_M),
    ],
)
@pytest.mark.parametrize("range_m", [12.07, 25.2])
def test_the_radar_equation_gives_closed_cross_sections(shape, size_m, m2, range_m):
    rows = seen(Reflector(shape, (range_m, 0.0, HEIGHT_M), TO_RADAR, size_m))
    assert len(rows) == 1
    assert rows[0, RCS] == pytest.approx(dbsm(m2), abs=0.5)
    assert rows[0, RANGE] == pytest.approx(range_m, abs=0.1 * PROFILE.range_cell_m)


def test_signal_to_noise_is_that_of_the_radar_equation():
    in_cell = PROFILE.speed_min_mps + 40.0 * PROFILE.speed_cell_mps
    rows = seen(point(70.0 * PROFILE.range_cell_m, m2=0.5, speed_mps=in_cell))
    far_m = 70.0 * PROFILE.range_cell_m
    power_w, gain, noise_w = 10 ** (-18 / 10), 10 ** (13.0 / 10), 1.380649e-23 * 290.0 * 10**1.3
    received_w = power_w * gain**2 * LAMBDA_M**2 * 0.5 / ((4 * math.pi) ** 3 * far_m**4 * 10**0.3)
    energy = received_w * PROFILE.chirps * PROFILE.chirp_s * PROFILE.antennas
    windows_db = 2 * 2.13
    assert rows[0, SNR] == pytest.approx(dbsm(energy / noise_w) - windows_db, abs=0.1)


@pytest.mark.parametrize("off_deg", [0.4, 0.8, 2.0])
def test_a_plate_has_the_lobe_of_its_side(off_deg):
    side_m, range_m = 0.1, 20.0
    facing = TO_RADAR + math.radians(off_deg)
    rows = seen(Reflector(PLATE, (range_m, 0.0, HEIGHT_M), facing, (side_m, side_m)))
    x = 2.0 * math.pi / LAMBDA_M * side_m * math.sin(math.radians(off_deg))
    lobe = (math.sin(x) / x * math.cos(math.radians(off_deg))) ** 2
    m2 = 4.0 * math.pi * side_m**4 / LAMBDA_M**2 * lobe
    assert rows[0, RCS] == pytest.approx(dbsm(m2), abs=0.5)


def test_a_large_plate_nearby_is_its_mirror_image():
    rows = seen(Reflector(PLATE, (15.0, 0.0, HEIGHT_M), TO_RADAR, (3.0, 3.0)))
    assert rows[0, RCS] == pytest.approx(dbsm(math.pi * 15.0**2), abs=0.5)


def test_a_corner_that_looks_away_is_not_there():
    assert len(seen(Reflector(TRIHEDRAL, (15.0, 0.0, HEIGHT_M), 0.0, (0.1,)))) == 0


@pytest.mark.parametrize("share", [0.0, 0.13, 0.31, 0.5, 0.77])
def test_range_and_speed_have_no_bias(share):
    range_m = (60.0 + share) * PROFILE.range_cell_m
    speed = PROFILE.speed_min_mps + (30.0 + share) * PROFILE.speed_cell_mps
    rows = seen(point(range_m, speed_mps=speed))
    assert len(rows) == 1
    assert rows[0, RANGE] == pytest.approx(range_m, abs=0.1 * PROFILE.range_cell_m)
    assert rows[0, SPEED] == pytest.approx(speed, abs=0.1 * PROFILE.speed_cell_mps)
    assert rows[0, RCS] == pytest.approx(0.0, abs=0.5)


def test_speed_is_relative_to_the_radar_and_positive_when_it_moves_away():
    rows = measure(radar(reflectors=[point(20.0, speed_mps=12.0)]), vehicle_row(speed_mps=8.0))[0]
    assert rows[0, SPEED] == pytest.approx(4.0, abs=0.06)


def test_a_speed_beyond_the_span_is_folded():
    span = PROFILE.speed_cell_mps * PROFILE.chirps
    rows = seen(point(20.0, speed_mps=PROFILE.speed_min_mps - 3.0))
    assert rows[0, SPEED] == pytest.approx(PROFILE.speed_min_mps - 3.0 + span, abs=0.06)


def test_nothing_comes_from_beyond_the_last_cell():
    assert len(seen(point(60.0, m2=1e6))) == 0


def test_two_targets_in_a_cell_are_one_and_three_cells_apart_are_two():
    cell = PROFILE.range_cell_m
    assert len(seen(point(50.1 * cell), point(50.5 * cell))) == 1
    rows = seen(point(50.0 * cell), point(53.0 * cell))
    assert rows[:, RANGE] == pytest.approx([50.0 * cell, 53.0 * cell], abs=0.1 * cell)
    step = PROFILE.speed_cell_mps
    rows = seen(point(50.0 * cell), point(50.0 * cell, speed_mps=3.0 * step))
    assert sorted(rows[:, SPEED]) == pytest.approx([0.0, 3.0 * step], abs=0.1 * step)


@pytest.mark.parametrize("azimuth_deg", [-40.0, -7.0, 0.0, 13.0, 55.0])
def test_azimuth_is_positive_to_the_left(azimuth_deg):
    azimuth = math.radians(azimuth_deg)
    rows = seen(point(20.0 * math.cos(azimuth), 20.0 * math.sin(azimuth), m2=30.0))
    assert len(rows) == 1
    assert rows[0, AZIMUTH] == pytest.approx(azimuth, abs=0.002)
    assert rows[0, RCS] == pytest.approx(dbsm(30.0), abs=0.5)


@pytest.mark.parametrize("rise_m", [-0.4, 0.0, 2.0])
def test_elevation_is_positive_upwards(rise_m):
    rows = seen(point(20.0, m2=10.0, z_m=HEIGHT_M + rise_m))
    assert rows[0, ELEVATION] == pytest.approx(math.atan(rise_m / 20.0), abs=0.002)


def test_two_directions_of_a_cell_are_two_rows_sorted_by_azimuth():
    rows = seen(point(18.0, 8.0, m2=20.0), point(18.0, -8.0, m2=20.0))
    assert np.sign(rows[:, AZIMUTH]).tolist() == [-1.0, 1.0]
    assert np.abs(rows[:, AZIMUTH]) == pytest.approx(math.atan(8.0 / 18.0), abs=0.02)


def test_the_field_of_view_ends():
    inside, outside = math.radians(57.0), math.radians(63.0)
    assert len(seen(point(10.0 * math.cos(inside), 10.0 * math.sin(inside), m2=100.0))) == 1
    assert len(seen(point(10.0 * math.cos(outside), 10.0 * math.sin(outside), m2=100.0))) == 0


def test_rain_weakens_by_twice_the_way():
    sensor = radar(reflectors=[point(20.0)])
    clear = measure(sensor)[0]
    sensor.weather(0, rain_mm_per_h=100.0)
    wet = measure(sensor)[0]
    k, alpha = 1.1258, 0.7076  # of 76.5 GHz, between the rows of 70 and 80 GHz of P.838's table
    lost_db = 2.0 * 0.020 * k * 100.0**alpha
    assert clear[0, RCS] - wet[0, RCS] == pytest.approx(lost_db, rel=0.02)


def test_the_road_adds_a_second_way():
    """Two-ray model: between null and crest the echo changes by decibels."""
    levels = []
    for range_m in np.linspace(20.0, 21.0, 21):
        rows = seen(point(range_m, m2=10.0), multipath=1)
        levels.append(rows[0, RCS] if len(rows) else -30.0)
    flat = seen(point(20.0, m2=10.0))[0, RCS]
    assert max(levels) > flat + 3.0
    assert max(levels) < flat + 12.1
    assert min(levels) < max(levels) - 3.0
