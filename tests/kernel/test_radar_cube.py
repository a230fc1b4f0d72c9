"""The radar's cube against NumPy, against its own map and detections, and equal bytes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lidar_rigs import CPU
from radar_rigs import AZIMUTH, HEIGHT_M, RANGE, SPEED, measure, radar, small_profile, vehicle_row

from schemas.kinds.sensors.radar_cube import AZIMUTHS, RANGES, SPEEDS
from twin.sensors.radar.bodies import LOBE, Reflector
from twin.sensors.radar_cube.cube import RadarCubes, beam_turns

PROFILE = small_profile()
TARGETS = [
    Reflector(LOBE, (20.0, y, HEIGHT_M), size_m=(m2, 100.0), velocity_mps=(v, 0.0))
    for y, m2, v in ((6.0, 5.0, 3.0), (-9.0, 2.0, -4.0), (1.0, 0.5, 0.0))
]


def cubes(sensor, *rows, tick=0):
    """Cubes of a measurement [S, R, V, A], and the detections."""
    found = measure(sensor, *rows, tick=tick)
    cube = RadarCubes(sensor.geometry.slots, CPU)
    cube.clear()
    cube.take(sensor)
    return cube.cube.pull(), found


def test_a_cube_is_the_fourier_transform_over_the_lower_row():
    sensor = radar(reflectors=TARGETS)
    cube, _ = cubes(sensor)
    shape = (PROFILE.chirps, PROFILE.samples)
    pairs = np.where(sensor.touched.numpy()[:, None, None] != 0, sensor.signals.numpy(), 0.0)
    lower = (pairs[..., 0] + 1j * pairs[..., 1])[:, : PROFILE.columns].reshape(*shape, -1)
    columns = np.arange(PROFILE.columns)
    beams = np.exp(-2j * np.pi * np.outer(columns, beam_turns()))
    expected = np.abs(lower @ beams) ** 2 / PROFILE.columns
    assert expected.max() > 1e4
    ours = cube[0, : PROFILE.samples, : PROFILE.chirps].transpose(1, 0, 2)
    assert ours == pytest.approx(expected, rel=1e-3, abs=1e-3 * PROFILE.columns)


def test_a_target_is_where_its_detection_is():
    for target in TARGETS:
        cube, (found,) = cubes(radar(reflectors=[target]))
        assert len(found) == 1
        at = np.unravel_index(cube[0].argmax(), cube[0].shape)
        speed = PROFILE.speed_min_mps + at[1] * PROFILE.speed_cell_mps
        across = beam_turns()[at[2]] / PROFILE.spacing
        assert at[0] * PROFILE.range_cell_m == pytest.approx(found[0][RANGE], abs=0.16)
        assert speed == pytest.approx(found[0][SPEED], abs=0.6 * PROFILE.speed_cell_mps)
        assert across == pytest.approx(math.sin(found[0][AZIMUTH]), abs=0.6 * 2 / AZIMUTHS)


def test_noise_is_one_in_every_beam_and_agrees_with_the_map():
    sensor = radar(small_profile(upper=0), noise=1)
    cube, _ = cubes(sensor)
    inside = cube[0, : PROFILE.samples, : PROFILE.chirps]
    assert inside.mean(axis=(0, 1)) == pytest.approx(np.ones(AZIMUTHS), abs=0.06)
    # Parseval: the mean over the beams is that of the antennas, which the map has.
    powers = sensor.power.numpy()[0].T
    assert inside.mean(axis=2) == pytest.approx(powers, rel=1e-3)


def test_cells_beyond_the_profile_and_slots_without_a_case_hold_zeros():
    sensor = radar(slots=2, noise=1)
    sensor.state.host[1]["active"] = 0
    cube, _ = cubes(sensor)
    assert cube.shape == (2, RANGES, SPEEDS, AZIMUTHS)
    assert cube[0, : PROFILE.samples, : PROFILE.chirps].min() > 0.0
    assert not cube[0, PROFILE.samples :].any()
    assert not cube[0, :, PROFILE.chirps :].any()
    assert not cube[1].any()


def test_a_slot_has_the_same_bytes_beside_others_and_others_each_tick():
    rows = [vehicle_row(0.5 * n, 0.0, 4.0) for n in range(3)]
    together = radar(reflectors=TARGETS, slots=3, noise=1)
    cube, _ = cubes(together, *rows, tick=5)
    alone = radar(reflectors=TARGETS, noise=1)
    for slot, row in enumerate(rows):
        alone.reset(0, 7 + slot)
        alone.mount(0, (0.0, 0.0, HEIGHT_M), 0.0)
        for name in ("multipath", "clutter"):
            alone.state.host[0][name] = 0
        single, _ = cubes(alone, row, tick=5)
        assert single[0].tobytes() == cube[slot].tobytes()
    later, _ = cubes(together, *rows, tick=6)
    assert not np.array_equal(later[0], cube[0])


def test_a_profile_with_more_cells_than_a_cube_is_refused():
    cube = RadarCubes(1, CPU)
    with pytest.raises(ValueError, match="512 samples x 64 chirps, but a cube has at most 400 x"):
        cube.take(radar(small_profile(samples=512)))
