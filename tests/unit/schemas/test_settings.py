"""What people type, and what comes of it."""

import math

import pytest

from schemas.messages import Lights, SensorErrors
from schemas.sections.environment import Conditions
from schemas.settings import actions_of, parse_words
from schemas.wire.interventions import PlaceEgo, SetEnvironment, SetLights, SetPace, SetSensors


def test_every_kind_of_setting():
    words = "weather=heavy_rain hour=22.5 lights=low+left gnss_noise=3 gnss_dropout=true pace=0.5"
    assert actions_of(parse_words([*words.split(), "x_m=-3", "y_m=2", "yaw_deg=90"])) == [
        SetEnvironment("heavy_rain", time_of_day_min=1350.0),
        PlaceEgo(-3.0, 2.0, math.pi / 2),
        SetLights(Lights(low=True, indicators=1)),
        SetSensors(SensorErrors(gnss_noise=3.0, gnss_dropout=True)),
        SetPace(0.5),
    ]
    assert actions_of({"fog": 0.5, "rain": 1}) == [
        SetEnvironment(conditions=Conditions(fog=0.5, rain=1.0))
    ]
    assert actions_of({"lights": "stack", "pace": "max"}) == [SetLights(None), SetPace(None)]
    assert actions_of({"lights": "off"}) == [SetLights(Lights())]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("", "nothing to set; allowed: weather, cloud"),
        ("wether=clear", "unknown setting 'wether'; did you mean 'weather'?"),
        ("weather", "given 'weather', expected KEY=VALUE"),
        ("hour=3 hour=4", "hour is given twice"),
        ("hour=24", "hour: given 24, allowed: 0 to below 24"),
        ("hour=noon", "hour: given 'noon', expected a number"),
        ("fog=1.1", "fog: given 1.1, allowed:"),
        ("fog=nan", "fog: given nan, expected a finite number"),
        ("weather=clear fog=1", "weather and fog exclude each other"),
        ("y_m=1", "a pose needs x_m and y_m; x_m missing"),
        ("x_m=1 y_m=1 speed_mps=-1", "speed_mps: given -1.0, allowed:"),
        ("lights=low+blue", "lights: given 'blue'"),
        ("lights=left+right", "lights: given 'left+right', allowed: one of left, right, hazard"),
        ("imu_noise=1001", "imu_noise: given 1001, allowed: 0 to 1000"),
        ("gnss_dropout=maybe", "gnss_dropout: given maybe, allowed: true, false"),
        ("pace=0", "factor: given 0.0, allowed:"),
    ],
)
def test_mistakes_are_one_line(words, line):
    with pytest.raises(ValueError) as found:
        actions_of(parse_words(words.split()))
    assert str(found.value).startswith(line)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"weather": ""}, "weather: given '', expected a name"),
        ({"weather": 3.0}, "weather: given 3.0, expected a name"),
        ({"hour": True}, "hour: given true, expected a number"),
        ({"pace": False}, "pace: given false, expected a number"),
    ],
)
def test_a_script_may_give_other_types(settings, line):
    with pytest.raises(ValueError) as found:
        actions_of(settings)
    assert str(found.value).startswith(line)
