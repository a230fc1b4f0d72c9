"""The vehicles' kernels: a slot is one thread, on a GPU four; the loop over physics steps inside.

A slot's vehicles advance one after the other, then meet: nothing depends on other slots
or on how many there are. A vehicle whose state leaves its limits keeps the last good state and a
fault; its slot ends, the batch goes on.
"""

from __future__ import annotations

import warp as wp

from twin.vehicle.chassis import (
    VehicleCommand,
    advance,
    observe,
    observe_motion,
    observe_wheels,
    yaw_of,
)
from twin.vehicle.contact import RigidBox, extent_of, hull_of, in_reach, meet, near
from twin.vehicle.ground import Ground
from twin.vehicle.guard import fault_of
from twin.vehicle.hull import hull_at, separation
from twin.vehicle.lanes import together
from twin.vehicle.model import PHYSICS_STEP_NS, VehicleModel, WheelModel
from twin.vehicle.state import VehicleState
from twin.vehicle.wall_grid import WallGrid, walls_near

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

EVENTS_MAX = 16
"""Collisions kept per slot; further ones are counted only."""

EVENT = ("step", "vehicle", "partner_kind", "partner", "speed_mps", "x_m", "y_m", "last_step")
"""Columns of a collision event, float64 [S, EVENTS_MAX, 8]: the physics step since reset at which
two hulls met, who, with which relative speed, where, and the last step at which they touched."""

WALL, CAR, MOVER = 0, 1, 3
"""Kinds of partners: a static collider, a vehicle, an object that follows a script."""

MOVER_COLUMNS = (
    *("x_m", "y_m", "yaw_rad", "half_length_m", "half_width_m"),
    *("velocity_x_mps", "velocity_y_mps", "yaw_rate_radps"),
)
"""Columns of a scripted object's hull, float64 [S, M, 8]; half length 0: it is not there."""

_WALL, _CAR, _MOVER = (wp.constant(wp.int32(k)) for k in (WALL, CAR, MOVER))
_STEP_S = wp.constant(wp.float64(PHYSICS_STEP_NS / 1e9))
_EVENTS_MAX = wp.constant(wp.int32(EVENTS_MAX))
_APART_STEPS = wp.constant(wp.float64(50.0))
"""Hulls that touch again within 0.1 s have not been apart: no new collision."""
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class VehicleScene:
    """What a slot's vehicles share; counts may be 0."""

    colliders: wp.array2d(dtype=wp.float64)
    """[K, 5]: centre x, y [m], yaw [rad], half length and width [m]."""
    grid: WallGrid
    """Which of them a vehicle can touch."""
    ground: Ground
    stop_at_impact: wp.int32
    """1: a vehicle's first collision freezes it where it is, for cases that end there."""


@wp.func
def _vehicle_box(m: VehicleModel, s: VehicleState) -> RigidBox:
    b = RigidBox()
    b.x = s.com[0]
    b.y = s.com[1]
    b.yaw = s.yaw
    b.vx = s.velocity[0]
    b.vy = s.velocity[1]
    b.rate = s.rate[2]
    b.inverse_mass = _ONE / m.mass
    b.inverse_inertia = _ONE / m.yaw_inertia
    b.offset = m.hull_x
    b.half_length = m.half_length
    b.half_width = m.half_width
    b.restitution = m.restitution
    b.friction = m.friction
    return b


@wp.func
def _wall_box(colliders: wp.array2d(dtype=wp.float64), k: int) -> RigidBox:
    b = RigidBox()
    b.x = colliders[k, 0]
    b.y = colliders[k, 1]
    b.yaw = colliders[k, 2]
    b.half_length = colliders[k, 3]
    b.half_width = colliders[k, 4]
    b.restitution = _ONE
    b.friction = _ONE
    return b


@wp.func
def _mover_box(
    movers: wp.array3d(dtype=wp.float64), slot: int, k: int, since: wp.float64
) -> RigidBox:
    """A scripted object ``since`` seconds after its hull was written; nothing stops it."""
    b = RigidBox()
    b.vx = movers[slot, k, 5]
    b.vy = movers[slot, k, 6]
    b.rate = movers[slot, k, 7]
    b.x = movers[slot, k, 0] + b.vx * since
    b.y = movers[slot, k, 1] + b.vy * since
    b.yaw = movers[slot, k, 2] + b.rate * since
    b.half_length = movers[slot, k, 3]
    b.half_width = movers[slot, k, 4]
    b.restitution = _ONE
    b.friction = _ONE
    return b


@wp.func
def _note(
    events: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
    slot: int,
    now: wp.float64,
    vehicle: int,
    kind: wp.int32,
    partner: int,
    speed: wp.float64,
    x: wp.float64,
    y: wp.float64,
) -> wp.bool:
    """Keep a contact as a collision unless the pair has just touched; whether it is new."""
    stored = wp.min(counts[slot], _EVENTS_MAX)
    for i in range(stored):
        e = stored - 1 - i
        if (
            events[slot, e, 1] == wp.float64(vehicle)
            and events[slot, e, 2] == wp.float64(kind)
            and events[slot, e, 3] == wp.float64(partner)
        ):
            if now - events[slot, e, 7] > _APART_STEPS:
                break
            events[slot, e, 7] = now
            return False
    if counts[slot] < _EVENTS_MAX:
        e = counts[slot]
        events[slot, e, 0] = now
        events[slot, e, 1] = wp.float64(vehicle)
        events[slot, e, 2] = wp.float64(kind)
        events[slot, e, 3] = wp.float64(partner)
        events[slot, e, 4] = speed
        events[slot, e, 5] = x
        events[slot, e, 6] = y
        events[slot, e, 7] = now
    counts[slot] = counts[slot] + 1
    return True


@wp.func
def _touch(
    scene: VehicleScene,
    states: wp.array2d(dtype=VehicleState),
    slot: int,
    v: int,
    box: RigidBox,
    new: wp.bool,
    now: wp.float64,
):
    """Give a vehicle the velocity and place that a contact left it."""
    s = states[slot, v]
    if new:
        s.collisions = s.collisions + _ONE
        if s.impact_step < _ZERO:
            s.impact_speed = s.speed
            s.impact_step = now
    if scene.stop_at_impact != 0:
        s.velocity = wp.vec3d(_ZERO, _ZERO, _ZERO)
        s.rate = wp.vec3d(_ZERO, _ZERO, _ZERO)
        s.accel = _ZERO
    else:
        s.com = wp.vec3d(box.x, box.y, s.com[2])
        s.velocity = wp.vec3d(box.vx, box.vy, s.velocity[2])
        s.rate = wp.vec3d(s.rate[0], s.rate[1], box.rate)
        s.held = _ZERO
    states[slot, v] = observe_motion(s)


@wp.func
def vehicle_contacts(
    models: wp.array(dtype=VehicleModel),
    model_of: wp.array2d(dtype=wp.int32),
    scene: VehicleScene,
    states: wp.array2d(dtype=VehicleState),
    events: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
    slot: int,
    v: int,
    now: wp.float64,
):
    """Contacts of vehicle ``v`` with vehicles after it and with walls."""
    m = models[model_of[slot, v]]
    # Made anew only after a touch: a GPU waits for what it reads from memory in every round. Most
    # steps are near nothing and need no yaw.
    a = _vehicle_box(m, states[slot, v])
    for u in range(v + 1, states.shape[1]):
        b = _vehicle_box(models[model_of[slot, u]], states[slot, u])
        if near(a, b):
            a.yaw = yaw_of(states[slot, v])
            b.yaw = yaw_of(states[slot, u])
            t = meet(a, b)
            if t.touched:
                new = _note(events, counts, slot, now, v, _CAR, u, t.speed, t.x, t.y)
                _touch(scene, states, slot, v, t.a, new, now)
                _touch(scene, states, slot, u, t.b, new, now)
                a = _vehicle_box(m, states[slot, v])
    extent = extent_of(a)
    turned = wp.bool(False)
    walls = scene.colliders
    close = walls_near(scene.grid, a.x, a.y)
    for i in range(close[0], close[1]):
        k = scene.grid.walls[i]
        if in_reach(a.x, a.y, walls[k, 0], walls[k, 1], extent + walls[k, 3] + walls[k, 4]):
            if not turned:
                a.yaw = yaw_of(states[slot, v])
                turned = True
            t = meet(a, _wall_box(walls, k))
            if t.touched:
                new = _note(events, counts, slot, now, v, _WALL, k, t.speed, t.x, t.y)
                _touch(scene, states, slot, v, t.a, new, now)
                a = _vehicle_box(m, states[slot, v])
                turned = False


@wp.func
def mover_contacts(
    m: VehicleModel,
    scene: VehicleScene,
    states: wp.array2d(dtype=VehicleState),
    movers: wp.array3d(dtype=wp.float64),
    events: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
    slot: int,
    v: int,
    now: wp.float64,
    since: wp.float64,
):
    """Contacts of vehicle ``v`` with scripted objects."""
    a = _vehicle_box(m, states[slot, v])
    extent = extent_of(a)
    for k in range(movers.shape[1]):
        if movers[slot, k, 3] > _ZERO:
            x = movers[slot, k, 0] + movers[slot, k, 5] * since
            y = movers[slot, k, 1] + movers[slot, k, 6] * since
            if in_reach(a.x, a.y, x, y, extent + movers[slot, k, 3] + movers[slot, k, 4]):
                a.yaw = yaw_of(states[slot, v])
                t = meet(a, _mover_box(movers, slot, k, since))
                if t.touched:
                    new = _note(events, counts, slot, now, v, _MOVER, k, t.speed, t.x, t.y)
                    _touch(scene, states, slot, v, t.a, new, now)
                    a = _vehicle_box(m, states[slot, v])


@wp.func
def measure(
    m: VehicleModel, scene: VehicleScene, state: VehicleState, target: wp.int32
) -> VehicleState:
    """Distance to the collider ``target`` and closing speed; -1: there is no target."""
    s = state
    k = scene.colliders
    if target < 0:
        return s
    way = separation(
        hull_of(_vehicle_box(m, s)),
        hull_at(k[target, 0], k[target, 1], k[target, 2], k[target, 3], k[target, 4]),
    )
    s.dtc = way[2]
    s.closing = _ZERO
    if way[2] > _ZERO:
        s.closing = (s.velocity[0] * way[0] + s.velocity[1] * way[1]) / way[2]
    return s


@wp.kernel
def measure_kernel(
    # model
    models: wp.array(dtype=VehicleModel),
    model_of: wp.array2d(dtype=wp.int32),
    scene: VehicleScene,
    # args
    targets: wp.array(dtype=wp.int32),
    # state in and out
    states: wp.array2d(dtype=VehicleState),
):
    """Derived columns of all vehicles, for states that were just set."""
    slot, v = wp.tid()
    q = states[slot, v].orientation
    if wp.dot(q, q) > _ZERO:
        m = models[model_of[slot, v]]
        states[slot, v] = measure(m, scene, observe(m, states[slot, v]), targets[slot])


@wp.kernel
def drive_kernel(
    # model
    models: wp.array(dtype=VehicleModel),
    wheels: wp.array2d(dtype=WheelModel),
    model_of: wp.array2d(dtype=wp.int32),
    scene: VehicleScene,
    # args
    lanes: wp.int32,
    steps: wp.int32,
    friction: wp.array(dtype=wp.float64),
    wind: wp.array(dtype=wp.vec2d),
    commands: wp.array4d(dtype=wp.float64),
    switch_step: wp.array(dtype=wp.int32),
    first_step: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.int32),
    targets: wp.array(dtype=wp.int32),
    movers: wp.array3d(dtype=wp.float64),
    # state in and out
    states: wp.array2d(dtype=VehicleState),
    events: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
):
    """Advance all active slots by ``steps`` physics steps.

    ``commands`` [S, V, 2, 5]: in force before and from ``switch_step``. ``first_step`` [S]: physics
    steps since reset at the start. ``targets`` [S]: collider that distances are measured to, -1:
    none. ``movers`` [S, M, 8]: hulls at the start, MOVER_COLUMNS. ``lanes``: threads of a slot, 4
    on a GPU, with a wheel each, or 1; the first writes, and sees to contacts.
    """
    thread = wp.tid()
    slot = thread / lanes
    lane = thread - slot * lanes
    first = wp.where(lanes == 1, 0, lane)
    last = wp.where(lanes == 1, 4, lane + 1)
    if active[slot] == 0:
        return
    vehicles = states.shape[1]
    for k in range(steps):
        row = wp.where(k >= switch_step[slot], 1, 0)
        now = wp.float64(first_step[slot] + k + 1)
        for v in range(vehicles):
            s = states[slot, v]
            frozen = scene.stop_at_impact != 0 and s.collisions > _ZERO
            if s.fault == _ZERO and not frozen:
                w = model_of[slot, v]
                c = VehicleCommand()
                c.throttle = commands[slot, v, row, 0]
                c.brake = commands[slot, v, row, 1]
                c.steering = commands[slot, v, row, 2]
                c.handbrake = commands[slot, v, row, 3]
                c.selector = commands[slot, v, row, 4]
                moved = advance(
                    models,
                    wheels,
                    w,
                    scene.ground,
                    s,
                    c,
                    friction[slot],
                    wind[slot],
                    first,
                    last,
                )
                n = observe_motion(moved)
                together()  # nobody reads the state of before any more
                fault = fault_of(n)
                if fault != _ZERO:
                    s.fault = fault
                    n = s
                else:
                    if n.speed != _ZERO:
                        n.moved = _ONE
                        n.rest_step = -_ONE
                    elif n.moved > _ZERO and n.rest_step < _ZERO:
                        n.rest_step = now
                if lane == 0:
                    states[slot, v] = n
        for v in range(vehicles):
            frozen = scene.stop_at_impact != 0 and states[slot, v].collisions > _ZERO
            if lane == 0 and states[slot, v].fault == _ZERO and not frozen:
                vehicle_contacts(models, model_of, scene, states, events, counts, slot, v, now)
                since = wp.float64(k + 1) * _STEP_S
                mover_contacts(
                    models[model_of[slot, v]],
                    scene,
                    states,
                    movers,
                    events,
                    counts,
                    slot,
                    v,
                    now,
                    since,
                )
        together()
    if lane > 0:
        return
    # No step needs angles and the place of the reference point: the end is early enough.
    for v in range(vehicles):
        m = models[model_of[slot, v]]
        shown = observe_wheels(m, observe(m, states[slot, v]))
        states[slot, v] = measure(m, scene, shown, targets[slot])
