"""From commands to wheel torques: actuators, engine, automatic gearbox, differential, Ackermann.

tau_total = T(rpm) GR FDR tau A with A the pedal's non-linear map; the engine speed follows the
driven wheels through the gears, lagged, but not below what the torque converter lets it keep. (The
paper adds the idle speed to the wheels' speed; here the larger of the two counts, so that the
engine turns as the gears say.) The gearbox shifts by the road speed, so wheelspin does not hunt.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable.whole import whole_within
from twin.base.portable_math import portable_tan
from twin.vehicle.model import VehicleModel
from twin.vehicle.state import VehicleState

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_RPM = wp.constant(wp.float64(9.549296585513721))  # rad/s -> rpm
_DROP_MAX = wp.constant(wp.float64(0.9))
_ENGAGE_MPS = wp.constant(wp.float64(1.0))
_TRACTION_RATE = wp.constant(wp.float64(8.0))
"""Change of the traction control's share of torque per slip error [1/s]."""
_TRACTION_DROP = wp.constant(wp.float64(-3.0))
_RATE_MIN = wp.constant(wp.float64(0.01))

COMMANDS = ("throttle", "brake", "steering_rad", "handbrake", "selector")
"""Columns of a command: 0..1, 0..1, road-wheel angle, 0..1, and 1 drive, 0 neutral, -1 reverse."""


@wp.struct
class WheelDrive:
    """What the powertrain gives in a step."""

    torque: wp.float64
    """At the differential, all driven wheels together [N m]."""
    gear: wp.float64
    shift_left: wp.float64
    rpm: wp.float64
    traction: wp.float64
    """The traction control's share of torque [-]."""


# Rows are read where they lie: a table that is indexed by a variable would be copied first.
@wp.func_native("return models.data[model].engine_rpm[row];")
def _engine_rpm(
    models: wp.array(dtype=VehicleModel), model: wp.int32, row: wp.int32
) -> wp.float64: ...


@wp.func_native("return models.data[model].engine_torque[row];")
def _engine_torque(
    models: wp.array(dtype=VehicleModel), model: wp.int32, row: wp.int32
) -> wp.float64: ...


@wp.func_native("return models.data[model].ratios[row];")
def _ratio(models: wp.array(dtype=VehicleModel), model: wp.int32, row: wp.int32) -> wp.float64: ...


@wp.func
def engine_torque(
    models: wp.array(dtype=VehicleModel), model: wp.int32, rpm: wp.float64
) -> wp.float64:
    """Full-load torque, linear between the map's rows, 0 beyond its last [N m]."""
    rows = models[model].engine_rows
    row = wp.int32(0)
    for i in range(1, rows):
        if rpm > _engine_rpm(models, model, i - 1):
            row = i
    torque = _engine_torque(models, model, 0)
    if row > 0:
        low = _engine_rpm(models, model, row - 1)
        high = _engine_rpm(models, model, row)
        share = wp.min((rpm - low) / (high - low), _ONE)
        before = _engine_torque(models, model, row - 1)
        torque = before + share * (_engine_torque(models, model, row) - before)
    if rpm > _engine_rpm(models, model, rows - 1):
        torque = _ZERO
    return torque


@wp.func
def overall_ratio(
    models: wp.array(dtype=VehicleModel), model: wp.int32, gear: wp.float64
) -> wp.float64:
    """Engine speed over wheel speed, negative in reverse, 0 in neutral [-]."""
    if gear < _ZERO:
        return -models[model].reverse_ratio
    if gear < _ONE:
        return _ZERO
    return _ratio(models, model, whole_within(gear, 1, models[model].gear_count) - 1)


@wp.func
def next_gear(
    m: VehicleModel,
    ratio: wp.float64,
    gear: wp.float64,
    selector: wp.float64,
    speed: wp.float64,
    pedal: wp.float64,
) -> wp.float64:
    """The gear that the selector and the engine's band ask for."""
    if selector == _ZERO:
        return _ZERO
    if selector < _ZERO:
        return wp.where(speed < _ENGAGE_MPS, -_ONE, _ZERO)
    if gear < _ONE:
        return wp.where(speed > -_ENGAGE_MPS, _ONE, _ZERO)
    rpm = wp.abs(speed) / m.radius * _RPM * ratio
    up = m.shift_up[0] + pedal * (m.shift_up[1] - m.shift_up[0])
    down = m.shift_down[0] + pedal * (m.shift_down[1] - m.shift_down[0])
    if rpm > up and gear < wp.float64(m.gear_count):
        return gear + _ONE
    if rpm < down and gear > _ONE:
        return gear - _ONE
    return gear


@wp.func
def drive(
    models: wp.array(dtype=VehicleModel),
    model: wp.int32,
    s: VehicleState,
    throttle: wp.float64,
    selector: wp.float64,
    friction: wp.float64,
) -> WheelDrive:
    """One step of engine and gearbox at actuator position ``throttle``."""
    m = models[model]
    d = WheelDrive()
    d.gear = s.gear
    d.shift_left = wp.max(s.shift_left - m.step, _ZERO)
    if d.shift_left == _ZERO:
        engaged = overall_ratio(models, model, s.gear)
        wanted = next_gear(m, engaged, s.gear, selector, s.speed, throttle)
        if wanted != s.gear:
            # Engaging from neutral or reverse happens at walking pace and takes no time.
            d.shift_left = wp.where(wanted >= _ONE and s.gear >= _ONE, m.shift_time, _ZERO)
            d.gear = wanted
    share = throttle - (_ONE - throttle) * wp.abs(s.speed) / m.pedal_speed
    share = wp.clamp(share, _ZERO, _ONE)
    ratio = overall_ratio(models, model, d.gear)
    turning = wp.float64(0.0)
    driven = wp.float64(0.0)
    slip = wp.float64(0.0)
    for i in range(4):
        if m.drive_share[i] > _ZERO:
            turning += s.wheel_speed[i]
            driven += _ONE
            slip = wp.max(slip, wp.abs(s.slip[i]) / m.slip_x[i])
    d.traction = _ONE
    if m.traction != _ZERO and throttle > _ZERO:
        error = wp.max(_ONE - slip / friction, _TRACTION_DROP)
        d.traction = wp.clamp(s.traction + m.step * _TRACTION_RATE * error, _ZERO, _ONE)
    coupled = wp.max(turning / driven * ratio * _RPM, _ZERO)
    floor = m.idle_rpm + share * (m.stall_rpm - m.idle_rpm)
    d.rpm = s.rpm + (wp.max(coupled, floor) - s.rpm) * m.rpm_gain
    if d.shift_left > _ZERO or d.gear == _ZERO:
        return d
    slipping = _ONE - wp.min(coupled / wp.max(d.rpm, _ONE), _ONE)
    converter = _ONE + (m.converter - _ONE) * slipping
    d.torque = (
        engine_torque(models, model, d.rpm) * share * d.traction * converter * ratio * m.efficiency
    )
    return d


@wp.func
def wheel_torque(
    m: VehicleModel,
    share: wp.float64,
    wheel: wp.int32,
    total: wp.float64,
    steering: wp.float64,
) -> wp.float64:
    """Drive torque of a wheel after the differential: the wheel inside the turn loses torque."""
    inside = wp.where(wheel % 2 == 0, wp.max(steering, _ZERO), wp.max(-steering, _ZERO))
    return total * share * (_ONE - wp.clamp(m.drop * inside, _ZERO, _DROP_MAX))


@wp.func
def steer(m: VehicleModel, position: wp.float64, target: wp.float64, speed: wp.float64):
    """Next position of the steering motor: lagged, its rate kappa_d + kappa_v v / v_max at most."""
    rate = m.steering_rate + m.steering_rate_speed * wp.min(wp.abs(speed) / m.speed_max, _ONE)
    way = wp.max(rate, _RATE_MIN) * m.step
    target = wp.clamp(target, -m.steering_max, m.steering_max)
    return position + wp.clamp((target - position) * m.steering_gain, -way, way)


@wp.func
def wheel_slopes(m: VehicleModel, steering: wp.float64) -> wp.vec2d:
    """Tangents of the angles of the left and right front wheel: 2 l tan d / (2 l -+ w tan d)."""
    t = portable_tan(steering)
    length = _TWO * m.wheelbase
    width = m.track * m.ackermann
    return wp.vec2d(length * t / (length - width * t), length * t / (length + width * t))
