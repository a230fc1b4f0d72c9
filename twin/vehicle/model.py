"""Constants of a vehicle for kernels, derived from its file.

A corner's spring K = M_i w_n^2 and damper B = 2 zeta sqrt(K M_i), with the masses of
:mod:`twin.vehicle.masses`. Vehicle axes with the centre of mass as
origin: x forward, y left, z up; wheels front left, front right, rear left, rear right.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from twin.vehicle.columns import PHYSICS_STEP_NS
from twin.vehicle.masses import NO_LOAD, Load, Masses, masses_of
from twin.vehicle.vehicle_file import MPH_60_MPS, Vehicle

GRAVITY_MPS2 = 9.80665
AIR_DENSITY_KGPM3 = 1.225
TABLE_ROWS = 16
GEARS_MAX = 12

_STOP_STIFFNESS = 10.0
"""Bump stops over the spring [-]."""
_STABILITY = 0.8
"""Largest product of step and slip rate that the slip speed's floor admits [-]."""

table = wp.types.vector(length=TABLE_ROWS, dtype=wp.float64)
gears = wp.types.vector(length=GEARS_MAX, dtype=wp.float64)


@wp.struct
class VehicleModel:
    """Constants of one vehicle, SI; per-wheel values in the order of the wheels."""

    step: wp.float64
    # hull and reference point
    half_length: wp.float64
    half_width: wp.float64
    hull_x: wp.float64
    reference_x: wp.float64
    reference_y: wp.float64
    com_height: wp.float64
    # masses
    mass: wp.float64
    sprung_mass: wp.float64
    unsprung: wp.float64
    """Share of the wheels in the mass [-]."""
    inertia: wp.mat33d
    inertia_inverse: wp.mat33d
    yaw_inertia: wp.float64
    # wheels and suspension
    wheel_x: wp.vec4d
    wheel_y: wp.vec4d
    mount_z: wp.vec4d
    stiffness: wp.vec4d
    damping: wp.vec4d
    stop: wp.vec4d
    travel: wp.vec4d
    antiroll: wp.vec4d
    roll_steer: wp.vec4d
    wheel_mass: wp.float64
    wheel_inertia: wp.float64
    radius: wp.float64
    free_radius: wp.vec4d
    tyre_stiffness: wp.float64
    tyre_damping: wp.float64
    rolling: wp.float64
    # tyres: extremum, asymptote (over the extremum's slip and force) and shape of both directions
    slip_x: wp.vec4d
    force_x: wp.vec4d
    tail_slip_x: wp.vec4d
    tail_force_x: wp.vec4d
    shape_x: wp.vec4d
    slip_y: wp.vec4d
    force_y: wp.vec4d
    tail_slip_y: wp.vec4d
    tail_force_y: wp.vec4d
    shape_y: wp.vec4d
    slip_speed_min: wp.float64
    hold_speed: wp.float64
    # drive
    engine_rpm: table
    engine_torque: table
    engine_rows: wp.int32
    idle_rpm: wp.float64
    stall_rpm: wp.float64
    rpm_gain: wp.float64
    converter: wp.float64
    pedal_speed: wp.float64
    ratios: gears
    gear_count: wp.int32
    reverse_ratio: wp.float64
    efficiency: wp.float64
    shift_up: wp.vec2d
    shift_down: wp.vec2d
    shift_time: wp.float64
    drive_share: wp.vec4d
    drop: wp.float64
    traction: wp.float64
    # brakes
    brake_force: wp.float64
    brake_share: wp.vec4d
    abs: wp.float64
    parking: wp.vec4d
    # steering and actuators
    wheelbase: wp.float64
    track: wp.float64
    ackermann: wp.float64
    steering_max: wp.float64
    steering_rate: wp.float64
    steering_rate_speed: wp.float64
    throttle_gain: wp.float64
    """Share of the way to its target an actuator goes in one step, 1 - e^(-dt/T) [-]."""
    brake_gain: wp.float64
    steering_gain: wp.float64
    handbrake_gain: wp.float64
    # air
    drag_run: wp.float64
    drag_idle: wp.float64
    drag_reverse: wp.float64
    drag_limit: wp.float64
    side: wp.float64
    """Slope of the side force in a cross wind [m^2]."""
    yawing: wp.float64
    """Slope of its yaw moment [m^3]."""
    speed_max: wp.float64
    reverse_max: wp.float64
    # contact
    restitution: wp.float64
    friction: wp.float64


@wp.struct
class WheelModel:
    """Constants of one wheel, SI: a lane of a kernel reads its own from memory.

    A field of :class:`VehicleModel` that is indexed by a variable would be copied first.
    """

    x: wp.float64
    y: wp.float64
    mount_z: wp.float64
    other_y: wp.float64
    """From this wheel to the axle's other one, along y [m]."""
    stiffness: wp.float64
    damping: wp.float64
    stop: wp.float64
    travel: wp.float64
    antiroll: wp.float64
    roll_steer: wp.float64
    free_radius: wp.float64
    slip_x: wp.float64
    force_x: wp.float64
    tail_slip_x: wp.float64
    tail_force_x: wp.float64
    shape_x: wp.float64
    slip_y: wp.float64
    force_y: wp.float64
    tail_slip_y: wp.float64
    tail_force_y: wp.float64
    shape_y: wp.float64
    drive_share: wp.float64
    brake_share: wp.float64
    parking: wp.float64


_RENAMED = {"x": "wheel_x", "y": "wheel_y"}


def wheel_models(model: VehicleModel) -> np.ndarray:
    """The four wheels of a vehicle, rows of :class:`WheelModel` [4]."""
    rows = np.zeros(4, WheelModel.numpy_dtype())
    for name in rows.dtype.names:
        if name != "other_y":
            rows[name] = np.array(getattr(model, _RENAMED.get(name, name)))
    y = rows["y"]
    rows["other_y"] = y[[1, 0, 3, 2]] - y
    return rows


def gain(lag_s: float) -> float:
    """Share of the way to its target that a first-order lag goes in one physics step [-]."""
    return 1.0 if lag_s == 0.0 else -math.expm1(-PHYSICS_STEP_NS / 1e9 / lag_s)


def brake_force_n(vehicle: Vehicle) -> float:
    """Brake force at full pedal that stops from 60 mph in the calibrated distance [N].

    D = v T + v^2 / 2a with the pedal's lag T; the tyres give m a less drag (half of the drag at
    60 mph on the way's average) and rolling resistance, and the brakes also stop the wheels.
    """
    wheels, brakes = vehicle.wheels, vehicle.brakes
    way = brakes.distance_60mph_m - MPH_60_MPS * vehicle.lags.brake_s
    accel = MPH_60_MPS**2 / (2.0 * way)
    mass = vehicle.mass_kg
    spin = 4.0 * wheels.inertia_kgm2 / wheels.radius_m**2
    drag = 0.25 * AIR_DENSITY_KGPM3 * vehicle.aero.idle_m2 * MPH_60_MPS**2
    return (mass + spin) * accel - drag - wheels.rolling_resistance * mass * GRAVITY_MPS2


def vehicle_model(vehicle: Vehicle, load: Load = NO_LOAD) -> VehicleModel:
    """Constants of ``vehicle`` for kernels, with a load in it.

    Springs, dampers and brakes are those of the empty car. It stands level all the same, as on
    springs that are set for the load.
    """
    masses = masses_of(vehicle, load)
    model = VehicleModel()
    model.step = PHYSICS_STEP_NS / 1e9
    _masses(model, vehicle, masses)
    _suspension(model, vehicle, masses)
    _tyres(model, vehicle, masses)
    _drive(model, vehicle)
    _controls(model, vehicle)
    contact = vehicle.contact
    model.restitution, model.friction = contact.restitution, contact.friction
    return model


def _masses(model: VehicleModel, vehicle: Vehicle, masses: Masses) -> None:
    wheels, inertia = masses.wheels, masses.inertia
    # In yaw the wheels turn with the body; in roll and pitch they stay on the road.
    inertia[2, 2] += vehicle.wheels.mass_kg * (wheels**2).sum()
    model.half_length, model.half_width = vehicle.length_m / 2, vehicle.width_m / 2
    model.reference_x = float(wheels[2, 0])
    model.reference_y = float(wheels[2, 1] + wheels[3, 1]) / 2
    model.hull_x = model.reference_x + vehicle.centre_offset_m
    model.com_height = masses.com_height_m
    model.sprung_mass = float(masses.corners.sum())
    model.mass = masses.load_kg + vehicle.mass_kg
    model.unsprung = 4 * vehicle.wheels.mass_kg / model.mass
    model.inertia = wp.mat33d(*inertia.ravel())
    model.inertia_inverse = wp.mat33d(*np.linalg.inv(inertia).ravel())
    model.yaw_inertia = float(inertia[2, 2])
    model.wheel_x, model.wheel_y = wp.vec4d(*wheels[:, 0]), wp.vec4d(*wheels[:, 1])


def _suspension(model: VehicleModel, vehicle: Vehicle, masses: Masses) -> None:
    mass = np.array(vehicle.body.corner_mass_kg)
    axles = (vehicle.front, vehicle.front, vehicle.rear, vehicle.rear)
    stiffness = np.array(
        [m * a.natural_frequency_radps**2 for m, a in zip(mass, axles, strict=True)]
    )
    antiroll = np.array([a.antiroll_nm_per_rad / vehicle.track_m**2 for a in axles])
    sag = _sag_m(masses.corners * GRAVITY_MPS2, stiffness, antiroll)
    ratio = np.array([a.damping_ratio for a in axles])
    wheels = vehicle.wheels
    load = (masses.corners + wheels.mass_kg) * GRAVITY_MPS2
    model.stiffness = wp.vec4d(*stiffness)
    model.damping = wp.vec4d(*(2.0 * ratio * np.sqrt(stiffness * mass)))
    model.stop = wp.vec4d(*(_STOP_STIFFNESS * stiffness))
    model.travel = wp.vec4d(*(sag + [a.bump_m for a in axles]))
    model.mount_z = wp.vec4d(*(wheels.radius_m - masses.com_height_m - sag))
    model.antiroll = wp.vec4d(*antiroll)
    model.roll_steer = wp.vec4d(*(a.roll_steer for a in axles))
    model.wheel_mass, model.wheel_inertia = wheels.mass_kg, wheels.inertia_kgm2
    model.radius = wheels.radius_m
    model.free_radius = wp.vec4d(*(wheels.radius_m + load / wheels.stiffness_n_per_m))
    model.tyre_stiffness = wheels.stiffness_n_per_m
    model.tyre_damping, model.rolling = wheels.damping_ns_per_m, wheels.rolling_resistance


def _sag_m(weight_n: np.ndarray, stiffness: np.ndarray, antiroll: np.ndarray) -> np.ndarray:
    """How far springs give way under the weights on them [4] [m].

    The stabiliser of an axle pulls both sides together where one is heavier.
    """
    sag: np.ndarray = weight_n / stiffness
    for side in (slice(0, 2), slice(2, 4)):
        if sag[side][0] != sag[side][1]:
            tie = antiroll[side][0] * np.array([[1.0, -1.0], [-1.0, 1.0]])
            sag[side] = np.linalg.solve(np.diag(stiffness[side]) + tie, weight_n[side])
    return sag


def _tyres(model: VehicleModel, vehicle: Vehicle, masses: Masses) -> None:
    axles = (vehicle.front_tyres, vehicle.front_tyres, vehicle.rear_tyres, vehicle.rear_tyres)
    steepest = 0.0
    for axis, name in (("x", "longitudinal"), ("y", "lateral")):
        curves = [getattr(tyres, name) for tyres in axles]
        extremum = [c.slip_extremum for c in curves]
        setattr(model, f"slip_{axis}", wp.vec4d(*extremum))
        setattr(model, f"force_{axis}", wp.vec4d(*(c.force_extremum for c in curves)))
        tails = [c.slip_asymptote / c.slip_extremum for c in curves]
        setattr(model, f"tail_slip_{axis}", wp.vec4d(*tails))
        tails = [c.force_asymptote / c.force_extremum for c in curves]
        setattr(model, f"tail_force_{axis}", wp.vec4d(*tails))
        setattr(model, f"shape_{axis}", wp.vec4d(*(c.shape for c in curves)))
        steepest = max([steepest, *(c.shape * c.force_extremum / c.slip_extremum for c in curves)])
    # Explicit slip is stable while step x slope x g x (1 + m h^2 / I) / slip speed stays below 1:
    # slips of slower wheels are taken over this speed.
    height = masses.com_height_m
    roll = 1.0 + model.mass * height**2 / float(model.inertia[0, 0])
    model.slip_speed_min = model.step * steepest * GRAVITY_MPS2 * roll / _STABILITY
    model.hold_speed = 0.8 * model.slip_speed_min * min(float(slip) for slip in model.slip_x)


def _drive(model: VehicleModel, vehicle: Vehicle) -> None:
    engine, box = vehicle.engine, vehicle.gearbox
    rows = engine.torque_nm
    padded = [*rows, *([rows[-1]] * (TABLE_ROWS - len(rows)))]
    model.engine_rpm = table(*(row[0] for row in padded))
    model.engine_torque = table(*(row[1] for row in padded))
    model.engine_rows = len(rows)
    model.idle_rpm, model.stall_rpm = engine.idle_rpm, engine.stall_rpm
    model.rpm_gain, model.converter = gain(engine.smoothing_s), engine.converter_ratio
    model.pedal_speed = engine.pedal_speed_mps
    overall = [ratio * box.final_drive for ratio in box.ratios]
    model.ratios = gears(*overall, *([0.0] * (GEARS_MAX - len(overall))))
    model.gear_count, model.reverse_ratio = len(overall), box.reverse_ratio * box.final_drive
    model.efficiency, model.shift_time = box.efficiency, box.shift_s
    model.shift_up, model.shift_down = wp.vec2d(*box.shift_up_rpm), wp.vec2d(*box.shift_down_rpm)
    driven = {"front": (0.5, 0.5, 0, 0), "rear": (0, 0, 0.5, 0.5), "all": (0.25,) * 4}
    model.drive_share = wp.vec4d(*driven[vehicle.driveline.driven])
    model.drop = vehicle.driveline.differential_drop
    model.traction = float(vehicle.driveline.traction_control)


def _controls(model: VehicleModel, vehicle: Vehicle) -> None:
    brakes, steering, lags, aero = vehicle.brakes, vehicle.steering, vehicle.lags, vehicle.aero
    model.brake_force, model.abs = brake_force_n(vehicle), float(brakes.abs)
    front = brakes.front_share / 2
    model.brake_share = wp.vec4d(front, front, 0.5 - front, 0.5 - front)
    model.parking = wp.vec4d(0.0, 0.0, brakes.parking_torque_nm, brakes.parking_torque_nm)
    model.wheelbase, model.track = vehicle.wheelbase_m, vehicle.track_m
    model.ackermann = steering.ackermann
    model.steering_max, model.steering_rate = steering.max_rad, steering.rate_radps
    model.steering_rate_speed = steering.rate_speed_radps
    model.throttle_gain, model.brake_gain = gain(lags.throttle_s), gain(lags.brake_s)
    model.steering_gain, model.handbrake_gain = gain(lags.steering_s), gain(lags.handbrake_s)
    model.drag_run, model.drag_idle = aero.run_m2, aero.idle_m2
    model.drag_reverse, model.drag_limit = aero.reverse_m2, aero.limit_m2
    model.side, model.yawing = aero.side_m2, aero.yaw_m3
    model.speed_max, model.reverse_max = aero.speed_max_mps, aero.reverse_max_mps
