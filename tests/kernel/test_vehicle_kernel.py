"""The planar vehicle against a NumPy reference and closed forms."""

import math

import msgspec
import numpy as np
import pytest
import warp as wp

from twin.vehicle.planar import COLUMN, PlanarVehicles
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()
G, STEP_S = 9.80665, 0.002
FAR = np.array([[5000.0, 0.0, 0.0, 2.0, 1.0]])


def car(**changes):
    return msgspec.structs.replace(load_vehicle("opencav"), **changes)


def drive(vehicle, command, steps, speed=0.0, friction=0.85, colliders=FAR, chunk=25):
    """State [T] after ``steps`` physics steps under one command."""
    vehicles = PlanarVehicles(vehicle, colliders, 1, wp.get_device("cpu"))
    vehicles.place(0, 0.0, speed, friction)
    vehicles.active[0] = 1
    vehicles.commands[0] = command
    done = 0
    while done < steps:
        now = min(chunk, steps - done)
        vehicles.first_step[0] = done
        vehicles.advance(now)
        done += now
    return vehicles.state[0].copy()


def reference(v, command, steps, friction, speed):
    """The same equations in plain Python: x, y, yaw, speed."""
    x = y = yaw = throttle = brake = steering = 0.0
    gain = {n: -math.expm1(-STEP_S / getattr(v, n)) for n in v.__struct_fields__ if "lag_s" in n}
    for _ in range(steps):
        throttle += (command[0] - throttle) * gain["throttle_lag_s"]
        brake += (command[1] - brake) * gain["brake_lag_s"]
        steering += (command[2] - steering) * gain["steering_lag_s"]
        force = throttle * v.drive_force_max_n - v.pedal_slope_ns_per_m * speed
        force = min(max(force, 0.0), v.drive_power_max_w / max(speed, 0.1))
        grip = friction * v.mass_kg * G
        force = min(max(force - brake * v.brake_force_max_n, -grip), grip)
        force -= 0.5 * 1.225 * v.drag_area_m2 * speed**2 + v.rolling_resistance * v.mass_kg * G
        accel = force / v.mass_kg
        if speed <= 0.0 and accel <= 0.0:
            continue
        after = max(0.0, speed + accel * STEP_S)
        way = (speed + after) / 2 * STEP_S
        if after == 0.0:
            way = speed**2 / (2 * -accel)
        lateral = math.sqrt(max((friction * G) ** 2 - accel**2, 0.0)) / max(after, 0.1)
        rate = min(max(after * math.tan(steering) / v.wheelbase_m, -lateral), lateral)
        x += way * math.cos(yaw + rate * STEP_S / 2)
        y += way * math.sin(yaw + rate * STEP_S / 2)
        yaw += rate * STEP_S
        speed = after
    return x, y, yaw, speed


@pytest.mark.parametrize(
    ("command", "speed", "friction"),
    [
        ((0.2, 0.0, 0.0), 0.0, 0.85),
        ((1.0, 0.0, 0.05), 12.0, 0.85),
        ((0.0, 1.0, 0.0), 20.0, 0.2),
        ((0.3, 0.0, 0.5), 10.0, 0.35),
        ((0.0, 0.0, -0.1), 3.0, 0.55),
    ],
)
def test_matches_the_reference(command, speed, friction):
    state = drive(car(), command, 1500, speed, friction)
    expected = reference(car(), command, 1500, friction, speed)
    np.testing.assert_allclose(state[:4], expected, rtol=1e-9, atol=1e-9)


def test_throttle_0_2_settles_at_about_5_mps_slowly():
    assert 4.0 > drive(car(), (0.2, 0, 0), 5000)[COLUMN["speed_mps"]] > 3.0
    assert drive(car(), (0.2, 0, 0), 30_000)[COLUMN["speed_mps"]] == pytest.approx(5.0, abs=0.15)


@pytest.mark.parametrize(("friction", "decel"), [(0.85, 8.0), (0.55, 0.55 * G), (0.2, 0.2 * G)])
def test_braking_distance_is_v2_over_2a(friction, decel):
    vehicle = car(brake_lag_s=0.0, drag_area_m2=0.0, rolling_resistance=0.0)
    state = drive(vehicle, (0.0, 1.0, 0.0), 8000, 15.0, friction)
    decel = min(decel, vehicle.brake_force_max_n / vehicle.mass_kg)
    assert state[COLUMN["speed_mps"]] == 0.0
    assert state[COLUMN["x_m"]] == pytest.approx(15.0**2 / (2 * decel), rel=1e-9)
    at_s = state[COLUMN["rest_step"]] * STEP_S
    assert at_s == pytest.approx(15.0 / decel, abs=STEP_S)


def test_braking_at_rest_never_moves():
    state = drive(car(), (0.0, 1.0, 0.3), 500)
    assert state[COLUMN["x_m"]] == 0.0
    assert state[COLUMN["speed_mps"]] == 0.0
    assert state[COLUMN["moved"]] == 0.0
    assert state[COLUMN["rest_step"]] == -1.0


def test_pedal_below_rolling_resistance_does_not_creep():
    assert drive(car(), (0.02, 0.0, 0.0), 500)[COLUMN["x_m"]] == 0.0


def test_result_does_not_depend_on_how_steps_are_grouped():
    one = drive(car(), (0.4, 0.0, 0.02), 600, 5.0, chunk=600)
    many = drive(car(), (0.4, 0.0, 0.02), 600, 5.0, chunk=1)
    assert one.tobytes() == many.tobytes()


def test_collision_freezes_at_the_first_contact():
    vehicle = car(drag_area_m2=0.0, rolling_resistance=0.0)
    gap_m = 1.0
    wall = np.array([[vehicle.front_offset_m + gap_m + 2.0, 0.0, 0.0, 2.0, 1.0]])
    state = drive(vehicle, (0.0, 0.0, 0.0), 500, 10.0, colliders=wall)
    assert state[COLUMN["collisions"]] == 1.0
    assert state[COLUMN["impact_speed_mps"]] == 10.0
    assert state[COLUMN["impact_step"]] in (50, 51)  # 1 m at 10 m/s; rounding decides which
    assert state[COLUMN["speed_mps"]] == 0.0
    assert state[COLUMN["dtc_m"]] == 0.0
    assert state[COLUMN["closing_mps"]] == 0.0


def test_any_collider_counts_but_distance_is_to_the_first():
    post = np.array([[500.0, 0.0, 0.0, 2.0, 1.0], [30.0, 1.0, 0.4, 0.2, 0.2]])
    state = drive(car(), (0.0, 0.0, 0.0), 2000, 20.0, colliders=post)
    assert state[COLUMN["collisions"]] == 1.0
    assert state[COLUMN["dtc_m"]] > 400.0
