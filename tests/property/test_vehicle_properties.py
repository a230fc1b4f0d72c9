"""What holds for every vehicle in range and every way to drive it."""

import math

import msgspec
import numpy as np
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from twin.validate.straight import stop
from twin.vehicle.fleet import Fleet
from twin.vehicle.model import GRAVITY_MPS2, vehicle_model
from twin.vehicle.state import COLUMN, columns
from twin.vehicle.vehicle_file import MPH_60_MPS, Vehicle, load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
CPU = wp.get_device("cpu")
CAR = load_vehicle("opencav")
NUMBERS = settings(max_examples=30, deadline=None, derandomize=True)

vehicles = st.builds(
    lambda scale, front, height, wheelbase, track, w_f, w_r, zeta, driven, abs_, slip: replace(
        CAR,
        wheelbase_m=wheelbase,
        track_m=track,
        length_m=wheelbase + 2.1,
        rear_overhang_m=1.0,
        body=replace(
            CAR.body,
            corner_mass_kg=[
                *(scale * front / 2, scale * front / 2),
                *(scale * (1 - front) / 2, scale * (1 - front) / 2),
            ],
            com_height_m=height,
        ),
        front=replace(CAR.front, natural_frequency_radps=w_f, damping_ratio=zeta),
        rear=replace(CAR.rear, natural_frequency_radps=w_r, damping_ratio=zeta),
        driveline=replace(CAR.driveline, driven=driven),
        brakes=replace(CAR.brakes, abs=abs_),
        rear_tyres=replace(
            CAR.rear_tyres, lateral=replace(CAR.rear_tyres.lateral, slip_extremum=slip)
        ),
    ),
    scale=st.floats(700.0, 3000.0),
    front=st.floats(0.4, 0.65),
    height=st.floats(0.4, 0.8),
    wheelbase=st.floats(2.2, 3.6),
    track=st.floats(1.4, 1.9),
    w_f=st.floats(6.0, 14.0),
    w_r=st.floats(6.0, 14.0),
    zeta=st.floats(0.1, 0.8),
    driven=st.sampled_from(["front", "rear", "all"]),
    abs_=st.booleans(),
    slip=st.floats(0.08, 0.2),
)
pedals = st.tuples(
    st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-0.7, 0.7), st.floats(0.0, 1.0)
)


def energy(vehicle: Vehicle, rows: np.ndarray) -> np.ndarray:
    """Kinetic and potential energy of body, wheels and springs over time [J]."""
    model = vehicle_model(vehicle)
    inertia = np.array(model.inertia).reshape(3, 3)
    velocity, rate = rows[:, columns("body_velocity")], rows[:, columns("rate")]
    found = float(model.mass) * (velocity[:, :2] ** 2).sum(axis=1) / 2
    found += float(model.sprung_mass) * velocity[:, 2] ** 2 / 2
    found += np.einsum("ni,ij,nj->n", rate, inertia, rate) / 2
    found += vehicle.wheels.inertia_kgm2 * (rows[:, columns("wheel_speed")] ** 2).sum(axis=1) / 2
    height = rows[:, COLUMN["com_z_m"]] - vehicle.body.com_height_m
    found += float(model.sprung_mass) * GRAVITY_MPS2 * height
    springs = rows[:, columns("suspension")] ** 2 * np.array(model.stiffness)
    return found + springs.sum(axis=1) / 2


@NUMBERS
@given(
    vehicle=vehicles,
    friction=st.floats(0.1, 1.0),
    speed=st.floats(-5.0, 45.0),
    asked=st.lists(pedals, min_size=1, max_size=5),
)
def test_no_way_to_drive_leaves_the_limits(vehicle, friction, speed, asked):
    fleet = Fleet([vehicle], 1, CPU)
    fleet.place(0, 0.0, speed, friction)
    fleet.active[0] = 1
    for k, (throttle, brake, steering, handbrake) in enumerate(asked):
        fleet.commands[0, 0] = (throttle, brake, steering, handbrake, 1.0)
        fleet.first_step[0] = 500 * k
        fleet.advance(500)
        state = fleet.state[0, 0]
        assert fleet.fault(0) == ""
        assert (state[columns("load")] >= 0.0).all()
        assert np.linalg.norm(state[columns("orientation")]) - 1.0 < 1e-9
        shares = [*state[columns("pressure")], state[COLUMN["traction"]]]
        assert all(0.0 <= share <= 1.0 for share in shares)
        assert abs(state[COLUMN["steering_rad"]]) <= vehicle.steering.max_rad


@NUMBERS
@given(vehicle=vehicles, friction=st.floats(0.2, 1.0), speed=st.floats(5.0, 40.0))
def test_a_stop_is_never_shorter_than_friction_allows(vehicle, friction, speed):
    run = stop(vehicle, speed, friction)
    assert run.end[COLUMN["held"]] == 1.0
    way = run.end[COLUMN["x_m"]]
    # Rolling resistance and air drag help the tyres by this much at most.
    drag = 0.5 * 1.225 * vehicle.aero.idle_m2 * speed**2 / vehicle.mass_kg
    help_mps2 = drag + vehicle.wheels.rolling_resistance * GRAVITY_MPS2
    assert way > 0.97 * speed**2 / (2 * (friction * GRAVITY_MPS2 + help_mps2))
    assert abs(run.end[COLUMN["y_m"]]) < 1e-6


@NUMBERS
@given(vehicle=vehicles, distance=st.floats(46.0, 70.0))
def test_the_calibrated_distance_is_kept(vehicle, distance):
    """As long as the tyres can give what the distance asks for."""
    car = replace(vehicle, brakes=replace(vehicle.brakes, distance_60mph_m=distance, abs=True))
    run = stop(car, MPH_60_MPS, 1.0)
    assert abs(run.end[COLUMN["x_m"]] / distance - 1.0) < 0.02


@NUMBERS
@given(
    vehicle=vehicles,
    speed=st.floats(1.0, 40.0),
    steering=st.floats(-0.3, 0.3),
    friction=st.floats(0.1, 1.0),
)
def test_coasting_never_gains_energy(vehicle, speed, steering, friction):
    fleet = Fleet([vehicle], 1, CPU)
    fleet.place(0, 0.0, speed, friction)
    fleet.active[0] = 1
    fleet.commands[0, 0] = (0.0, 0.0, steering, 0.0, 0.0)
    rows = [fleet.state[0, 0].copy()]
    for k in range(60):
        fleet.first_step[0] = 25 * k
        fleet.advance(25)
        rows.append(fleet.state[0, 0].copy())
    found = energy(vehicle, np.array(rows))
    # The tyres' vertical springs are left out: they hold some joules more or less.
    scale = vehicle.mass_kg * (speed**2 / 2 + 0.2)
    assert (np.diff(found) < 0.005 * scale).all()
    assert found[-1] < found[0] + 1.0


@NUMBERS
@given(vehicle=vehicles)
def test_masses_and_inertia_are_physical(vehicle):
    model = vehicle_model(vehicle)
    inertia = np.array(model.inertia).reshape(3, 3)
    values = np.linalg.eigvalsh(inertia)
    assert (values > 0.0).all()
    share = float(model.wheel_x[0]) - float(model.wheel_x[2])
    assert math.isclose(share, vehicle.wheelbase_m, rel_tol=1e-9)
    again = msgspec.convert(msgspec.to_builtins(vehicle), Vehicle)
    assert again == vehicle
