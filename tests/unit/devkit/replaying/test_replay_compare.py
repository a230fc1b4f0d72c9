"""What counts as a difference between two commands."""

import math

import msgspec
import pytest

from devkit.replaying.compare import FIELDS, compared, parse_tolerances
from schemas.messages import Command, Detection, Lights, Pose, SensorErrors
from twin.base.errors import UsageError

PLAIN = Command(slot=0, token=5, tick=3, throttle=0.3, brake=0.0, steering_rad=0.1)
BOX = Detection("car", 0.5, 1.0, 2.0, 3.0, 4.0)
POSE = Pose(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


def changed(**fields):
    return msgspec.structs.replace(PLAIN, **fields)


def rows(pairs, **tolerances):
    found = compared([(tick, one, two) for tick, (one, two) in enumerate(pairs)], tolerances)
    assert [row.field for row in found] == list(FIELDS)
    return {row.field: row for row in found}


def test_every_field_is_compared_alone():
    others = {
        "throttle": changed(throttle=0.31),
        "brake": changed(brake=1.0),
        "steering_rad": changed(steering_rad=-0.1),
        "handbrake": changed(handbrake=0.5),
        "reverse": changed(reverse=True),
        "pose": changed(pose=POSE),
        "aeb": changed(aeb=True),
        "lights": changed(lights=Lights(fog=True)),
        "detections": changed(detections=[BOX]),
        "sensors": changed(sensors=SensorErrors()),
    }
    assert set(others) == set(FIELDS)
    assert set(Command.__struct_fields__) == {
        *FIELDS,
        "slot",
        "token",
        "tick",
        "trigger",
        "warning",
    }
    for name, other in others.items():
        found = rows([(PLAIN, PLAIN), (PLAIN, other), (PLAIN, other)])
        assert {n for n, row in found.items() if row.differ} == {name}
        assert (found[name].differ, found[name].first_tick, found[name].ticks) == (2, 1, 3)
    # Which box it was is told for pictures alone.
    marked = changed(detections=[BOX]), changed(detections=[BOX], trigger=0)
    assert not any(row.differ for row in rows([marked]).values())
    # Whose command it is does not count: another token and slot are another attempt.
    assert not any(r.differ for r in rows([(PLAIN, changed(slot=1, token=9, tick=4))]).values())


def test_a_tolerance_is_the_largest_difference_that_is_none():
    found = rows([(PLAIN, changed(throttle=0.5)), (PLAIN, changed(throttle=0.3))], throttle=0.2)
    assert found["throttle"].differ == 0
    assert found["throttle"].largest == pytest.approx(0.2)
    assert rows([(PLAIN, changed(throttle=0.5))], throttle=0.1)["throttle"].differ == 1
    shifted = msgspec.structs.replace(BOX, x_px=3.0)
    pair = [(changed(detections=[BOX]), changed(detections=[shifted]))]
    assert rows(pair)["detections"].largest == 2.0
    assert rows(pair, detections=2.0)["detections"].differ == 0
    truck = msgspec.structs.replace(BOX, label="truck")
    pair = [(changed(detections=[BOX]), changed(detections=[truck]))]
    assert math.isinf(rows(pair, detections=1e9)["detections"].largest)


def test_poses_are_as_far_apart_as_the_axis_that_differs_most():
    moved = msgspec.structs.replace(POSE, x_m=1.5, y_m=1.0)
    pair = [(changed(pose=POSE), changed(pose=moved))]
    assert rows(pair)["pose"].largest == 1.0
    assert rows(pair, pose=1.0)["pose"].differ == 0
    assert math.isinf(rows([(PLAIN, changed(pose=POSE))], pose=1e9)["pose"].largest)
    assert parse_tolerances(["pose=0.5"]) == {"pose": 0.5}


def test_no_number_equals_itself_and_nothing_else():
    nan = changed(throttle=math.nan)
    assert rows([(nan, nan)])["throttle"].differ == 0
    assert math.isinf(rows([(PLAIN, nan)], throttle=9.0)["throttle"].largest)


def test_tolerances_are_read_or_refused_in_one_line():
    assert parse_tolerances(["throttle=0.5", "detections=2"]) == {"throttle": 0.5, "detections": 2}
    for given, words in (
        ("throtle=1", "did you mean"),
        ("aeb=1", "FIELD=NUMBER"),
        ("throttle", "FIELD=NUMBER"),
        ("brake=x", "a number from 0 on"),
        ("brake=-1", "a number from 0 on"),
        ("brake=nan", "a number from 0 on"),
        ("brake=inf", "a number from 0 on"),
    ):
        with pytest.raises(UsageError, match=words):
            parse_tolerances([given])
