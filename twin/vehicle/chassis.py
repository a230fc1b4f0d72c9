"""One physics step of a vehicle: 14 degrees of freedom plus actuators, engine and gearbox.

A sprung body (six degrees of freedom) on four wheels that move along the body's z axis on spring,
damper and stabiliser, stand on the ground with a vertical tyre spring, and spin. Road forces act
on body and wheels together (total mass) along the road, on the wheel alone across it; the
suspension carries the sprung mass. Semi-implicit Euler; a wheel's spin is solved implicitly with
the tyre's secant stiffness, brake and rolling resistance as dry friction, so no slip rings. At
walking pace slips are taken over a smallest speed, and a vehicle that its tyres can hold is held:
at rest, exactly.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable_math import portable_atan, portable_atan2
from twin.vehicle import lanes as _lanes
from twin.vehicle import model as _model
from twin.vehicle.ground import Ground, surface_below
from twin.vehicle.lanes import add_wheel, four, of, three, wheel_part, wheel_sum
from twin.vehicle.model import VehicleModel, WheelModel
from twin.vehicle.powertrain import drive, steer, wheel_slopes, wheel_torque
from twin.vehicle.state import VehicleState
from twin.vehicle.tyre import stiffnesses

_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_GRAVITY = wp.constant(wp.float64(_model.GRAVITY_MPS2))
_AIR = wp.constant(wp.float64(_model.AIR_DENSITY_KGPM3))
_LOAD_MIN = wp.constant(wp.float64(1.0e-3))
_HOLD_S = wp.constant(wp.float64(0.1))
"""Static friction takes hold of what it can stop within this time [s]."""
_HOLD_RADPS = wp.constant(wp.float64(0.02))
_GRIP_SHARE = wp.constant(wp.float64(0.95))
_ABS_MPS = wp.constant(wp.float64(1.0))
_ABS_RATE = wp.constant(wp.float64(12.0))
"""Change of the ABS's share of pressure per slip error [1/s]."""
_ABS_DROP = wp.constant(wp.float64(-3.0))
_STEP_M = wp.constant(wp.float64(0.005))
"""Ground this much above the plane below the hub is a step, such as a kerb [m]."""
_REACH = wp.constant(wp.float64(0.7))
"""Where a wheel feels for steps, forward and back, over its radius [-]."""

_UP = wp.constant(_lanes.UP)
_FORCE = wp.constant(_lanes.FORCE)
_LIFT = wp.constant(_lanes.LIFT)
_TORQUE = wp.constant(_lanes.TORQUE)


@wp.struct
class VehicleCommand:
    """What is asked of a vehicle; see :data:`twin.vehicle.powertrain.COMMANDS`."""

    throttle: wp.float64
    brake: wp.float64
    steering: wp.float64
    handbrake: wp.float64
    selector: wp.float64


@wp.struct
class Footing:
    """Where a wheel stands: load along the normal, both in vehicle axes, and push of a step."""

    load: wp.float64
    normal: wp.vec3d
    push: wp.vec3d
    up: wp.vec3d
    """The normal in world axes."""
    distance: wp.float64
    """Hub to ground along the normal [m]."""
    grip: wp.float64


@wp.func
def _axis(s: VehicleState, v: wp.vec3d) -> wp.vec3d:
    return wp.quat_rotate_inv(s.orientation, v)


@wp.func
def _spring(
    m: VehicleModel, distance: wp.float64, radius: wp.float64, speed: wp.float64
) -> wp.float64:
    """Force of the tyre's vertical spring; ``speed``: of the hub, away from the ground [N]."""
    if distance >= radius:
        return _ZERO
    force = m.tyre_stiffness * (radius - distance) - m.tyre_damping * speed
    return wp.max(force, _ZERO)


@wp.func
def footing(
    m: VehicleModel,
    ground: Ground,
    s: VehicleState,
    radius: wp.float64,
    hub: wp.vec3d,
    hub_velocity: wp.vec3d,
    forward: wp.vec3d,
) -> Footing:
    """Where a wheel stands; hub, its velocity and the wheel's direction in vehicle axes.

    ``radius``: of the wheel without load [m].
    """
    f = Footing()
    p = s.com + wp.quat_rotate(s.orientation, hub)
    below = surface_below(ground, p)
    f.grip = below.grip
    f.up = below.normal
    f.normal = _axis(s, f.up)
    f.distance = (p[2] - below.height) * below.normal[2]
    f.load = _spring(m, f.distance, radius, wp.dot(hub_velocity, f.normal))
    f.distance = wp.min(f.distance, radius)
    if ground.flat != 0:
        return f
    ahead = wp.quat_rotate(s.orientation, forward) * (_REACH * radius)
    for side in range(2):
        way = wp.where(side == 0, ahead, -ahead)
        q = p + way
        there = surface_below(ground, q)
        n = below.normal
        level = below.height - (n[0] * way[0] + n[1] * way[1]) / n[2]
        if there.height > level + _STEP_M:
            edge = wp.vec3d(q[0], q[1], wp.min(there.height, p[2] + _HALF * radius))
            out = p - edge
            distance = wp.length(out)
            if distance > _LOAD_MIN:
                normal = _axis(s, out / distance)
                f.push += normal * _spring(m, distance, radius, wp.dot(hub_velocity, normal))
    return f


@wp.func
def holds(
    m: VehicleModel,
    s: VehicleState,
    brake: wp.float64,
    torque: wp.float64,
    mu: wp.float64,
    wind: wp.vec3d,
):
    """Whether static friction keeps a vehicle at rest that (almost) stands.

    Almost: slower than a locked wheel slides before its tyre's extremum.

    Along the vehicle every wheel holds with its brakes and rolling resistance, as far as it grips;
    sideways it holds with its grip. ``wind``: what the wind adds to the force on the body [N].
    """
    v = _axis(s, s.velocity)
    vx = wp.abs(v[0])
    vy = wp.abs(v[1])
    if vx > m.hold_speed or vy > m.hold_speed or wp.abs(s.rate[2]) > _HOLD_RADPS:
        return False
    g = _axis(s, wp.vec3d(_ZERO, _ZERO, -_GRAVITY)) * m.mass + wind
    along = wp.float64(0.0)
    across = wp.float64(0.0)
    for i in range(4):
        grip = mu * s.load[i] * _GRIP_SHARE
        across += grip
        own = brake * m.brake_force * m.brake_share[i] + m.rolling * s.load[i]
        own += s.handbrake * m.parking[i] / m.radius
        along += wp.min(own, grip)
    along -= wp.abs(g[0] + torque / m.radius) + vx * m.mass / _HOLD_S
    across -= wp.abs(g[1]) + vy * m.mass / _HOLD_S
    return along >= _ZERO and across >= _ZERO


@wp.func
def drag_area(m: VehicleModel, s: VehicleState, throttle: wp.float64, v: wp.vec3d) -> wp.float64:
    """Drag area of the body in its state of the four: limit, idle, reverse or run [m^2]."""
    area = m.drag_run
    if throttle <= _ZERO:
        area = m.drag_idle
    if s.gear < _ZERO and v[0] <= -m.reverse_max and s.wheel_speed[0] + s.wheel_speed[2] < _ZERO:
        area = m.drag_reverse
    if v[0] >= m.speed_max:
        area = m.drag_limit
    return area


@wp.func
def drag(area: wp.float64, v: wp.vec3d) -> wp.vec3d:
    """Air drag on the body at velocity ``v`` through the air [N]."""
    return v * (-_HALF * _AIR * area * wp.length(v))


@wp.func
def gust(m: VehicleModel, area: wp.float64, v: wp.vec3d, wind: wp.vec3d) -> wp.vec3d:
    """What a wind (vehicle axes) adds: force along and across [N], and yaw moment [N m].

    Drag follows the speed through the air. Side force and moment follow the wind's part across the
    body alone: the car's own sideslip has only the drag, as in calm air.
    """
    if wind[0] == _ZERO and wind[1] == _ZERO:
        return wp.vec3d(_ZERO, _ZERO, _ZERO)
    through = v - wind
    more = drag(area, through) - drag(area, v)
    across = _HALF * _AIR * wp.length(through) * wind[1]
    return wp.vec3d(more[0], more[1] + across * m.side, across * m.yawing)


@wp.func
def pressure_of(
    m: VehicleModel, pressure: wp.float64, brake: wp.float64, sx: wp.float64, speed: wp.float64
):
    """The ABS's share of a wheel's brake pressure; ``sx``: slip over the extremum's."""
    if m.abs == _ZERO or brake <= _ZERO or speed < _ABS_MPS:
        return _ONE
    error = wp.max(_ONE + sx, _ABS_DROP)
    return wp.clamp(pressure + m.step * _ABS_RATE * error, _ZERO, _ONE)


@wp.func
def suspension_force(
    u: WheelModel, z: wp.float64, rate: wp.float64, other_z: wp.float64
) -> wp.float64:
    """Force of spring, damper, stops and stabiliser that lifts the body at a wheel [N].

    ``z`` and ``rate``: travel of the wheel [m, m/s]; ``other_z``: of the axle's other one.
    """
    force = u.stiffness * z + u.damping * rate
    force += u.stop * (wp.max(z - u.travel, _ZERO) + wp.min(z, _ZERO))
    return force + u.antiroll * (z - other_z)


@wp.func
def wheel_step(
    m: VehicleModel,
    u: WheelModel,
    ground: Ground,
    before: VehicleState,
    s: VehicleState,
    i: wp.int32,
    slopes: wp.vec2d,
    drive_torque: wp.float64,
    friction: wp.float64,
    held: wp.bool,
) -> wheel_part:
    """What wheel ``i`` gives in a physics step, see :data:`twin.vehicle.lanes.PART`.

    ``s``: the next state, of which the actuators are known. ``slopes``: tangents of the angles of
    the front wheels. ``held``: the vehicle is at rest.
    """
    v = _axis(before, before.velocity)
    w = before.rate
    g = _axis(before, wp.vec3d(_ZERO, _ZERO, -_GRAVITY))
    total_load = wp.max(
        before.load[0] + before.load[1] + before.load[2] + before.load[3], _LOAD_MIN
    )
    z = of(before.suspension, i)
    z_rate = of(before.suspension_rate, i)
    other_z = of(before.suspension, i + 1 - 2 * (i % 2))
    load = of(before.load, i)
    speed = of(before.wheel_speed, i)
    hub = wp.vec3d(u.x, u.y, u.mount_z + z)
    hub_v = v + wp.cross(w, hub) + wp.vec3d(_ZERO, _ZERO, z_rate)
    heading = wp.vec3d(_ONE, _ZERO, _ZERO)
    if i < 2:
        slope = wp.where(i == 0, slopes[0], slopes[1])
        heading = wp.normalize(wp.vec3d(_ONE, slope, _ZERO))
    f = footing(m, ground, before, u.free_radius, hub, hub_v, heading)
    n = f.normal
    forward = wp.normalize(heading - n * wp.dot(heading, n))
    left = wp.cross(n, forward)
    mu = friction * f.grip
    contact = hub - n * f.distance
    slide = v + wp.cross(w, contact)
    vx = wp.dot(slide, forward)
    over = wp.max(wp.abs(vx), m.slip_speed_min)
    roll = (z - other_z) / u.other_y
    slip = (m.radius * speed - vx) / over
    sideslip = -wp.dot(slide, left) / over + u.roll_steer * roll
    k = stiffnesses(u, slip, sideslip, f.load, mu)
    fy = k[1] * sideslip
    share = u.brake_share
    if m.abs != _ZERO:
        share = load / total_load
    pressure = pressure_of(m, of(before.pressure, i), s.brake, k[2], wp.abs(vx))
    stopping = s.brake * m.brake_force * share * pressure * m.radius
    stopping += s.handbrake * u.parking + m.rolling * f.load * m.radius
    # Implicit in the spin: F = k (R w' - v) / over, I (w' - w) / dt = T - R F -+ stopping.
    inertia = m.wheel_inertia + m.step * m.radius * m.radius * k[0] / over
    turning = wheel_torque(m, u.drive_share, i, drive_torque, s.steering) - m.radius * k[0] * slip
    spin = speed + m.step * turning / inertia
    most = m.step * stopping / inertia
    spin = spin - wp.clamp(spin, -most, most)
    fx = k[0] * (m.radius * spin - vx) / over
    grip_y = wp.max(mu * f.load * u.force_y, _LOAD_MIN)
    rest = wp.sqrt(wp.max(_ONE - (fy / grip_y) * (fy / grip_y), _ZERO))
    grip_x = mu * f.load * u.force_x * rest
    fx = wp.clamp(fx, -grip_x, grip_x)
    tangential = forward * fx + left * fy
    if held:
        spin = _ZERO
        weight = m.mass * load / total_load
        tangential = wp.vec3d(-g[0] * weight, -g[1] * weight, _ZERO)
    road = tangential + n * f.load + f.push
    susp = suspension_force(u, z, z_rate, other_z)
    # The wheel hands its forces to the body at the hub, with the moment of those along the
    # road; its own share of the inertia needs none of the body's.
    arm = wp.vec3d(hub[0], hub[1], hub[2] * (_ONE - m.unsprung))
    moment = wp.cross(arm, wp.vec3d(road[0], road[1], _ZERO))
    moment = moment + wp.cross(hub, wp.vec3d(_ZERO, _ZERO, susp))
    back = wp.cross(n, tangential) * f.distance
    return wheel_part(
        f.up[0],
        f.up[1],
        f.up[2],
        road[0],
        road[1],
        susp,
        moment[0],
        moment[1],
        moment[2],
        back[0],
        back[1],
        back[2],
        road[2] - susp,
        pressure,
        spin,
        of(before.wheel_angle, i) + spin * m.step,
        f.load + wp.length(f.push),
        slip,
        sideslip,
    )


@wp.func
def advance(
    models: wp.array(dtype=VehicleModel),
    wheels: wp.array2d(dtype=WheelModel),
    model: wp.int32,
    ground: Ground,
    before: VehicleState,
    c: VehicleCommand,
    friction: wp.float64,
    wind: wp.vec2d,
    first: wp.int32,
    last: wp.int32,
) -> VehicleState:
    """One physics step without contacts of the hull; ``wind``: of the world, x and y [m/s].

    ``first`` and ``last``: wheels of this lane, 0 and 4 on a CPU. What only follows from the state
    is left to :func:`observe` and :func:`observe_wheels`.
    """
    m = models[model]
    s = before
    s.throttle = before.throttle + (c.throttle - before.throttle) * m.throttle_gain
    s.brake = before.brake + (c.brake - before.brake) * m.brake_gain
    s.handbrake = before.handbrake + (c.handbrake - before.handbrake) * m.handbrake_gain
    s.steering = steer(m, before.steering, c.steering, before.speed)
    slopes = wheel_slopes(m, s.steering)
    d = drive(models, model, before, s.throttle, c.selector, friction)
    s.gear = d.gear
    s.shift_left = d.shift_left
    s.rpm = d.rpm
    s.traction = d.traction
    v = _axis(before, before.velocity)
    area = drag_area(m, s, s.throttle, v)
    blown = gust(m, area, v, _axis(before, wp.vec3d(wind[0], wind[1], _ZERO)))
    pushed = wp.vec3d(blown[0], blown[1], _ZERO)
    held = holds(m, s, s.brake, d.torque, friction, pushed)
    w = before.rate
    total = wheel_sum()
    begin = drag(area, v)
    if not held:  # a vehicle at rest: its tyres take it
        begin += pushed
        total[_TORQUE + 2] = blown[2]
    total[_FORCE] = begin[0]
    total[_FORCE + 1] = begin[1]
    total[_FORCE + 2] = begin[2]
    for i in range(first, last):
        part = wheel_step(
            m, wheels[model, i], ground, before, s, i, slopes, d.torque, friction, held
        )
        total = add_wheel(total, part, i)
    s.pressure = four(total, 1)
    s.wheel_speed = four(total, 2)
    s.wheel_angle = four(total, 3)
    s.load = four(total, 4)
    s.slip = four(total, 5)
    s.sideslip = four(total, 6)
    force = three(total, _FORCE)
    s.specific_force = wp.vec3d(
        force[0] / m.mass, force[1] / m.mass, force[2] / m.mass + total[_LIFT] / m.sprung_mass
    )
    s.rate_change = m.inertia_inverse * (three(total, _TORQUE) - wp.cross(w, m.inertia * w))
    return move(m, before, s, four(total, 0), held, wp.normalize(three(total, _UP)))


@wp.func
def move(
    m: VehicleModel,
    before: VehicleState,
    after: VehicleState,
    wheel_z: wp.vec4d,
    held: wp.bool,
    up: wp.vec3d,
) -> VehicleState:
    """Integrate the body and the wheels' travel; ``up``: the ground's normal, world axes."""
    s = after
    w = before.rate
    for i in range(4):
        hub = wp.vec3d(m.wheel_x[i], m.wheel_y[i], m.mount_z[i] + before.suspension[i])
        frame = wp.cross(s.rate_change, hub) + wp.cross(w, wp.cross(w, hub))
        accel = wheel_z[i] / m.wheel_mass - s.specific_force[2] - frame[2]
        s.suspension_rate[i] = before.suspension_rate[i] + accel * m.step
        s.suspension[i] = before.suspension[i] + s.suspension_rate[i] * m.step
    g = wp.vec3d(_ZERO, _ZERO, -_GRAVITY)
    s.rate = w + s.rate_change * m.step
    s.velocity = before.velocity + (wp.quat_rotate(s.orientation, s.specific_force) + g) * m.step
    if held:
        s.rate[2] = _ZERO
    q = before.orientation
    spin = wp.quatd(s.rate[0], s.rate[1], s.rate[2], _ZERO)
    s.orientation = wp.normalize(q + (q * spin) * (_HALF * m.step))
    s.accel = s.specific_force[0] + _axis(before, g)[0]
    s.held = _ZERO
    if held:
        s.velocity = up * wp.dot(s.velocity, up)
        s.accel = _ZERO
        s.held = _ONE
    s.com = before.com + s.velocity * m.step
    return s


@wp.func
def observe_motion(state: VehicleState) -> VehicleState:
    """Fill in what the next physics step needs of the body's motion: speeds and yaw rate."""
    s = state
    s.body_velocity = _axis(s, s.velocity)
    if s.held != _ZERO:
        s.body_velocity = wp.vec3d(_ZERO, _ZERO, s.body_velocity[2])
    s.speed = s.body_velocity[0]
    s.yaw_rate = s.rate[2]
    return s


@wp.func
def yaw_of(s: VehicleState) -> wp.float64:
    """Where a vehicle points to, seen from above [rad]."""
    x = wp.quat_rotate(s.orientation, wp.vec3d(_ONE, _ZERO, _ZERO))
    return portable_atan2(x[1], x[0])


@wp.func
def observe(m: VehicleModel, state: VehicleState) -> VehicleState:
    """Fill in all that follows from the body's motion: pose of the reference point, speeds, angles.

    A state that was observed stays as it is.
    """
    s = observe_motion(state)
    x = wp.quat_rotate(s.orientation, wp.vec3d(_ONE, _ZERO, _ZERO))
    y = wp.quat_rotate(s.orientation, wp.vec3d(_ZERO, _ONE, _ZERO))
    z = wp.quat_rotate(s.orientation, wp.vec3d(_ZERO, _ZERO, _ONE))
    s.yaw = yaw_of(s)
    s.roll = portable_atan2(y[2], z[2])
    # Cosine and sine of the yaw; upright there is no yaw.
    flat = wp.sqrt(x[0] * x[0] + x[1] * x[1])
    s.pitch = portable_atan2(-x[2], flat)
    cosine = _ONE
    sine = _ZERO
    if flat > _ZERO:
        cosine = x[0] / flat
        sine = x[1] / flat
    # The reference keeps its distance in the plane: pitching does not move it along the road.
    s.x = s.com[0] + cosine * m.reference_x - sine * m.reference_y
    s.y = s.com[1] + sine * m.reference_x + cosine * m.reference_y
    s.z = s.com[2] + m.reference_x * x[2] + m.reference_y * y[2] - m.com_height * z[2]
    return s


@wp.func
def observe_wheels(m: VehicleModel, state: VehicleState) -> VehicleState:
    """Fill in the angles of the front wheels, which follow from the steering."""
    s = state
    slopes = wheel_slopes(m, s.steering)
    s.steer = wp.vec2d(portable_atan(slopes[0]), portable_atan(slopes[1]))
    return s
