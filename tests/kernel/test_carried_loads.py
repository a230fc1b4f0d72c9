"""Loads in a vehicle: masses against plain mechanics, and what they change on the road."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.vehicle.fleet import Fleet
from twin.vehicle.masses import NO_LOAD, Load, masses_of
from twin.vehicle.model import GRAVITY_MPS2, vehicle_model
from twin.vehicle.state import COLUMN, columns
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
CPU = wp.get_device("cpu")
CAR = load_vehicle("opencav")
FULL = Load(420.0, 0.9, 0.2, 0.8)
STEPS = 25


def braked(loads, speed_mps=15.0):
    """Rows of vehicles with ``loads`` that brake to rest, one slot each [ticks, S, T]."""
    fleet = Fleet([CAR], len(loads), CPU)
    for slot, load in enumerate(loads):
        fleet.load(slot, load)
        fleet.place(slot, 0.0, speed_mps, 0.9)
    fleet.active[:] = 1
    fleet.commands[:, 0, :, 1] = 0.6
    rows = []
    for tick in range(100):
        fleet.first_step[:] = tick * STEPS
        fleet.advance(STEPS)
        rows.append(fleet.state[:, 0].copy())
    return np.array(rows)


def test_a_load_moves_the_centre_of_mass_to_where_levers_have_it():
    empty, loaded = masses_of(CAR), masses_of(CAR, FULL)
    sprung = empty.corners.sum()
    before = -empty.wheels[2:].mean(axis=0)  # from the middle of the rear axle
    after = -loaded.wheels[2:].mean(axis=0)
    total = sprung + FULL.mass_kg
    expected = (sprung * before + FULL.mass_kg * np.array([FULL.x_m, FULL.y_m])) / total
    np.testing.assert_allclose(after, expected, atol=1e-12)
    height_m = (sprung * empty.com_height_m + FULL.mass_kg * FULL.z_m) / total
    assert loaded.com_height_m == pytest.approx(height_m, rel=1e-12)
    assert loaded.corners.sum() == pytest.approx(total, rel=1e-12)


def test_inertia_of_a_load_is_that_of_parallel_axes():
    empty, loaded = masses_of(CAR), masses_of(CAR, FULL)
    way = np.array([FULL.x_m, FULL.y_m, FULL.z_m])
    way -= [*-empty.wheels[2:].mean(axis=0), empty.com_height_m]
    sprung = empty.corners.sum()
    reduced = (
        sprung * FULL.mass_kg / (sprung + FULL.mass_kg)
    )  # two bodies about their common centre
    expected = empty.inertia + reduced * (way @ way * np.eye(3) - np.outer(way, way))
    np.testing.assert_allclose(loaded.inertia, expected, rtol=1e-9, atol=1e-9)


def test_a_loaded_vehicle_stands_still_and_level_under_its_weight():
    fleet = Fleet([CAR], 1, CPU)
    fleet.load(0, FULL)
    fleet.place(0, 3.0, 0.0, 0.9, y_m=1.0)
    fleet.active[0] = 1
    fleet.advance(1000)
    state = fleet.state[0, 0]
    assert state[COLUMN["x_m"]] == pytest.approx(3.0, abs=1e-3)
    assert state[COLUMN["y_m"]] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(state[columns("orientation")][:2]).max() < 1e-4
    weight_n = (CAR.mass_kg + FULL.mass_kg) * GRAVITY_MPS2
    assert state[columns("load")].sum() == pytest.approx(weight_n, rel=1e-3)


def test_brakes_of_the_empty_car_stop_a_loaded_one_later():
    rows = braked([NO_LOAD, FULL])
    way_m = rows[-1, :, COLUMN["x_m"]]
    assert (rows[-1, :, COLUMN["speed_mps"]] == 0.0).all()
    ratio = (CAR.mass_kg + FULL.mass_kg) / CAR.mass_kg
    # The braking way grows with the mass; of the whole way a part is the pedal's.
    assert 1.0 + 0.6 * (ratio - 1.0) < way_m[1] / way_m[0] < ratio


def test_slots_have_their_own_loads_and_lose_them():
    alone = [braked([load])[:, 0] for load in (NO_LOAD, FULL, Load(75.0, 1.5, -0.4, 0.6))]
    together = braked([Load(75.0, 1.5, -0.4, 0.6), NO_LOAD, FULL, NO_LOAD])
    for slot, expected in ((0, alone[2]), (1, alone[0]), (2, alone[1]), (3, alone[0])):
        np.testing.assert_array_equal(together[:, slot], expected)
    fleet = Fleet([CAR], 1, CPU)
    fleet.load(0, FULL)
    fleet.place(0, 0.0, 5.0, 0.9)
    fleet.load(0, NO_LOAD)
    fleet.place(0, 0.0, 5.0, 0.9)
    other = Fleet([CAR], 1, CPU)
    other.place(0, 0.0, 5.0, 0.9)
    np.testing.assert_array_equal(fleet.state, other.state)


def test_a_load_that_lifts_a_wheel_is_refused():
    with pytest.raises(ValueError, match="lifts a wheel"):
        vehicle_model(CAR, Load(700.0, -6.0, 0.0, 0.5))
