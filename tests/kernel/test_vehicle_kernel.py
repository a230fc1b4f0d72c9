"""The vehicle: parts against plain formulas, rest, ground, determinism, guards."""

import math

import numpy as np
import pytest
import warp as wp
from msgspec.structs import replace

from twin.validate.track import DriverInput, drive
from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import GroundMesh, drivable
from twin.vehicle.guard import SPEED_MAX_MPS
from twin.vehicle.masses import masses_of
from twin.vehicle.model import GRAVITY_MPS2, vehicle_model
from twin.vehicle.powertrain import overall_ratio
from twin.vehicle.state import COLUMN, columns
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street.build import build_world

prepare_kernels()
CPU = wp.get_device("cpu")
CAR, BMW = load_vehicle("opencav"), load_vehicle("bmw_320i")


def slope_ground(grade, grip=1.0):
    """A plane that rises along x; 400 m of it."""
    points = np.array([[x, y, grade * x] for x in (-200, 200) for y in (-50, 50)], float)
    faces = np.array([[0, 2, 3], [0, 3, 1]])
    return GroundMesh(CPU, points, faces, np.full(2, grip))


def on_ground(ground, command, steps, speed=0.0, friction=0.85, vehicle=CAR, grade=0.0):
    fleet = Fleet([vehicle], 1, CPU, ground=ground)
    fleet.place(0, 0.0, speed, friction)
    pitch = -math.atan(grade)
    x = fleet.state[0, 0, COLUMN["com_x_m"]]
    fleet.state[0, 0, COLUMN["com_z_m"]] = grade * x + vehicle.body.com_height_m / math.cos(pitch)
    fleet.state[0, 0, columns("orientation")] = (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))
    fleet.refresh()
    fleet.active[0] = 1
    fleet.commands[0, 0] = command
    rows = []
    for k in range(0, steps, 50):
        fleet.first_step[0] = k
        fleet.advance(50)
        rows.append(fleet.state[0, 0].copy())
    return np.array(rows)


@pytest.mark.parametrize("vehicle", [CAR, BMW], ids=["opencav", "bmw_320i"])
def test_corner_masses_give_mass_centre_and_inertia(vehicle):
    masses = masses_of(vehicle)
    wheels, mass = masses.wheels, masses.corners
    points = wheels * (vehicle.body.gyration_x, vehicle.body.gyration_y)
    model = vehicle_model(vehicle)
    assert mass.sum() == pytest.approx(float(model.sprung_mass), rel=1e-12)
    assert mass.sum() + 4 * vehicle.wheels.mass_kg == pytest.approx(float(model.mass), rel=1e-12)
    np.testing.assert_allclose(mass @ wheels, 0.0, atol=1e-6 * mass.sum())
    np.testing.assert_allclose(mass @ points, 0.0, atol=1e-6 * mass.sum())
    # The moment about the rear axle is that of the front corners.
    rear_to_centre = -wheels[2, 0]
    moment = mass.sum() * rear_to_centre
    assert moment == pytest.approx((mass[0] + mass[1]) * vehicle.wheelbase_m, rel=1e-6)
    inertia = np.array(model.inertia).reshape(3, 3)
    roll = (mass * points[:, 1] ** 2).sum()
    pitch = (mass * points[:, 0] ** 2).sum()
    assert inertia[0, 0] == pytest.approx(roll, rel=1e-6)
    assert inertia[1, 1] == pytest.approx(pitch, rel=1e-6)
    yaw = roll + pitch + vehicle.wheels.mass_kg * (wheels**2).sum()
    assert inertia[2, 2] == pytest.approx(yaw, rel=1e-6)
    np.testing.assert_allclose(masses_of(vehicle).inertia[0, 1], 0.0, atol=1e-6 * roll)
    np.testing.assert_allclose(
        np.array(model.inertia_inverse).reshape(3, 3) @ inertia, np.eye(3), atol=1e-9
    )


def test_bmw_file_holds_the_package_s_values():
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2

    p = parameters_vehicle2()
    model = vehicle_model(BMW)
    assert float(model.mass) == pytest.approx(p.m, rel=1e-6)
    assert BMW.wheelbase_m == pytest.approx(p.a + p.b, rel=1e-6)
    assert float(model.wheel_x[0]) == pytest.approx(p.a, rel=1e-6)
    assert float(model.wheel_x[2]) == pytest.approx(-p.b, rel=1e-6)
    assert float(model.stiffness[0]) == pytest.approx(p.K_sf, rel=1e-5)
    assert float(model.stiffness[2]) == pytest.approx(p.K_sr, rel=1e-5)
    assert float(model.damping[0]) == pytest.approx(p.K_sdf, rel=1e-5)
    assert float(model.damping[2]) == pytest.approx(p.K_sdr, rel=1e-5)
    assert float(model.inertia[0, 0]) == pytest.approx(p.I_Phi_s, rel=1e-5)
    assert float(model.yaw_inertia) == pytest.approx(p.I_z, rel=1e-5)
    assert BMW.body.com_height_m == pytest.approx(p.h_s, rel=1e-6)
    assert BMW.front.antiroll_nm_per_rad == pytest.approx(-p.K_tsf, rel=1e-5)
    curve = BMW.front_tyres.lateral
    slope = curve.shape * curve.force_extremum / curve.slip_extremum
    assert slope == pytest.approx(-p.tire.p_ky1, rel=1e-3)
    camber = (-p.tire.p_ky1 * p.tire.p_hy3 - p.tire.p_vy3) / -p.tire.p_ky1
    assert BMW.front.roll_steer == pytest.approx(camber * (1 + p.D_f * p.T_f / 2), rel=1e-4)
    assert BMW.rear.roll_steer == pytest.approx(camber * (1 + p.D_r * p.T_r / 2), rel=1e-4)


def test_body_and_wheels_move_like_a_quarter_car():
    """Free heave on the file's own tyres against the two-mass system's slow mode."""
    quarter = sum(CAR.body.corner_mass_kg) / 4
    alike = replace(CAR, rear=CAR.front, body=replace(CAR.body, corner_mass_kg=[quarter] * 4))
    model = vehicle_model(alike)
    k, b = float(model.stiffness[0]), float(model.damping[0])
    kt, ct, m = alike.wheels.stiffness_n_per_m, alike.wheels.damping_ns_per_m, alike.wheels.mass_kg
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = np.array([-k, k, -b, b]) / quarter
    a[3] = np.array([k, -(k + kt), b, -(b + ct)]) / m
    modes = np.linalg.eigvals(a)
    slow = min(modes, key=abs)

    def drop(state):
        state[COLUMN["com_z_m"]] -= 0.01
        state[columns("suspension")] += 0.01

    run = drive(alike, lambda t, s: DriverInput(brake=1.0), 1.5, start=drop, every=1)
    z = run.column("com_z_m") - alike.body.com_height_m
    first = (z[102:] - z[100:-2]) / 0.004
    second = (z[102:] - 2 * z[101:-1] + z[100:-2]) / 0.002**2
    (damping, square), *_ = np.linalg.lstsq(
        np.stack([first, z[101:-1]], axis=1), -second, rcond=None
    )
    assert math.sqrt(square) == pytest.approx(abs(slow), rel=0.02)
    assert damping / 2 == pytest.approx(-slow.real, rel=0.03)


def test_rest_is_exact_and_does_not_creep():
    for pedals in (
        DriverInput(),
        DriverInput(brake=1.0, steering_rad=0.3),
        DriverInput(throttle=0.005),
    ):
        run = drive(CAR, lambda t, s, p=pedals: p, 3.0, friction=0.85)
        assert (run.column("speed_mps") == 0.0).all()
        assert (run.column("com_x_m") == run.column("com_x_m")[0]).all()
        assert (run.column("com_y_m") == run.column("com_y_m")[0]).all()
        assert (run.column("moved") == 0.0).all()
        assert (run.column("rest_step") == -1.0).all()
        np.testing.assert_allclose(run.field("specific_force")[-1], [0, 0, GRAVITY_MPS2], atol=1e-6)


@pytest.mark.parametrize("friction", [0.85, 0.2])
def test_a_stop_does_not_ring(friction):
    run = drive(
        CAR, lambda t, s: DriverInput(brake=0.7), 12.0, speed_mps=8.0, friction=friction, every=1
    )
    speed = run.column("speed_mps")
    assert (np.diff(speed) <= 0.02).all()
    assert (speed >= 0.0).all()
    rest = int(np.argmax(speed == 0.0))
    assert rest > 0
    assert (speed[rest:] == 0.0).all()
    assert run.end[COLUMN["rest_step"]] == rest
    for name in ("com_x_m", "com_y_m"):
        assert (run.column(name)[rest:] == run.column(name)[rest]).all()


def test_walking_pace_does_not_ring():
    run = drive(
        CAR, lambda t, s: DriverInput(0.02 + 0.1 * (s[COLUMN["speed_mps"]] < 0.5)), 8.0, every=1
    )
    slip = run.field("slip")[2000:]
    assert np.abs(np.diff(slip, axis=0)).max() < 0.01
    assert np.abs(run.field("sideslip")).max() < 1e-9


def test_throttle_0_2_settles_at_about_5_mps():
    run = drive(CAR, lambda t, s: DriverInput(throttle=0.2), 60.0, friction=0.85, every=25)
    assert run.end[COLUMN["speed_mps"]] == pytest.approx(5.0, abs=0.25)
    assert run.column("speed_mps").max() < 5.4
    gears = run.column("gear")
    assert len(np.flatnonzero(np.diff(gears))) <= 6  # and does not hunt


def test_gears_rise_one_by_one_and_keep_the_engine_in_its_band():
    run = drive(CAR, lambda t, s: DriverInput(throttle=1.0), 25.0, friction=0.85, every=1)
    gear, rpm = run.column("gear"), run.column("rpm")
    steps = np.diff(gear)
    assert set(steps.tolist()) == {0.0, 1.0}
    assert gear[-1] >= 4
    late = run.time_s > 4.0
    assert rpm[late].max() < 6700.0
    assert rpm[late].min() > 2500.0
    down = drive(CAR, lambda t, s: DriverInput(brake=0.4), 12.0, speed_mps=30.0, friction=0.85)
    assert set(np.diff(down.column("gear")).tolist()) <= {0.0, -1.0}
    assert down.end[COLUMN["gear"]] == 1.0


def test_reverse_and_neutral():
    run = drive(CAR, lambda t, s: DriverInput(throttle=0.3, selector=-1.0), 6.0, friction=0.85)
    assert run.end[COLUMN["gear"]] == -1.0
    assert run.end[COLUMN["speed_mps"]] < -3.0
    assert run.end[COLUMN["x_m"]] < -8.0
    run = drive(CAR, lambda t, s: DriverInput(throttle=1.0, selector=0.0), 3.0, friction=0.85)
    assert run.end[COLUMN["speed_mps"]] == 0.0


def test_steering_rate_and_ackermann_angles():
    steering = CAR.steering
    run = drive(CAR, lambda t, s: DriverInput(brake=1.0, steering_rad=0.5), 2.0, every=1)
    angle = run.column("steering_rad")
    assert np.diff(angle).max() <= steering.rate_radps * 0.002 * (1 + 1e-9)
    assert np.diff(angle).max() == pytest.approx(steering.rate_radps * 0.002)
    assert angle[-1] == pytest.approx(0.5, abs=1e-3)
    length, width, t = CAR.wheelbase_m, CAR.track_m, math.tan(angle[-1])
    left, right = run.end[columns("steer")]
    assert left == pytest.approx(math.atan(2 * length * t / (2 * length - width * t)))
    assert right == pytest.approx(math.atan(2 * length * t / (2 * length + width * t)))
    # Both wheels' axes meet on the rear axle.
    assert length / math.tan(left) + width / 2 == pytest.approx(
        length / math.tan(right) - width / 2
    )


@pytest.mark.parametrize("driven", ["front", "rear", "all"])
def test_torque_goes_to_the_driven_wheels_and_less_to_the_inside(driven):
    car = replace(CAR, driveline=replace(CAR.driveline, driven=driven, differential_drop=0.9))
    straight = drive(car, lambda t, s: DriverInput(throttle=0.4), 1.0, friction=0.85).end
    slip = straight[columns("slip")]
    pulling = {"front": [1, 1, 0, 0], "rear": [0, 0, 1, 1], "all": [1, 1, 1, 1]}[driven]
    assert (slip > 1e-4).tolist() == [bool(p) for p in pulling]
    turning = drive(
        car, lambda t, s: DriverInput(throttle=0.4, steering_rad=0.5), 1.0, friction=0.85
    )
    load, slip = turning.end[columns("load")], turning.end[columns("slip")]
    first = 2 if driven == "rear" else 0
    assert slip[first] * load[first] < 0.8 * slip[first + 1] * load[first + 1]


def test_engine_turns_as_the_gears_say():
    run = drive(CAR, lambda t, s: DriverInput(throttle=0.5), 12.0, friction=0.85)
    ratio = CAR.gearbox.ratios[int(run.end[COLUMN["gear"]]) - 1] * CAR.gearbox.final_drive
    wheel = run.end[columns("wheel_speed")][:2].mean()
    assert run.end[COLUMN["rpm"]] == pytest.approx(wheel * ratio * 30 / math.pi, rel=0.03)
    assert overall_ratio.__doc__


def test_abs_keeps_wheels_turning_and_without_it_they_lock():
    def lowest(car):
        run = drive(car, lambda t, s: DriverInput(brake=1.0), 1.0, speed_mps=20.0, friction=0.3)
        return run.field("wheel_speed")[-1].min()

    assert lowest(CAR) > 25.0
    assert lowest(replace(CAR, brakes=replace(CAR.brakes, abs=False))) == 0.0


def test_traction_control_limits_wheelspin_on_snow():
    def slip(car):
        run = drive(car, lambda t, s: DriverInput(throttle=1.0), 4.0, friction=0.2)
        return run.field("slip")[400:].max(), run.end[COLUMN["speed_mps"]]

    spinning = replace(CAR, driveline=replace(CAR.driveline, traction_control=False))
    assert slip(CAR)[0] < 0.2 < slip(spinning)[0]
    assert slip(CAR)[1] > slip(spinning)[1]


def test_level_mesh_gives_the_bytes_of_the_plane():
    world = build_world(load_scene("downtown"))
    ground = drivable(world, CPU)
    ends = []
    for where in (None, ground):
        fleet = Fleet([CAR], 1, CPU, ground=where)
        fleet.place(0, 20.0, 6.0, 0.65)
        fleet.active[0] = 1
        for k in range(20):
            steer = 0.02 * math.sin(k)
            fleet.commands[0, 0] = (0.6 * (k < 12), 1.0 * (k >= 14), steer, 0.0, 1.0)
            fleet.first_step[0] = 50 * k
            fleet.advance(50)
        ends.append(fleet.state.tobytes())
        assert fleet.state[0, 0, COLUMN["x_m"]] > 25.0
    assert ends[0] == ends[1]


def test_a_kerb_lifts_the_car_and_jolts_it():
    kerb = 0.10
    points = [[-50, -20, 0], [8, -20, 0], [8, 20, 0], [-50, 20, 0]]
    points += [[8, -20, kerb], [60, -20, kerb], [60, 20, kerb], [8, 20, kerb]]
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [1, 4, 7], [1, 7, 2]]
    ground = GroundMesh(CPU, np.array(points, float), np.array(faces), np.ones(6))
    rows = on_ground(ground, (0.35, 0.0, 0.0, 0.0, 1.0), 3000, speed=4.0)
    assert rows[-1, COLUMN["x_m"]] > 14.0
    assert rows[-1, COLUMN["z_m"]] == pytest.approx(kerb, abs=0.01)
    assert np.abs(rows[:, COLUMN["pitch_rad"]]).max() > 0.02
    assert rows[:, COLUMN["fault"]].max() == 0.0
    assert np.abs(rows[-1, COLUMN["roll_rad"]]) < 1e-3


@pytest.mark.parametrize("grade", [-0.1, 0.1, 0.25])
def test_parking_brake_holds_on_a_slope_and_gravity_moves_without_it(grade):
    pitch = -math.atan(grade)
    held = on_ground(slope_ground(grade), (0, 0, 0, 1.0, 0), 4000, grade=grade)
    settled = held[len(held) // 2 :]
    assert (settled[:, COLUMN["held"]] == 1.0).all()
    assert np.ptp(settled[:, COLUMN["com_x_m"]]) < 1e-4
    load = settled[-1, columns("load")].sum()
    assert load == pytest.approx(CAR.mass_kg * GRAVITY_MPS2 * math.cos(pitch), rel=0.01)
    free = on_ground(slope_ground(grade), (0, 0, 0, 0, 0), 1500, grade=grade)
    wheels = CAR.wheels
    inertia = CAR.mass_kg + 4 * wheels.inertia_kgm2 / wheels.radius_m**2
    pull = abs(math.sin(pitch)) - wheels.rolling_resistance * math.cos(pitch)
    expected = -math.copysign(pull * GRAVITY_MPS2 * CAR.mass_kg / inertia * 3.0, grade)
    assert free[-1, COLUMN["speed_mps"]] == pytest.approx(expected, rel=0.02)


def test_surface_grip_shortens_or_lengthens_a_stop():
    def way(grip):
        rows = on_ground(slope_ground(0.0, grip), (0, 1.0, 0, 0, 1), 3000, speed=15.0)
        assert rows[-1, COLUMN["held"]] == 1.0
        return rows[-1, COLUMN["x_m"]]

    assert way(0.5) > 1.5 * way(1.0)


def many(slots, order, steps=400, chunk=25):
    """Bytes of every drive's end; drive ``k`` runs in slot ``order[k]``."""
    fleet = Fleet([CAR], slots, CPU)
    for k, slot in enumerate(order):
        fleet.place(slot, 3.0 * k, 4.0 + 3.0 * k, 0.2 + 0.1 * k, yaw_rad=0.3 * k)
        fleet.commands[slot, 0, 0] = (0.1 * k, 0.0, 0.03 * k - 0.1, 0.0, 1.0)
        fleet.commands[slot, 0, 1] = (0.0, 0.15 * k, 0.05, 0.0, 1.0)
        fleet.active[slot] = 1
    done = 0
    while done < steps:
        now = min(chunk, steps - done)
        for k, slot in enumerate(order):
            fleet.switch_step[slot] = 137 + k - done
            fleet.first_step[slot] = done
        fleet.advance(now)
        done += now
    return [fleet.state[slot].tobytes() for slot in order]


def test_bytes_do_not_depend_on_slots_neighbours_batch_or_grouping():
    alone = [many(1, [0])[0]]
    six = many(6, [0, 1, 2, 3, 4, 5])
    assert six[0] == alone[0]
    assert many(6, [5, 3, 4, 0, 1, 2]) == six
    assert many(40, [39, 7, 20, 1, 30, 15]) == six
    assert many(6, [0, 1, 2, 3, 4, 5], chunk=400) == six
    assert many(6, [0, 1, 2, 3, 4, 5], chunk=1) == six
    assert len(set(six)) == 6


def test_two_vehicles_in_a_slot_are_the_two_alone_while_they_do_not_meet():
    both = Fleet([CAR, BMW], 1, CPU)
    both.place(0, 0.0, 10.0, 0.85)
    both.place(0, 0.0, 12.0, 0.85, vehicle=1, y_m=20.0)
    both.active[0] = 1
    both.commands[0, :] = (0.4, 0.0, 0.01, 0.0, 1.0)
    both.advance(500)
    for v, vehicle in enumerate((CAR, BMW)):
        one = Fleet([vehicle], 1, CPU)
        one.place(0, 0.0, (10.0, 12.0)[v], 0.85, y_m=20.0 * v)
        one.active[0] = 1
        one.commands[0, 0] = (0.4, 0.0, 0.01, 0.0, 1.0)
        one.advance(500)
        assert one.state[0, 0].tobytes() == both.state[0, v].tobytes()


@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("velocity_x_mps", math.nan, "not a number"),
        ("suspension_fl_m", math.inf, "not a number"),
        ("velocity_x_mps", 2 * SPEED_MAX_MPS, "kinetic energy"),
        ("rate_z_radps", 60.0, "turns faster"),
        ("com_z_m", -500.0, "fell"),
    ],
)
def test_a_state_out_of_its_limits_ends_its_slot_only(column, value, reason):
    ground = slope_ground(0.0)  # a mesh: there is nothing to stand on below it
    fleet = Fleet([CAR], 2, CPU, ground=ground)
    for slot in range(2):
        fleet.place(slot, 0.0, 10.0, 0.85)
        fleet.active[slot] = 1
    fleet.state[0, 0, COLUMN[column]] = value
    fleet.advance(25)
    assert reason in fleet.fault(0)
    assert fleet.fault(1) == ""
    alone = Fleet([CAR], 1, CPU, ground=ground)
    alone.place(0, 0.0, 10.0, 0.85)
    alone.active[0] = 1
    alone.advance(25)
    assert alone.state[0].tobytes() == fleet.state[1].tobytes()


def test_a_fault_on_the_way_keeps_the_last_good_state():
    aero = replace(CAR.aero, idle_m2=0.0, limit_m2=0.0)
    fleet = Fleet([replace(CAR, aero=aero)], 1, CPU)
    fleet.place(0, 0.0, SPEED_MAX_MPS - 0.05, 0.85)
    fleet.active[0] = 1
    fleet.state[0, 0, COLUMN["com_z_m"]] = 50.0  # falls, and gains speed
    fleet.commands[0, 0] = (0.0, 0.0, 0.0, 0.0, 0.0)
    fleet.advance(500)
    assert "kinetic energy" in fleet.fault(0)
    assert np.isfinite(fleet.state).all()


@pytest.mark.parametrize(("friction", "stands"), [(0.85, True), (0.15, False)])
def test_brakes_hold_on_a_slope_as_far_as_the_tyres_grip(friction, stands):
    """Three metres in ten need a friction of 0.3."""
    full = (0.0, 1.0, 0.0, 0.0, 1.0)
    rows = on_ground(slope_ground(0.3), full, 1500, friction=friction, grade=0.3)
    way_m = rows[-1][COLUMN["x_m"]] - rows[0][COLUMN["x_m"]]
    assert bool(abs(way_m) < 0.3) is stands
