"""The planar vehicle: longitudinal forces, kinematic single track, exact standstill.

Forward speed v: m dv/dt = F_tyre - F_drag - F_roll, with F_tyre = F_drive - F_brake limited to
+-mu m g, F_drag = rho/2 c_d A v^2 and F_roll = c_r m g while rolling. Yaw rate: v tan(delta) / L
(Rajamani, Vehicle Dynamics and Control, 2.2), limited so that the tyres' total force stays inside
the friction circle. The reference point is the middle of the rear axle. Forces are explicit, a
step's distance is exact for its constant acceleration, and a stop inside a step ends at v = 0.
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.hull import hull_at, overlap, separation

wp.set_module_options({"enable_backward": False})

GRAVITY_MPS2 = wp.constant(wp.float64(9.80665))
AIR_DENSITY_KGPM3 = wp.constant(wp.float64(1.225))

TELEMETRY = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "steering_rad",
    "throttle",
    "brake",
    "dtc_m",
    "closing_mps",
    "collisions",
    "impact_speed_mps",
    "impact_step",
    "rest_step",
    "moved",
    "finite",
)
"""Columns of the state, float64 [S, T]; steps count physics steps since reset, -1: never."""

(
    _X,
    _Y,
    _YAW,
    _SPEED,
    _ACCEL,
    _YAW_RATE,
    _STEERING,
    _THROTTLE,
    _BRAKE,
    _DTC,
    _CLOSING,
    _COLLISIONS,
    _IMPACT_SPEED,
    _IMPACT_STEP,
    _REST_STEP,
    _MOVED,
    _FINITE,
) = (wp.constant(i) for i in range(len(TELEMETRY)))

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class VehicleModel:
    """Constants of a vehicle, SI; see :class:`twin.vehicle.vehicle_file.Vehicle`."""

    wheelbase: wp.float64
    half_length: wp.float64
    half_width: wp.float64
    centre_offset: wp.float64
    mass: wp.float64
    drag_area: wp.float64
    rolling: wp.float64
    drive_force: wp.float64
    drive_power: wp.float64
    pedal_slope: wp.float64
    brake_force: wp.float64
    steering_max: wp.float64
    throttle_gain: wp.float64
    """Share of the way to its target an actuator goes in one step, 1 - e^(-dt/T) [-]."""
    brake_gain: wp.float64
    steering_gain: wp.float64
    step: wp.float64
    """Physics step [s]."""


@wp.struct
class Motion:
    """What a step of the longitudinal motion gives."""

    speed: wp.float64
    accel: wp.float64
    distance: wp.float64


@wp.func
def roll(
    model: VehicleModel,
    speed: wp.float64,
    throttle: wp.float64,
    brake: wp.float64,
    friction: wp.float64,
) -> Motion:
    """One step of the forward speed (>= 0) under actuator positions 0..1."""
    drive = throttle * model.drive_force - model.pedal_slope * speed
    drive = wp.clamp(drive, _ZERO, model.drive_power / wp.max(speed, wp.float64(0.1)))
    if throttle <= _ZERO:
        drive = _ZERO
    weight = model.mass * GRAVITY_MPS2
    grip = friction * weight
    drag = wp.float64(0.5) * AIR_DENSITY_KGPM3 * model.drag_area * speed * speed
    resist = model.rolling * weight
    motion = Motion()
    if speed <= _ZERO:
        # At rest brakes and rolling resistance only hold; they never push backwards.
        pull = wp.min(drive, grip) - wp.min(brake * model.brake_force, grip) - resist
        if pull <= _ZERO:
            return motion
    tyre = wp.clamp(drive - brake * model.brake_force, -grip, grip)
    accel = (tyre - drag - resist) / model.mass
    after = speed + accel * model.step
    motion.accel = accel
    if after <= _ZERO and accel < _ZERO:
        motion.distance = wp.float64(0.5) * speed * speed / -accel
    else:
        motion.speed = after
        motion.distance = wp.float64(0.5) * (speed + after) * model.step
    return motion


@wp.func
def turn(
    model: VehicleModel,
    speed: wp.float64,
    accel: wp.float64,
    steering: wp.float64,
    friction: wp.float64,
) -> wp.float64:
    """Yaw rate [rad/s]; the lateral force is what the friction circle leaves."""
    rate = speed * wp.tan(steering) / model.wheelbase
    grip = friction * GRAVITY_MPS2
    lateral = wp.sqrt(wp.max(grip * grip - accel * accel, _ZERO))
    limit = lateral / wp.max(speed, wp.float64(0.1))
    return wp.clamp(rate, -limit, limit)


@wp.func
def hits_anything(
    model: VehicleModel,
    colliders: wp.array2d(dtype=wp.float64),
    x: wp.float64,
    y: wp.float64,
    yaw: wp.float64,
) -> wp.bool:
    """Whether the ego's hull, rear axle at (x, y), touches a collider."""
    ego = hull_at(
        x + model.centre_offset * wp.cos(yaw),
        y + model.centre_offset * wp.sin(yaw),
        yaw,
        model.half_length,
        model.half_width,
    )
    reach = model.half_length + model.half_width
    for k in range(colliders.shape[0]):
        span = reach + colliders[k, 3] + colliders[k, 4]
        if wp.abs(colliders[k, 0] - ego.x) < span and wp.abs(colliders[k, 1] - ego.y) < span:
            other = hull_at(
                colliders[k, 0], colliders[k, 1], colliders[k, 2], colliders[k, 3], colliders[k, 4]
            )
            if overlap(ego, other):
                return True
    return False


@wp.func
def measure(
    model: VehicleModel,
    colliders: wp.array2d(dtype=wp.float64),
    slot: wp.int32,
    state: wp.array2d(dtype=wp.float64),
):
    """Write distance to the obstacle (collider 0) and closing speed of a slot."""
    yaw = state[slot, _YAW]
    c = wp.cos(yaw)
    s = wp.sin(yaw)
    ego = hull_at(
        state[slot, _X] + model.centre_offset * c,
        state[slot, _Y] + model.centre_offset * s,
        yaw,
        model.half_length,
        model.half_width,
    )
    obstacle = hull_at(
        colliders[0, 0], colliders[0, 1], colliders[0, 2], colliders[0, 3], colliders[0, 4]
    )
    way = separation(ego, obstacle)
    state[slot, _DTC] = way[2]
    state[slot, _CLOSING] = _ZERO
    if way[2] > _ZERO:
        state[slot, _CLOSING] = state[slot, _SPEED] * (way[0] * c + way[1] * s) / way[2]


@wp.kernel
def measure_kernel(
    # model
    model: VehicleModel,
    colliders: wp.array2d(dtype=wp.float64),
    # state in and out
    state: wp.array2d(dtype=wp.float64),
):
    """Distance and closing speed of all slots, for states that were just set."""
    measure(model, colliders, wp.tid(), state)


@wp.kernel
def drive_kernel(
    # model
    model: VehicleModel,
    colliders: wp.array2d(dtype=wp.float64),
    # args
    steps: wp.int32,
    friction: wp.array(dtype=wp.float64),
    commands: wp.array3d(dtype=wp.float64),
    switch_step: wp.array(dtype=wp.int32),
    first_step: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.int32),
    # state in and out
    state: wp.array2d(dtype=wp.float64),
):
    """Advance all active slots by ``steps`` physics steps.

    ``commands`` [S, 2, 3]: throttle, brake, steering in force before and from ``switch_step``.
    ``first_step`` [S]: physics steps since reset at the start.
    """
    slot = wp.tid()
    if active[slot] == 0:
        return
    mu = friction[slot]
    for k in range(steps):
        if state[slot, _COLLISIONS] == _ZERO:
            row = wp.where(k >= switch_step[slot], 1, 0)
            throttle = state[slot, _THROTTLE]
            throttle += (commands[slot, row, 0] - throttle) * model.throttle_gain
            brake = state[slot, _BRAKE]
            brake += (commands[slot, row, 1] - brake) * model.brake_gain
            target = wp.clamp(commands[slot, row, 2], -model.steering_max, model.steering_max)
            steering = state[slot, _STEERING]
            steering += (target - steering) * model.steering_gain
            before = state[slot, _SPEED]
            motion = roll(model, before, throttle, brake, mu)
            rate = turn(model, motion.speed, motion.accel, steering, mu)
            middle = state[slot, _YAW] + wp.float64(0.5) * rate * model.step
            state[slot, _X] = state[slot, _X] + motion.distance * wp.cos(middle)
            state[slot, _Y] = state[slot, _Y] + motion.distance * wp.sin(middle)
            state[slot, _YAW] = state[slot, _YAW] + rate * model.step
            state[slot, _SPEED] = motion.speed
            state[slot, _ACCEL] = motion.accel
            state[slot, _YAW_RATE] = rate
            state[slot, _THROTTLE] = throttle
            state[slot, _BRAKE] = brake
            state[slot, _STEERING] = steering
            now = wp.float64(first_step[slot] + k + 1)
            if motion.speed > _ZERO:
                state[slot, _MOVED] = _ONE
                state[slot, _REST_STEP] = -_ONE
            elif state[slot, _MOVED] > _ZERO and state[slot, _REST_STEP] < _ZERO:
                state[slot, _REST_STEP] = now
                state[slot, _ACCEL] = _ZERO
            x = state[slot, _X]
            y = state[slot, _Y]
            yaw = state[slot, _YAW]
            if not (wp.isfinite(x) and wp.isfinite(y) and wp.isfinite(yaw)):
                state[slot, _FINITE] = _ZERO
            elif hits_anything(model, colliders, x, y, yaw):
                state[slot, _COLLISIONS] = _ONE
                state[slot, _IMPACT_SPEED] = motion.speed
                state[slot, _IMPACT_STEP] = now
                state[slot, _SPEED] = _ZERO
                state[slot, _ACCEL] = _ZERO
                state[slot, _YAW_RATE] = _ZERO
    if not wp.isfinite(state[slot, _SPEED]):
        state[slot, _FINITE] = _ZERO
    measure(model, colliders, slot, state)
