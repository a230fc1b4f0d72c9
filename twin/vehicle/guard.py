"""Limits of a vehicle's state; one that leaves them ends its slot with a reason."""

from __future__ import annotations

import warp as wp

from twin.vehicle.state import VehicleState

SPEED_MAX_MPS = 150.0
"""No road vehicle; kinetic energy beyond this speed's means that the numbers ran away [m/s]."""
RATE_MAX_RADPS = 30.0
WHEEL_SPEED_MAX_RADPS = 3000.0
REACH_MAX_M = 1.0e6
DEPTH_MAX_M = 100.0

NOT_A_NUMBER, TOO_MUCH_ENERGY, SPINNING, OUT_OF_WORLD = 1, 2, 3, 4

FAULTS: dict[int, str] = {
    NOT_A_NUMBER: "vehicle state is not a number",
    TOO_MUCH_ENERGY: f"vehicle has more kinetic energy than at {SPEED_MAX_MPS:g} m/s",
    SPINNING: f"vehicle turns faster than {RATE_MAX_RADPS:g} rad/s, "
    f"or a wheel than {WHEEL_SPEED_MAX_RADPS:g} rad/s",
    OUT_OF_WORLD: f"vehicle is {REACH_MAX_M:g} m away or fell {DEPTH_MAX_M:g} m",
}
"""What a fault means, for people."""

_SPEED_SQUARE = wp.constant(wp.float64(SPEED_MAX_MPS**2))
_RATE_SQUARE = wp.constant(wp.float64(RATE_MAX_RADPS**2))
_WHEEL_SQUARE = wp.constant(wp.float64(WHEEL_SPEED_MAX_RADPS**2))
_REACH = wp.constant(wp.float64(REACH_MAX_M))
_DEPTH = wp.constant(wp.float64(DEPTH_MAX_M))


@wp.func
def fault_of(s: VehicleState) -> wp.float64:
    """The fault of a state, 0.0 for none."""
    # A sum is a number exactly if its terms are (or cancel, which the limits below exclude).
    total = wp.dot(s.velocity, s.velocity) + wp.dot(s.rate, s.rate) + wp.dot(s.com, s.com)
    total += wp.dot(s.wheel_speed, s.wheel_speed) + wp.dot(s.suspension, s.suspension)
    total += wp.dot(s.suspension_rate, s.suspension_rate) + s.steering + s.throttle + s.brake
    total += s.orientation[0] + s.orientation[1] + s.orientation[2] + s.orientation[3] + s.rpm
    if not wp.isfinite(total):
        return wp.float64(NOT_A_NUMBER)
    if wp.dot(s.velocity, s.velocity) > _SPEED_SQUARE:
        return wp.float64(TOO_MUCH_ENERGY)
    if (
        wp.dot(s.rate, s.rate) > _RATE_SQUARE
        or wp.dot(s.wheel_speed, s.wheel_speed) > _WHEEL_SQUARE
    ):
        return wp.float64(SPINNING)
    if wp.abs(s.com[0]) > _REACH or wp.abs(s.com[1]) > _REACH or s.com[2] < -_DEPTH:
        return wp.float64(OUT_OF_WORLD)
    return wp.float64(0.0)
