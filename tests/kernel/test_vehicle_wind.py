"""Wind on a vehicle: drag by the speed through the air, side force, yaw moment, standing still."""

import numpy as np
import pytest
import warp as wp

from twin.vehicle.fleet import Fleet
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
CPU = wp.get_device("cpu")
CAR = load_vehicle("opencav")
RHO = 1.225


def coast(winds, speed_mps=25.0, brake=0.0, steps=1):
    """One car per wind, without throttle; state [W, T] after ``steps``."""
    fleet = Fleet([CAR], len(winds), CPU)
    for slot, wind in enumerate(winds):
        fleet.place(slot, 0.0, speed_mps, 0.8, refresh=False)
        fleet.wind[slot] = wind
        fleet.commands[slot, 0, :, 1] = brake
    fleet.refresh()
    fleet.active[:] = 1
    fleet.advance(steps)
    return fleet.state[:, 0].copy()


def test_drag_follows_the_speed_through_the_air():
    winds = [(0.0, 0.0), (-12.0, 0.0), (12.0, 0.0)]
    speed, calm_to = 25.0, []
    rows = coast(winds, speed)
    accel = rows[:, COLUMN["specific_force_x_mps2"]]
    for (x, _), a in zip(winds, accel, strict=True):
        force = -0.5 * RHO * CAR.aero.idle_m2 * ((speed - x) ** 2 - speed**2)
        calm_to.append(((a - accel[0]) * CAR.mass_kg, force))
    for found, expected in calm_to[1:]:
        assert found == pytest.approx(expected, rel=1e-6)


def test_cross_wind_pushes_aside_and_turns_the_nose_away():
    calm, left = coast([(0.0, 0.0), (0.0, 10.0)], steps=1)  # blows to the left
    through = np.hypot(25.0, 10.0)
    across = 0.5 * RHO * through * 10.0
    drag = 0.5 * RHO * CAR.aero.idle_m2 * through * 10.0
    force = (left - calm)[COLUMN["velocity_y_mps"]] / 0.002 * CAR.mass_kg
    assert force == pytest.approx(across * CAR.aero.side_m2 + drag, rel=0.02)
    assert left[COLUMN["yaw_rate_radps"]] > calm[COLUMN["yaw_rate_radps"]]
    later = coast([(0.0, 0.0), (0.0, 10.0), (0.0, -10.0)], steps=500)
    y = later[:, COLUMN["y_m"]]
    assert 0.02 < y[1] < 3.0
    assert y[2] == pytest.approx(-y[1], rel=0.02)


def test_a_braked_car_stands_in_a_storm():
    rows = coast([(0.0, 25.0), (-25.0, 0.0), (0.0, 0.0)], 0.0, brake=0.5, steps=1000)
    still = rows[2]
    for row in rows[:2]:
        assert row[COLUMN["speed_mps"]] == 0.0
        assert row[COLUMN["x_m"]] == still[COLUMN["x_m"]]
        assert row[COLUMN["y_m"]] == still[COLUMN["y_m"]]
        assert row[COLUMN["yaw_rad"]] == still[COLUMN["yaw_rad"]]


def test_placing_a_vehicle_calms_its_slot():
    fleet = Fleet([CAR], 1, CPU)
    fleet.wind[0] = (3.0, 4.0)
    fleet.place(0, 0.0, 0.0, 0.8)
    assert not fleet.wind.any()
