"""The whole vehicle against statics: what braking and cornering move between wheels, and how much
its tyres can give at once."""

import numpy as np
import pytest

from twin.validate.track import DriverInput, drive
from twin.vehicle.model import AIR_DENSITY_KGPM3, PHYSICS_STEP_NS, vehicle_model
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
VEHICLES = {name: load_vehicle(name) for name in ("opencav", "bmw_320i")}


def accelerations(run):
    """In the road's plane at every physics step after the first, world axes [N - 1, 2]."""
    return np.diff(run.field("velocity")[:, :2], axis=0) / (PHYSICS_STEP_NS / 1e9)


def moved_load_n(run, begin_s):
    """Mean load of every wheel from ``begin_s`` on, less that at rest [4]."""
    return (run.field("load")[run.time_s >= begin_s] - run.field("load")[0]).mean(axis=0)


def drag_n(vehicle, speed_mps):
    return 0.5 * AIR_DENSITY_KGPM3 * vehicle.aero.idle_m2 * speed_mps**2


@pytest.mark.parametrize("name", list(VEHICLES))
def test_braking_moves_load_forward_by_the_height_of_the_mass_centre(name):
    """Front axle: (m a - drag) h / wheelbase; the drag acts at the mass centre's height."""
    vehicle = VEHICLES[name]

    def driver(time_s, _state):
        return DriverInput(brake=0.3 * min(time_s, 1.0))

    run = drive(vehicle, driver, 3.5, speed_mps=30.0, friction=1.0, every=1)
    late = run.time_s[1:] >= 2.0
    braking_n = -vehicle.mass_kg * accelerations(run)[late, 0].mean()
    at_road_n = braking_n - drag_n(vehicle, run.column("speed_mps")[1:][late]).mean()
    expected_n = at_road_n * vehicle.body.com_height_m / vehicle.wheelbase_m
    moved = moved_load_n(run, 2.0)
    assert moved[:2].sum() == pytest.approx(expected_n, rel=0.035)
    assert moved[2:].sum() == pytest.approx(-expected_n, rel=0.035)


@pytest.mark.parametrize("name", list(VEHICLES))
def test_cornering_moves_load_outwards_by_the_height_of_the_mass_centre(name):
    """Outer wheels: m a h / track."""
    vehicle = VEHICLES[name]
    model = vehicle_model(vehicle)

    def driver(time_s, _state):
        return DriverInput(throttle=0.25, steering_rad=0.03 * min(time_s, 1.0))

    run = drive(vehicle, driver, 7.0, speed_mps=18.0, friction=1.0, every=1)
    yaw, accel = run.column("yaw_rad")[1:], accelerations(run)
    across = accel[:, 1] * np.cos(yaw) - accel[:, 0] * np.sin(yaw)
    track_m = float(model.wheel_y[0] - model.wheel_y[1])
    leaning = across[run.time_s[1:] >= 4.0].mean() * vehicle.body.com_height_m / track_m
    moved = moved_load_n(run, 4.0)
    assert moved[1] + moved[3] == pytest.approx(vehicle.mass_kg * leaning, rel=0.03)
    assert moved[0] + moved[2] == pytest.approx(-vehicle.mass_kg * leaning, rel=0.03)


@pytest.mark.parametrize("friction", [1.0, 0.5])
@pytest.mark.parametrize("steering_rad", [0.05, 0.1, 0.2])
def test_braking_in_a_bend_takes_no_more_than_the_tyres_have(steering_rad, friction):
    """This car's ellipse is a circle: the road's push is at most friction times the load."""
    car, speed_mps = VEHICLES["opencav"], 25.0
    curves = (car.front_tyres, car.rear_tyres)
    assert all(t.longitudinal.force_extremum == t.lateral.force_extremum == 1.0 for t in curves)

    def driver(time_s, _state):
        return DriverInput(
            brake=1.0 if time_s > 0.8 else 0.0, steering_rad=steering_rad * min(time_s / 0.5, 1.0)
        )

    run = drive(car, driver, 2.5, speed_mps=speed_mps, friction=friction, every=1)
    push_n = car.mass_kg * np.hypot(*accelerations(run).T) - drag_n(car, speed_mps)
    share = push_n / (friction * run.field("load")[1:].sum(axis=1))
    assert 0.9 < share.max() <= 1.0
