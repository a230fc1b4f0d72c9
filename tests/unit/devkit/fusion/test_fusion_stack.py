"""devkit.fusion: the whole stack on made-up drives."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest
from fused_drives import MadeUpCase, Thing, observe

from devkit.fusion import FusionStack
from devkit.fusion.parameters import FusionSensors, StagingParameters, TrackingParameters
from devkit.lane.lateral import LateralParameters
from devkit.reference.control import Controller
from devkit.reference.lights import LightsSwitch
from devkit.stack import StackError, load_stack
from schemas.messages import Command, command_mistake
from twin.base.errors import UsageError

CAR = Thing(60.0, 0.0)
PARKED = Thing(25.0, -2.6)


def drive(cases: list[MadeUpCase | None], ticks: int, **parameters) -> list[list[Command]]:
    """Commands of each tick; every one is valid."""
    stack = FusionStack(len(cases), **parameters)
    for slot, case in enumerate(cases):
        if case is not None:
            stack.reset(slot, case.episode(slot))
    answers = [stack.step(observe(cases, tick)) for tick in range(ticks)]
    for command in itertools.chain(*answers):
        assert command_mistake(command) == ""
    return answers


def of_slot(answers: list[list[Command]], slot: int) -> list[Command]:
    return [command for answer in answers for command in answer if command.slot == slot]


def first_tick(commands: list[Command], asked) -> int | None:
    return next((c.tick for c in commands if asked(c)), None)


@pytest.mark.parametrize("used", ["camera", "camera+radar", "camera+lidar", "all"])
def test_every_sensor_set_brakes_for_a_car_and_warns_first(used):
    things = [Thing(60.0, 0.0, by="camera lidar radar"), PARKED]
    case = MadeUpCase(1, things, radar=True)
    commands = of_slot(drive([case], 120, sensors_used=used), 0)
    warned = first_tick(commands, lambda c: c.warning)
    braked = first_tick(commands, lambda c: c.brake > 0.3)
    assert warned is not None
    assert braked is not None
    assert warned <= braked
    gap_m = 60.0 - 4.1 - 8.0 * 0.05 * braked
    # Early enough for packed snow (16.3 m), late enough not to be braking for nothing.
    assert 17.0 < gap_m < 30.0


@pytest.mark.parametrize("used", ["camera", "camera+radar", "camera+lidar", "all"])
def test_parked_cars_and_oncoming_ones_are_passed(used):
    see = "camera lidar radar"
    things = [
        *(Thing(12.0 + 9.0 * n, -2.7, by=see) for n in range(6)),
        Thing(90.0, 3.4, vx_mps=-9.0, by=see),
    ]
    commands = of_slot(drive([MadeUpCase(1, things, radar=True)], 100, sensors_used=used), 0)
    assert not any(c.aeb for c in commands)
    assert first_tick(commands, lambda c: c.throttle > 0.0) is not None


def test_a_box_of_one_camera_does_not_brake_where_lidar_sees_the_road():
    ghost = Thing(30.0, 0.0, by="camera")
    both = [ghost, Thing(45.0, -2.7), Thing(45.0, 2.9)]
    fused = of_slot(drive([MadeUpCase(1, both)], 60, sensors_used="all"), 0)
    camera = of_slot(drive([MadeUpCase(1, both)], 60, sensors_used="camera"), 0)
    assert not any(c.aeb for c in fused)
    assert any(c.aeb for c in camera), "the ghost is no test: the camera alone ignores it"


def test_a_parked_car_that_lidar_loses_now_and_then_stays_where_lidar_saw_it():
    """The camera's box lies in the path; LiDAR sees the car beside it, in two of five sweeps."""
    seen = [Thing(30.0, -2.6, from_s=0.5 * n, until_s=0.5 * n + 0.2, by="lidar") for n in range(9)]
    wide = Thing(30.0, -1.4, width_m=2.4, by="camera")
    walls = [Thing(50.0, -4.5), Thing(50.0, 4.5)]
    commands = of_slot(drive([MadeUpCase(1, [*seen, wide, *walls])], 80), 0)
    assert not any(c.aeb for c in commands)
    camera = of_slot(drive([MadeUpCase(1, [wide])], 80, sensors_used="camera"), 0)
    assert any(c.aeb for c in camera), "the box is no test: it does not lie in the path"


def test_lidar_alone_brakes_where_the_camera_sees_nothing():
    commands = of_slot(drive([MadeUpCase(1, [Thing(60.0, 0.0, by="lidar")])], 110), 0)
    braked = first_tick(commands, lambda c: c.aeb)
    assert braked is not None
    assert 60.0 - 4.1 - 0.4 * braked > 17.0


def test_radar_alone_does_not_brake_for_what_stands():
    things = [Thing(60.0, 0.0, by="radar")]
    answers = drive([MadeUpCase(1, things, lidar=False, radar=True)], 120)
    assert not any(c.aeb for c in of_slot(answers, 0))


def test_the_brake_is_released_when_the_threat_is_gone():
    things = [Thing(40.0, 0.0, until_s=2.4)]
    commands = of_slot(drive([MadeUpCase(1, things)], 100), 0)
    assert any(c.aeb for c in commands[:48])
    assert not any(c.aeb for c in commands[75:])
    assert all(c.brake < 0.3 for c in commands[75:])


def test_a_car_that_drives_ahead_as_fast_is_followed_without_braking():
    commands = of_slot(drive([MadeUpCase(1, [Thing(24.0, 0.0, vx_mps=8.0)])], 120), 0)
    assert not any(c.aeb for c in commands[20:])


def test_a_pedestrian_who_will_cross_is_braked_for_before_he_is_in_the_path():
    person = Thing(40.0, -5.0, width_m=0.6, height_m=1.7, vy_mps=1.3, class_id=3)
    stands = Thing(40.0, -5.0, width_m=0.6, height_m=1.7, class_id=3)
    walking = of_slot(drive([MadeUpCase(1, [person])], 90), 0)
    standing = of_slot(drive([MadeUpCase(1, [stands])], 90), 0)
    braked = first_tick(walking, lambda c: c.aeb)
    assert braked is not None
    assert -5.0 + 1.3 * 0.05 * braked + 0.3 < -1.1, "he is in the path already"
    assert not any(c.aeb for c in standing)


def test_commands_do_not_depend_on_the_number_of_slots_or_the_neighbours():
    def case(n: int) -> MadeUpCase:
        things = [Thing(40.0 + 3.0 * n, 0.1 * n - 0.3), Thing(15.0 + n, -2.6), Thing(50.0, 3.4)]
        return MadeUpCase(n + 1, things, speed_mps=5.0 + 0.5 * n, fog_per_m=0.002 * n, radar=True)

    alone = of_slot(drive([case(3)], 80), 0)
    many = [case(n % 8) if n % 5 else None for n in range(16)]
    many[11] = case(3)
    among = of_slot(drive(many, 80), 11)
    packed = [
        [msgspec.msgpack.encode(msgspec.structs.replace(c, slot=0)) for c in commands]
        for commands in (alone, among)
    ]
    assert packed[0] == packed[1]
    assert any(c.aeb for c in alone)


def test_a_dead_lidar_is_said_and_the_camera_decides_alone(capsys):
    case = MadeUpCase(1, [CAR, Thing(60.0, -2.7)], lidar_dead_s=2.0)
    commands = of_slot(drive([case], 120), 0)
    assert any(c.aeb for c in commands)
    assert "lidar blocked, few rays come back" in capsys.readouterr().out


def test_fog_that_blinds_the_camera_is_said(capsys):
    drive([MadeUpCase(1, [CAR], fog_per_m=0.2)], 10)
    assert "camera blind by fog" in capsys.readouterr().out


def test_a_set_that_names_a_missing_sensor_is_one_line():
    case = MadeUpCase(1, lidar=False)
    stack = FusionStack(1, sensors_used="camera+lidar")
    with pytest.raises(
        UsageError, match=r"^sensors_used: camera\+lidar, but .* has no LiDAR"
    ) as told:
        stack.reset(0, case.episode(0))
    assert "\n" not in str(told.value)


def test_a_case_without_cameras_is_one_line():
    blind = msgspec.structs.replace(MadeUpCase(1).episode(0), cameras=[])
    with pytest.raises(UsageError, match="render: false"):
        FusionStack(1).reset(0, blind)


def test_an_observation_of_another_case_is_refused():
    stack = FusionStack(1)
    stack.reset(0, MadeUpCase(1).episode(0))
    with pytest.raises(ValueError, match="token 2, but reset for 1"):
        stack.step(observe([MadeUpCase(2)], 0))


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"sensors_used": "lidar"}, "sensors_used"),
        ({"single_ttc_s": 5.0}, "must rise in this order"),
        ({"clutter": 0.9}, "below detection 0.8"),
        ({"partial_brake": 0.0}, "partial_brake"),
        ({"gate": float("nan")}, "gate"),
        ({"sensor_used": "all"}, "did you mean 'sensors_used'"),
        ({"cruise": "throttle", "cruise_speed_mps": 9.0}, "does not look at it"),
    ],
)
def test_a_wrong_parameter_is_named(parameters, told):
    with pytest.raises(StackError, match=told):
        load_stack("devkit.fusion:FusionStack", 1, parameters)


def test_no_parameter_belongs_to_two_parts():
    parts = (FusionSensors, TrackingParameters, StagingParameters, Controller, LateralParameters)
    names = [name for part in (*parts, LightsSwitch) for name in part.__struct_fields__]
    assert len(names) == len(set(names))
    assert set(FusionStack.PARAMETERS) == {*parts, LightsSwitch}


def test_a_slot_is_forgotten_at_reset():
    stack = FusionStack(1)
    first = MadeUpCase(1, [Thing(20.0, 0.0)])
    stack.reset(0, first.episode(0))
    for tick in range(40):
        answer = stack.step(observe([first], tick))
    assert answer[0].aeb
    free = MadeUpCase(2)
    stack.reset(0, free.episode(0))
    assert not any(stack.step(observe([free], tick))[0].aeb for tick in range(20))
    assert not stack.tracks.live.any()
    assert np.isfinite(stack.ego.speed_mps).all()
