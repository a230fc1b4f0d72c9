"""The clock moves when the tick that it shows was answered, and by nothing else."""

from __future__ import annotations

import pytest

from devkit.bridges.ros2.bridge import Ros2Bridge, with_command
from devkit.bridges.ros2.lockstep import Lockstep, StampError
from devkit.stack import StackError, load_stack
from schemas.plan import expand, parse_campaign
from twin.base.errors import StackFaultError
from twin.fabric.ros2.names import NameMistakeError
from twin.ros2.tables import load_table

ME, OTHER = b"a" * 16, b"b" * 16


def command(lockstep: Lockstep, value: str, stamp_ns: int | None, **named) -> str:
    named = {"main": True, "sender": ME, **named}
    return lockstep.command("/drive", value, stamp_ns, named["sender"], main=named["main"])


def test_a_tick_is_answered_by_its_stamp_alone():
    lockstep = Lockstep("stamp")
    lockstep.begin(100)
    assert not lockstep.is_answered
    assert command(lockstep, "lamps", 0, main=False) == ""
    assert not lockstep.is_answered
    assert command(lockstep, "first", 100) == ""
    assert lockstep.is_answered
    assert lockstep.latest["/drive"] == "first"
    lockstep.begin(150)
    assert not lockstep.is_answered


def test_a_late_or_doubled_command_is_left_out_and_told_once():
    lockstep = Lockstep("stamp")
    lockstep.begin(2_000_000_000)
    line = command(lockstep, "old", 1_950_000_000)
    assert line == (
        "left out: a command on /drive with the stamp 1.950000000 s, which was answered already; "
        "further ones of this case are not told"
    )
    assert command(lockstep, "older", 1) == ""
    assert not lockstep.is_answered
    command(lockstep, "good", 2_000_000_000)
    assert command(lockstep, "again", 2_000_000_000) == ""
    assert (lockstep.latest["/drive"], lockstep.late) == ("good", 3)


def test_a_command_from_the_future_is_a_mistake():
    lockstep = Lockstep("stamp")
    lockstep.begin(1_000_000_000)
    with pytest.raises(
        StampError, match=r"has the stamp 1\.05.* s, but /clock is 1\.0.* s; use sim"
    ):
        command(lockstep, "x", 1_050_000_000)


@pytest.mark.parametrize("answer", ["stamp", "step", "newest"])
def test_two_senders_of_a_command_are_a_mistake(answer):
    lockstep = Lockstep(answer)
    lockstep.begin(0)
    command(lockstep, "x", 0)
    with pytest.raises(StampError, match="two publishers command on /drive: 61616161 and 62626262"):
        command(lockstep, "y", 0, sender=OTHER)


def test_steps_move_the_clock_where_stamps_do_not():
    lockstep = Lockstep("step")
    lockstep.begin(100)
    command(lockstep, "x", None)
    command(lockstep, "y", None)
    assert not lockstep.is_answered
    assert lockstep.step() == ""
    assert lockstep.is_answered
    lockstep.begin(200)
    assert not lockstep.is_answered
    assert lockstep.step() == ""
    assert lockstep.latest == {"/drive": "y"}, "it is in force until another comes"


def test_a_step_moves_nothing_where_stamps_do():
    lockstep = Lockstep("stamp")
    lockstep.begin(100)
    assert lockstep.step() == "answer: stamp is set, where a call moves nothing"
    assert not lockstep.is_answered


def test_a_step_while_no_tick_waits_moves_nothing():
    lockstep = Lockstep("step")
    assert lockstep.step() == "no tick waits"
    lockstep.begin(100)
    assert not lockstep.is_answered
    assert lockstep.step() == ""
    assert lockstep.step() == "no tick waits"
    lockstep.begin(200)
    assert not lockstep.is_answered


@pytest.mark.parametrize("first", ["gear", "drive"])
def test_gear_and_lamps_count_from_the_tick_after_their_stamp(first):
    """Whatever comes first: what a tick is answered with is the same."""

    def gear(value: str, stamp_ns: int) -> None:
        assert lockstep.command("/gear", value, stamp_ns, ME, main=False) == ""

    lockstep = Lockstep("stamp")
    gear("drive", 0)  # sim time is 0 before the first tick
    lockstep.begin(0)
    assert "/gear" not in lockstep.latest
    for tick_ns, before in ((0, None), (50, "gear of 0"), (100, "gear of 50")):
        if tick_ns:
            lockstep.begin(tick_ns)
        if first == "gear":
            gear(f"gear of {tick_ns}", tick_ns)
        command(lockstep, "go", tick_ns)
        assert lockstep.latest.get("/gear") == before
        if first == "drive":
            gear(f"gear of {tick_ns}", tick_ns)
    lockstep.begin(150)
    gear("late", 100)
    assert lockstep.latest["/gear"] == "late"
    with pytest.raises(StampError, match=r"a command on /gear has the stamp .* but /clock is"):
        gear("wall clock", 10**18)


def test_what_came_of_the_case_before_is_left_out_until_the_first_answer():
    lockstep = Lockstep("stamp", carried_over=True)
    line = command(lockstep, "old", 9_000_000_000, sender=OTHER)
    assert "later than /clock: of the case before" in line
    lockstep.begin(0)
    assert command(lockstep, "old", 9_050_000_000) == ""
    assert lockstep.command("/gear", "old", 9_050_000_000, ME, main=False) == ""
    assert (lockstep.is_answered, lockstep.latest) == (False, {})
    command(lockstep, "new", 0)
    assert lockstep.latest == {"/drive": "new"}
    with pytest.raises(StampError, match="use sim time"):
        command(lockstep, "future", 9_000_000_000)
    with pytest.raises(StampError, match="two publishers"):
        command(lockstep, "again", 0, sender=OTHER)


def test_newest_waits_for_nobody():
    lockstep = Lockstep("newest")
    lockstep.begin(100)
    assert lockstep.is_answered


def mistakes(**changed) -> list[str]:
    autonomy = {"bridge": "ros2", "command": ["node"], **changed.pop("autonomy", {})}
    _, found = parse_campaign(
        {"campaign": "c", "matrix": {"weather": ["clear"]}, "autonomy": autonomy, **changed}
    )
    return [f"{each.path}: {each.message}" for each in found]


def test_a_campaign_says_what_it_needs():
    assert mistakes() == []
    assert mistakes(autonomy={"slots": 2}) == ["autonomy.slots: given 2, a bridge drives 1"]
    assert mistakes(autonomy={"parameters": {"answer": "newest"}}) == [
        "autonomy.parameters.answer: given 'newest', which waits for nobody; "
        "it needs clock: realtime"
    ]
    assert mistakes(clock="realtime", autonomy={"parameters": {"answer": "newest"}}) == []
    assert mistakes(autonomy={"command": []}) == [
        "autonomy.bridge: needs the command that starts the script, or parameters.keys, if "
        "somebody else starts it"
    ]
    alone = {"command": [], "parameters": {"keys": "autoware"}}
    assert mistakes(autonomy=alone) == [
        "autonomy.sandbox: nobody outside reaches a bridge in a sandbox; set it to off, or give a "
        "command"
    ]
    assert mistakes(autonomy={**alone, "sandbox": "off"}) == []


def test_without_a_command_the_bridge_is_the_stack():
    alone = {"bridge": "ros2", "parameters": {"keys": "autoware"}, "sandbox": "off"}
    campaign, _ = parse_campaign(
        {"campaign": "c", "matrix": {"weather": ["clear"]}, "autonomy": alone}
    )
    (case,) = expand(campaign)
    assert (case.rig.stack, case.rig.foreign, case.rig.slots) == (
        "devkit.bridges.ros2:Ros2Bridge",
        None,
        1,
    )


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"table": "autware"}, "topic table 'autware' given, allowed: autoware, nav2, plain"),
        ({"domain": 233}, "autonomy.parameters: domain: given 233"),
        ({"rmw_zenoh": "humble"}, "autonomy.parameters: rmw_zenoh: given 'humble', allowed: "),
        ({"command": "/a b"}, "given the name '/a b', allowed: letters"),
        ({"wait_for": "/clock //x"}, "given the name '//x'"),
        ({"keys": "../x"}, "autonomy.parameters: keys"),
        ({"throttle_gain": -1.0}, "autonomy.parameters: throttle_gain: given -1"),
        ({"tabel": "plain"}, "unknown parameter 'tabel'"),
    ],
)
def test_a_bad_parameter_is_one_line(parameters, reason):
    with pytest.raises(StackError, match=reason.replace("(", r"\(")) as found:
        load_stack("devkit.bridges.ros2:Ros2Bridge", 1, parameters)
    assert "\n" not in str(found.value)


def test_it_drives_one_car():
    with pytest.raises(StackError, match="the bridge drives one car; set slots: 1"):
        load_stack("devkit.bridges.ros2:Ros2Bridge", 2, {})


def test_stamps_are_asked_of_types_that_have_one(tmp_path):
    table = tmp_path / "mine.yaml"
    table.write_text(
        "table: mine\nsensors: [{topic: /clock, source: clock}]\n"
        "commands: [{topic: /cmd_vel, type: geometry_msgs/msg/Twist}]\n"
    )
    with pytest.raises(StackError, match=r"Twist on /cmd_vel has no stamp; take a stamped type"):
        load_stack("devkit.bridges.ros2:Ros2Bridge", 1, {"table": str(table)})
    load_stack("devkit.bridges.ros2:Ros2Bridge", 1, {"table": str(table), "answer": "step"})


def test_the_command_may_have_another_topic():
    table = with_command(load_table("nav2"), "/my/cmd")
    assert (table.driving().topic, table.driving().type) == (
        "/my/cmd",
        "geometry_msgs/msg/TwistStamped",
    )
    with pytest.raises(NameMistakeError):
        with_command(load_table("nav2"), "/my cmd")


def test_nobody_could_reach_a_bridge_without_a_command_or_keys():
    with pytest.raises(StackFaultError, match="no command and no parameter keys"):
        Ros2Bridge(1).attach(None)
