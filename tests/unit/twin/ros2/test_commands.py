"""Commands of stacks: what they say, and bytes that say nothing."""

from __future__ import annotations

import random

import msgspec
import numpy as np
import pytest
from ros2_messages import plain, read_independently

from schemas.messages import Command, Detection, Lights, Pose, SensorErrors
from twin.ros2.commands import (
    DETECTIONS_MAX,
    AckermannDemand,
    GearDemand,
    IndicatorDemand,
    PlainDrive,
    TwistDemand,
    read_command,
    write_plain,
)
from twin.ros2.parts import MessageParts
from twin.ros2.store import MESSAGE_BYTES_MAX, MessageError, type_store
from twin.ros2.tables import COMMAND_TYPES

STORE = type_store()
PARTS = MessageParts(STORE)
STAMP_NS = 12_345_678_901

FULL = Command(
    slot=0,
    token=0,
    tick=2**40,
    throttle=0.1 + 0.2,
    brake=1e-300,
    steering_rad=-0.7000000000000001,
    aeb=True,
    lights=Lights(low=True, fog=True, indicators=3),
    detections=[Detection("Fußgänger", 0.9, 1.5, 2.5, 3.5, 4.5)],
    sensors=SensorErrors(gnss_noise=2.0, gnss_dropout=True),
    handbrake=0.5,
    pose=Pose(1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8),
    trigger=0,
    reverse=True,
    warning=True,
)


def make(name, **fields):
    return STORE.make(name, **fields)


def drive_bytes(command: Command) -> bytes:
    return STORE.encode(write_plain(STORE, STAMP_NS, command))


@pytest.mark.parametrize(
    "command",
    [FULL, Command(slot=0, token=0, tick=0, throttle=0.0, brake=0.0, steering_rad=0.0)],
    ids=["full", "empty"],
)
def test_plain_command_is_the_drive_planes_to_the_last_bit(command):
    data = drive_bytes(command)
    assert read_command(STORE, COMMAND_TYPES[0], data) == PlainDrive(STAMP_NS, command)
    other = read_independently(STORE, COMMAND_TYPES[0], data)
    assert plain(other) == plain(write_plain(STORE, STAMP_NS, command))
    # NaN is not the conversion's to refuse: a range check of all commands does.
    broken = msgspec.structs.replace(command, throttle=float("nan"))
    told = read_command(STORE, COMMAND_TYPES[0], drive_bytes(broken))
    assert isinstance(told, PlainDrive)
    assert np.isnan(told.command.throttle)


def ackermann(**changes):
    values = {"steering_angle": 0.25, "steering_angle_velocity": 0.0, "speed": -3.5}
    values |= {"acceleration": 0.0, "jerk": 0.0} | changes
    return make("ackermann_msgs/msg/AckermannDrive", **values)


def test_ackermann_reads_zeros_as_no_wish():
    stamped = make(
        "ackermann_msgs/msg/AckermannDriveStamped",
        header=PARTS.header(STAMP_NS, "base_link"),
        drive=ackermann(acceleration=1.5),
    )
    said = read_command(STORE, "ackermann_msgs/msg/AckermannDriveStamped", STORE.encode(stamped))
    assert said == AckermannDemand(STAMP_NS, 0.25, None, -3.5, 1.5, None)
    bare = read_command(STORE, "ackermann_msgs/msg/AckermannDrive", STORE.encode(ackermann()))
    assert bare == AckermannDemand(None, 0.25, None, -3.5, None, None)


def test_autoware_control_says_which_wishes_count():
    time = PARTS.time(STAMP_NS)
    package = "autoware_control_msgs/msg"
    lateral = make(
        f"{package}/Lateral",
        stamp=time,
        control_time=time,
        steering_tire_angle=-0.125,
        steering_tire_rotation_rate=0.5,
        is_defined_steering_tire_rotation_rate=True,
    )
    longitudinal = make(
        f"{package}/Longitudinal",
        stamp=time,
        control_time=time,
        velocity=8.0,
        acceleration=-2.0,
        jerk=9.0,
        is_defined_acceleration=True,
        is_defined_jerk=False,
    )
    control = make(
        f"{package}/Control",
        stamp=time,
        control_time=time,
        lateral=lateral,
        longitudinal=longitudinal,
    )
    said = read_command(STORE, f"{package}/Control", STORE.encode(control))
    assert said == AckermannDemand(STAMP_NS, -0.125, 0.5, 8.0, -2.0, None)


def test_twist_takes_speed_and_turn_rate():
    twist = make(
        "geometry_msgs/msg/Twist", linear=PARTS.vector(2.5, 9.0), angular=PARTS.vector(0, 0, -0.5)
    )
    said = read_command(STORE, "geometry_msgs/msg/Twist", STORE.encode(twist))
    assert said == TwistDemand(None, 2.5, -0.5)
    header = PARTS.header(STAMP_NS, "base_link")
    stamped = make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)
    said = read_command(STORE, "geometry_msgs/msg/TwistStamped", STORE.encode(stamped))
    assert said == TwistDemand(STAMP_NS, 2.5, -0.5)


@pytest.mark.parametrize(
    ("value", "gear"),
    [(0, ""), (1, "neutral"), (2, "drive"), (19, "drive"), (20, "reverse"), (22, "park")],
)
def test_gears(value, gear):
    name = "autoware_vehicle_msgs/msg/GearCommand"
    data = STORE.encode(make(name, stamp=PARTS.time(STAMP_NS), command=value))
    assert read_command(STORE, name, data) == GearDemand(STAMP_NS, gear)


@pytest.mark.parametrize(
    ("kind", "value", "indicators"),
    [
        *(("TurnIndicatorsCommand", 0, None), ("TurnIndicatorsCommand", 1, 0)),
        *(("TurnIndicatorsCommand", 2, 1), ("TurnIndicatorsCommand", 3, 2)),
        *(("HazardLightsCommand", 0, None), ("HazardLightsCommand", 1, 0)),
        ("HazardLightsCommand", 2, 3),
    ],
)
def test_indicators(kind, value, indicators):
    name = f"autoware_vehicle_msgs/msg/{kind}"
    data = STORE.encode(make(name, stamp=PARTS.time(STAMP_NS), command=value))
    expected = IndicatorDemand(STAMP_NS, kind.startswith("Hazard"), indicators)
    assert read_command(STORE, name, data) == expected
    data = STORE.encode(make(name, stamp=PARTS.time(STAMP_NS), command=9))
    with pytest.raises(MessageError, match="command is 9, allowed: 0 to"):
        read_command(STORE, name, data)


def test_numbers_that_are_not_finite_are_refused():
    data = STORE.encode(ackermann(speed=float("inf")))
    with pytest.raises(MessageError, match="speed is inf, allowed: finite numbers"):
        read_command(STORE, "ackermann_msgs/msg/AckermannDrive", data)


def test_cut_and_changed_bytes_give_a_command_or_one_line():
    data = drive_bytes(FULL)
    chance = random.Random(7)
    refused = []
    for length in range(len(data) - 3):
        with pytest.raises(MessageError) as caught:
            read_command(STORE, COMMAND_TYPES[0], data[:length])
        assert "\n" not in str(caught.value)
    for _ in range(3000):
        changed = bytearray(data)
        changed[chance.randrange(len(changed))] = chance.randrange(256)
        try:
            read_command(STORE, COMMAND_TYPES[0], bytes(changed))
        except MessageError as error:
            refused.append(str(error))
    assert len(refused) > 100
    assert not any("\n" in line for line in refused)


def test_huge_lengths_are_refused_at_once():
    data = bytearray(drive_bytes(FULL))
    at = data.index("Fußgänger".encode()) - 4
    data[at : at + 4] = (2**32 - 1).to_bytes(4, "little")
    with pytest.raises(MessageError, match="no message of this type"):
        read_command(STORE, COMMAND_TYPES[0], bytes(data))
    with pytest.raises(MessageError, match=f"allowed: up to {MESSAGE_BYTES_MAX}"):
        read_command(STORE, COMMAND_TYPES[0], memoryview(bytes(MESSAGE_BYTES_MAX + 1)))
    with pytest.raises(MessageError, match="encapsulation"):
        read_command(STORE, COMMAND_TYPES[0], b"\x07\x09" + bytes(100))


def test_lists_of_a_command_have_their_limits():
    message = write_plain(STORE, STAMP_NS, FULL)
    for name, most in (("sensor_errors", 1), ("pose", 1), ("detections", DETECTIONS_MAX)):
        values = getattr(message, name)
        setattr(message, name, values * (most + 1))
        with pytest.raises(MessageError, match="allowed: "):
            read_command(STORE, COMMAND_TYPES[0], STORE.encode(message))
        setattr(message, name, values * most)
        assert read_command(STORE, COMMAND_TYPES[0], STORE.encode(message))
    message.lights.indicators = 4
    with pytest.raises(MessageError, match="indicators is 4, allowed: 0 to 3"):
        read_command(STORE, COMMAND_TYPES[0], STORE.encode(message))


def test_fields_that_do_not_fit_are_named():
    with pytest.raises(MessageError, match="Twist: cannot be written"):
        STORE.encode(make("geometry_msgs/msg/Twist", linear=None, angular=None))
