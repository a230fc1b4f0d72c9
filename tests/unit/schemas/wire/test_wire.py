"""The wire codec: one validation path, bounded, versioned."""

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import SCHEMA_VERSION
from schemas.files.kpi import headlight_code
from schemas.messages import Command, Commands, Detection, Tick, command_mistake
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Beat, Reply, Request


def test_round_trip():
    beat = Beat(v=SCHEMA_VERSION, worker="w", held={"5": 3})
    assert decode(encode(beat), Request) == beat


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not MessagePack"),
        (b"\xc1", "not MessagePack"),
        (b"\x81", "not MessagePack"),
        (msgpack.packb([1, 2]), "not a valid message"),
        (msgpack.packb({"v": SCHEMA_VERSION, "verb": "dance"}), "dance"),
        (msgpack.packb({"v": 99, "verb": "beat"}), "99"),
        (msgpack.packb({"v": SCHEMA_VERSION, "verb": "beat", "worker": 5}), "worker"),
    ],
)
def test_refused_in_one_line(data, words):
    with pytest.raises(WireError, match=words) as error:
        decode(data, Request)
    assert len(str(error.value).splitlines()) == 1


def test_size_limit_is_exact():
    data = encode(Reply(v=SCHEMA_VERSION, epoch=1))
    assert decode(data, Reply, len(data)).epoch == 1
    with pytest.raises(WireError, match="at most"):
        decode(data, Reply, len(data) - 1)


@given(st.binary(max_size=200))
def test_garbage_never_escapes(data):
    for type_ in (Request, Tick, Commands):
        try:
            value = decode(data, type_)
        except WireError as error:
            said = str(error)
        else:
            said = "a value"
            assert decode(encode(value), type_) == value
        assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("values", "mistake"),
    [
        ((0.0, 0.0, 0.0), ""),
        ((1.0, 1.0, 1.5), ""),
        ((float("nan"), 0.0, 0.0), "throttle is nan"),
        ((0.0, 1.0000001, 0.0), "brake is 1.0000001"),
        ((0.0, 0.0, -1.6), "steering_rad is -1.6"),
        ((float("inf"), 0.0, 0.0), "throttle is inf"),
    ],
)
def test_command_ranges(values, mistake):
    assert mistake in command_mistake(Command(0, 0, 0, *values))
    assert bool(mistake) == bool(command_mistake(Command(0, 0, 0, *values)))


@pytest.mark.parametrize(("trigger", "fits"), [(None, True), (0, True), (1, False), (-1, False)])
def test_a_trigger_is_one_of_the_detections(trigger, fits):
    seen = [Detection("car", 0.9, 0.0, 0.0, 9.0, 9.0)]
    command = Command(0, 0, 0, 0.0, 1.0, 0.0, detections=seen, trigger=trigger)
    said = command_mistake(command)
    wrong = f"command trigger is {trigger}, allowed: the place of one of its 1 detections, from 0"
    assert said == ("" if fits else wrong)


def test_headlight_codes_are_the_originals():
    codes = {
        (low, high, parking, fog): headlight_code(low, high, parking, fog)
        for low in (False, True)
        for high in (False, True)
        for parking in (False, True)
        for fog in (False, True)
    }
    assert codes[(False, True, True, False)] == 7  # night: high beam + parking
    assert codes[(True, False, True, True)] == 10  # night in fog
    assert codes[(False, False, True, False)] == 3  # day
    assert codes[(False, False, True, True)] == 9  # day in fog
    assert set(codes.values()) == set(range(12))


@pytest.mark.parametrize("name", ["confidence", "x_px", "y_px", "width_px", "height_px"])
def test_no_number_of_a_detection_may_be_missing(name):
    good = Detection("car", 0.5, 1.0, 2.0, 3.0, 4.0)
    command = Command(0, 0, 0, 0.0, 0.0, 0.0, detections=[good])
    assert command_mistake(command) == ""
    for value in (float("nan"), float("inf")):
        bad = msgspec.structs.replace(good, **{name: value})
        mistake = command_mistake(msgspec.structs.replace(command, detections=[good, bad]))
        assert mistake == f"detection {name} is {value}, allowed: finite numbers"
