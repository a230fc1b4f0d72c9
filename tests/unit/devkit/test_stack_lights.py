"""devkit.lights: the table and its hysteresis, on the thresholds exactly."""

from __future__ import annotations

import math

import pytest

from devkit.lights import LightsSwitch, Surroundings, choose, sense
from schemas.kpi import headlight_code

SWITCH = LightsSwitch()


@pytest.mark.parametrize(
    ("dark", "fog", "code"),
    [(False, False, 3), (False, True, 9), (True, False, 7), (True, True, 10)],
)
@pytest.mark.parametrize("aeb", [False, True])
def test_table_of_the_original(dark, fog, code, aeb):
    lamps = choose(Surroundings(dark, fog), aeb)
    assert headlight_code(lamps.low, lamps.high, lamps.parking, lamps.fog) == code
    assert lamps.indicators == (3 if aeb else 0)


def dark_after(readings, dark=False):
    state = Surroundings(dark=dark)
    return [(state := sense(state, lx, 0.0, SWITCH)).dark for lx in readings]


def fog_after(readings):
    state = Surroundings()
    return [(state := sense(state, 5e4, per_m, SWITCH)).fog for per_m in readings]


def test_dusk_and_dawn_do_not_flicker():
    readings = [1000.0, math.nextafter(1000.0, 0.0), 1000.0, 1500.0, 2000.0, 2000.1, 1500.0]
    assert dark_after(readings) == [False, True, True, True, True, False, False]


def test_fog_does_not_flicker():
    readings = [0.006, 0.0061, 0.005, 0.0045, 0.0044, 0.005]
    assert fog_after(readings) == [False, True, True, True, False, False]


def test_between_the_thresholds_a_fresh_case_takes_day_and_no_fog():
    assert sense(Surroundings(), 1500.0, 0.005, SWITCH) == Surroundings(False, False)


def test_thresholds_in_the_wrong_order():
    with pytest.raises(ValueError, match="bright_above_lx: given 500, allowed: at least"):
        LightsSwitch(bright_above_lx=500.0)
    with pytest.raises(ValueError, match=r"clear_below_per_m: given 0\.01, allowed: at most"):
        LightsSwitch(clear_below_per_m=0.01)
