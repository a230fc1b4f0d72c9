"""The section ``sensors`` of a campaign file."""

import copy
from pathlib import Path

import msgspec
import pytest

from conductor.run.source import check
from schemas import messages
from schemas.axes import axes_allowed
from schemas.case import Variation
from schemas.identity import case_digest, rig_key
from schemas.kinds.sensor import sensor_kinds
from schemas.kinds.sensors.gnss import Gnss
from schemas.kinds.sensors.imu import Imu
from schemas.plan import expand, parse_campaign, parse_plan
from schemas.sections import sensors as section
from schemas.sections.sensors import Sensors
from schemas.wire import topics

GOOD = {"campaign": "c", "matrix": {"weather": ["clear"]}}


def cases(sensors, **more):
    plan, mistakes = parse_plan({**copy.deepcopy(GOOD), "sensors": sensors, **more})
    assert plan is not None, mistakes
    return plan.cases


def test_a_sensor_that_is_not_named_is_not_there():
    assert cases({})[0].variation.sensors.rates(20) == {}
    one = cases({"imu": {}, "gnss": {}})[0].variation.sensors
    assert one.rates(20) == {"gnss": 10, "imu": 20}
    assert cases({"imu": {"on": False}})[0].variation.sensors.rates(20) == {}
    assert (one.gnss, one.imu) == (Gnss(), Imu())


def test_a_sensor_that_is_shipped_later_is_in_no_digest_that_does_not_use_it(monkeypatch):
    monkeypatch.setattr(section, "FIRST", ("encoders",))
    table = [section.field_of(kind) for kind in sensor_kinds().declared]
    fields = [name for name, _, default in table if default is not msgspec.UNSET]
    assert fields == ["encoders"]
    later = msgspec.defstruct("Later", table, module=section.__name__)
    assert set(msgspec.to_builtins(later())) == {"encoders"}
    assert later(imu=Imu()).imu == Imu()


@pytest.mark.parametrize(
    ("change", "path", "words"),
    [
        ({"sensors": {"gps": {}}}, "sensors.gps", ["unknown key", "encoders, gnss, imu"]),
        ({"sensors": {"imu": None}}, "sensors.imu", ["given nothing", "mapping", "accel_noise"]),
        (
            {"sensors": {"imu": {"gyro_bias_dps": 1}}},
            "sensors.imu.gyro_bias_dps",
            ["did you mean 'gyro_bias_degps'?", "accel_noise_mps2_per_sqrt_hz"],
        ),
        ({"sensors": {"imu": {"gyro_bias_degps": -1}}}, "sensors.imu.gyro_bias_degps", [">= 0"]),
        ({"sensors": {"gnss": {"hz": 7}}}, "sensors.gnss.hz", ["given 7", "divisor of control_hz"]),
        ({"sensors": {"gnss": {"hz": 40}}}, "sensors.gnss.hz", ["divisor of control_hz 20"]),
        ({"sensors": {"encoders": {"ppr": 0}}}, "sensors.encoders.ppr", ["given 0", ">= 1"]),
        ({"sensors": {"encoders": {"cgr": 0}}}, "sensors.encoders.cgr", ["given 0", "> 0"]),
        (
            {"matrix": {"sensors.gnss.noise_horizontal_m": [0.5]}},
            "matrix.sensors.gnss",
            ["gnss is off", "add 'gnss: {}' to sensors"],
        ),
        (
            {"sensors": {"radar_cube": {}}},
            "sensors.radar_cube",
            ["is made of what radar measures", "add 'radar: {}' to sensors"],
        ),
        (
            {"sensors": {"radar_cube": {}, "radar": {"on": False}}},
            "sensors.radar_cube",
            ["add 'radar: {}' to sensors"],
        ),
        (
            {"sensors": {"radar_cube": {"hz": 20}, "radar": {"hz": 10}}},
            "sensors.radar_cube.hz",
            ["given 20", "a divisor of sensors.radar.hz 10"],
        ),
        ({"matrix": {"sensors.gnss.hzz": [1]}}, "matrix.sensors.gnss.hzz", ["sensors.gnss.hz"]),
    ],
)
def test_mistakes(change, path, words):
    campaign, mistakes = check({**copy.deepcopy(GOOD), **change})
    assert campaign is None
    assert [m.path for m in mistakes] == [path], mistakes
    for word in words:
        assert word in mistakes[0].message


def test_errors_are_axes_and_share_a_rig_but_not_an_identity():
    noises = {"sensors.gnss.noise_horizontal_m": [0.1, 5.0], "sensors.imu.noise": [True, False]}
    found = cases({"gnss": {}, "imu": {}}, matrix=noises)
    assert found[0].id == "gnss.noise_horizontal_m_0.1-imu.noise_true"
    assert [c.variation.sensors.gnss.noise_horizontal_m for c in found] == [0.1, 0.1, 5.0, 5.0]
    assert len({rig_key(c) for c in found}) == 1
    assert len({case_digest(c) for c in found}) == 4


def test_rates_and_presence_need_another_rig():
    matrix = {"sensors.gnss.on": [True, False], "sensors.imu.hz": [10, 20]}
    found = cases({"gnss": {}, "imu": {}}, matrix=matrix)
    assert len({rig_key(c) for c in found}) == 4
    assert rig_key(cases({"imu": {}})[0]) == rig_key(cases({"imu": {"hz": 20}})[0])


def test_axes_are_listed_and_lists_are_none():
    allowed = axes_allowed()
    assert {"sensors.encoders.ppr", "sensors.gnss.on", "sensors.imu.gyro_scale"} <= set(allowed)
    assert "sensors.gnss.antenna_m" not in allowed


def test_cases_without_the_section_still_decode():
    """Of what only some cases need, the defaults are left out."""
    campaign, _ = parse_campaign(GOOD)
    plain = msgspec.to_builtins(expand(campaign)[0].variation)
    del plain["sensors"]
    assert msgspec.convert(plain, Variation).sensors == Sensors()


def test_every_column_of_every_sensor_is_documented():
    text = (Path(__file__).parents[4] / "docs" / "stack.md").read_text()
    for name, topic in topics.SENSORS.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
        columns = topic.type.split()[0]
        for column in getattr(messages, columns, ()):
            assert f"`{column}`" in row, (name, column)
        if hasattr(messages, columns):
            dtype, count = topic.type.split()[-1], len(getattr(messages, columns))
            assert row.split("|")[2].strip().startswith(dtype)
            assert f", {count}]" in row
