"""What a stack of ROS 2 asks becomes pedals, by one pure controller."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from devkit.bridges.ros2.controllers import (
    ANGLE_BITS,
    STANDSTILL_MPS,
    AskedError,
    AskedMotion,
    MotionControl,
    press,
)
from devkit.bridges.ros2.driving import AskedTick, RosDriver, TickMistakeError, motion_of
from schemas.messages import Command, Lights, command_mistake
from schemas.steady import steady
from twin.ros2.commands import (
    AckermannDemand,
    GearDemand,
    IndicatorDemand,
    PlainDrive,
    TwistDemand,
)

CONTROL = MotionControl()
PERIOD_S = 0.05
NOW = AskedTick(0, 0, 7, 3.0)
GEARS = ("drive", "reverse", "neutral", "park")


def ackermann(speed_mps: float, steering_rad: float = 0.0, accel_mps2: float | None = None):
    return AckermannDemand(0, steering_rad, None, speed_mps, accel_mps2, None)


def test_a_slower_car_gets_throttle_and_a_faster_one_brake():
    _, faster = press(0.0, AskedMotion(5.0, steering_rad=0.1), 3.0, PERIOD_S, CONTROL)
    assert faster.throttle == pytest.approx(0.3 * 2.0 + 0.05 * 2.0 * PERIOD_S)
    assert (faster.brake, faster.steering_rad, faster.reverse) == (0.0, 0.1, False)
    _, slower = press(0.0, AskedMotion(3.0, steering_rad=0.0), 5.0, PERIOD_S, CONTROL)
    assert (slower.throttle, slower.brake) == (0.0, pytest.approx(0.5 * 0.3 * 2.0))
    _, asked = press(0.0, AskedMotion(3.0, -2.0, steering_rad=0.0), 3.0, PERIOD_S, CONTROL)
    assert asked.brake == pytest.approx(0.5 * 0.1 * 2.0)


def test_a_car_that_is_asked_to_stand_is_held():
    integral, pedals = press(0.4, AskedMotion(0.0), 0.99 * STANDSTILL_MPS, PERIOD_S, CONTROL)
    assert (integral, pedals.throttle, pedals.brake) == (0.0, 0.0, CONTROL.standstill_brake)
    _, pedals = press(0.0, AskedMotion(0.0), STANDSTILL_MPS, PERIOD_S, CONTROL)
    assert pedals.brake == pytest.approx(0.5 * 0.3 * STANDSTILL_MPS)


def test_backwards_is_by_the_sign_or_by_the_gear():
    _, pedals = press(0.0, AskedMotion(-2.0, steering_rad=0.0), 0.0, PERIOD_S, CONTROL)
    assert (pedals.throttle > 0.5, pedals.reverse) == (True, True)
    _, pedals = press(0.0, AskedMotion(-2.0), 0.0, PERIOD_S, CONTROL, gear="reverse")
    assert (pedals.throttle > 0.5, pedals.reverse) == (True, True)
    # It rolls forward: first it has to stop, in the gear that it rolls in.
    integral, pedals = press(0.3, AskedMotion(-2.0), 4.0, PERIOD_S, CONTROL)
    assert (integral, pedals.throttle, pedals.brake, pedals.reverse) == (0.0, 0.0, 1.0, False)


@pytest.mark.parametrize(
    ("gear", "asked_mps"),
    [("drive", -2.0), ("reverse", 2.0), *((gear, v) for gear in GEARS[2:] for v in (-2.0, 2.0))],
)
@pytest.mark.parametrize("speed_mps", [-4.0, -0.2, 0.0, 0.2, 4.0])
def test_a_speed_against_the_gear_stands(gear, asked_mps, speed_mps):
    asked = AskedMotion(asked_mps, acceleration_mps2=9.0, steering_rad=0.1)
    integral, pedals = press(0.9, asked, speed_mps, PERIOD_S, CONTROL, gear=gear)
    assert (integral, pedals.throttle, pedals.steering_rad) == (0.0, 0.0, 0.1)
    assert pedals.brake > 0.0


def test_of_several_gears_the_safest_counts():
    driver = RosDriver(CONTROL, PERIOD_S, 1.0)
    demands = {"/drive": ackermann(2.0), "/a": GearDemand(0, "drive"), "/b": GearDemand(0, "park")}
    still = AskedTick(0, 0, 7, 0.0)
    assert driver.command("/drive", demands, still).throttle == 0.0
    demands["/b"] = GearDemand(0, "")
    assert driver.command("/drive", demands, still).throttle > 0.5


def test_a_yaw_rate_becomes_an_angle():
    _, pedals = press(0.0, AskedMotion(5.0, yaw_rate_radps=0.4), 5.0, PERIOD_S, CONTROL)
    assert pedals.steering_rad == steady(math.atan(2.5 * 0.4 / 5.0), ANGLE_BITS)
    assert pedals.steering_rad == pytest.approx(math.atan(2.5 * 0.4 / 5.0), rel=1e-12)
    mantissa, _ = math.frexp(pedals.steering_rad)
    assert (mantissa * 2**ANGLE_BITS).is_integer(), "no last bits of a C library"
    _, backwards = press(0.0, AskedMotion(-5.0, yaw_rate_radps=0.4), -5.0, PERIOD_S, CONTROL)
    assert backwards.steering_rad == -pedals.steering_rad
    _, spot = press(0.0, AskedMotion(0.0, yaw_rate_radps=9.0), 0.0, PERIOD_S, CONTROL)
    assert spot.steering_rad == CONTROL.steering_max_rad


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["speed_mps", "acceleration_mps2", "steering_rad"])
def test_a_number_that_is_none_is_one_line(name, value):
    asked = AskedMotion(**{"speed_mps": 1.0, name: value})
    with pytest.raises(AskedError, match=f"{name} is {value}, a finite number is needed"):
        press(0.0, asked, 1.0, PERIOD_S, CONTROL)


FINITE = st.floats(-1e6, 1e6)


@given(
    integral=st.floats(0.0, 1.0),
    speed=FINITE,
    asked=st.builds(AskedMotion, FINITE, FINITE, st.none() | FINITE, FINITE),
    gear=st.sampled_from(["", *GEARS]),
)
def test_pedals_are_always_in_their_ranges(integral, speed, asked, gear):
    integral, pedals = press(integral, asked, speed, PERIOD_S, CONTROL, gear=gear)
    assert 0.0 <= integral <= 1.0
    assert pedals.throttle == 0.0 or pedals.brake == 0.0
    command = Command(0, 0, 0, pedals.throttle, pedals.brake, pedals.steering_rad)
    assert command_mistake(command) == ""


def test_the_integral_follows_only_what_the_throttle_can():
    integral = 0.0
    for _ in range(100):
        integral, pedals = press(integral, AskedMotion(30.0), 0.0, PERIOD_S, CONTROL)
    assert integral == 0.0, "it was flat out all the time"
    for _ in range(400):
        integral, pedals = press(integral, AskedMotion(10.0), 9.0, PERIOD_S, CONTROL)
    assert integral == pytest.approx(0.7, abs=0.01)
    assert pedals.throttle == pytest.approx(1.0, abs=0.01)


def test_commands_on_several_topics_make_one():
    driver = RosDriver(CONTROL, PERIOD_S, aeb_brake=0.9)
    demands = {
        "/drive": ackermann(-2.0, 0.2),
        "/gear": GearDemand(0, "reverse"),
        "/turn": IndicatorDemand(0, False, 1),
    }
    command = driver.command("/drive", demands, AskedTick(2, 11, 7, 0.0))
    assert (command.slot, command.token, command.tick) == (2, 11, 7)
    assert (command.reverse, command.steering_rad, command.aeb) == (True, 0.2, False)
    assert command.lights == Lights(indicators=1)
    demands["/hazard"] = IndicatorDemand(0, True, 3)
    assert driver.command("/drive", demands, NOW).lights.indicators == 3
    demands["/hazard"] = IndicatorDemand(0, True, None)
    assert driver.command("/drive", demands, NOW).lights.indicators == 1
    del demands["/gear"]
    stopping = driver.command("/drive", {"/drive": ackermann(0.0)}, AskedTick(0, 0, 0, 20.0))
    assert (stopping.brake, stopping.aeb) == (1.0, True)


def test_before_the_first_command_the_car_is_held():
    command = RosDriver(CONTROL, PERIOD_S, 1.0).command("/drive", {}, AskedTick(0, 0, 0, 0.0))
    assert (command.throttle, command.brake) == (0.0, CONTROL.standstill_brake)
    assert motion_of(None) == AskedMotion(0.0, steering_rad=0.0)


def test_a_plain_command_is_passed_on_bit_for_bit():
    asked = Command(
        0, 0, 7, 0.1 + 0.2, 1e-300, -0.1, aeb=True, lights=Lights(low=True), trigger=None
    )
    driver = RosDriver(CONTROL, PERIOD_S, 1.0)
    command = driver.command("/x", {"/x": PlainDrive(0, asked)}, AskedTick(3, 9, 7, 0.0))
    assert (command.slot, command.token, command.tick) == (3, 9, 7)
    assert (command.throttle, command.brake, command.steering_rad) == (0.1 + 0.2, 1e-300, -0.1)
    with pytest.raises(TickMistakeError, match="of tick 8 says it is for tick 7"):
        driver.command("/x", {"/x": PlainDrive(0, asked)}, AskedTick(3, 9, 8, 0.0))
    held = RosDriver(CONTROL, PERIOD_S, 1.0, exact=False)
    later = held.command("/x", {"/x": PlainDrive(0, asked)}, AskedTick(3, 9, 8, 0.0))
    assert (later.tick, later.throttle) == (8, 0.1 + 0.2)


def test_a_twist_asks_for_speed_and_yaw_rate():
    assert motion_of(TwistDemand(None, 2.0, 0.3)) == AskedMotion(2.0, yaw_rate_radps=0.3)
    assert motion_of(ackermann(2.0, 0.3, 1.5)) == AskedMotion(2.0, 1.5, 0.3)
