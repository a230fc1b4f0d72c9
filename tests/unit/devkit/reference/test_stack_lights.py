"""devkit.reference.lights: the table and its hysteresis, on the thresholds exactly."""

from __future__ import annotations

import math

import pytest

from devkit.reference.lights import (
    LightsSwitch,
    LightSurroundings,
    choose,
    code_of,
    name_of,
    of_code,
    sense,
)
from schemas.messages import Lights

SWITCH = LightsSwitch()


@pytest.mark.parametrize(
    ("dark", "fog", "code"),
    [(False, False, 3), (False, True, 9), (True, False, 7), (True, True, 10)],
)
@pytest.mark.parametrize("aeb", [False, True])
def test_table_of_the_original(dark, fog, code, aeb):
    lamps = choose(LightSurroundings(dark, fog), aeb)
    assert code_of(lamps) == code
    assert lamps.indicators == (3 if aeb else 0)


def dark_after(readings, dark=False):
    state = LightSurroundings(dark=dark)
    return [(state := sense(state, lx, 0.0, SWITCH)).dark for lx in readings]


def fog_after(readings):
    state = LightSurroundings()
    return [(state := sense(state, 5e4, per_m, SWITCH)).fog for per_m in readings]


def test_dusk_and_dawn_do_not_flicker():
    readings = [1000.0, math.nextafter(1000.0, 0.0), 1000.0, 1500.0, 2000.0, 2000.1, 1500.0]
    assert dark_after(readings) == [False, True, True, True, True, False, False]


def test_fog_does_not_flicker():
    readings = [0.006, 0.0061, 0.005, 0.0045, 0.0044, 0.005]
    assert fog_after(readings) == [False, True, True, True, False, False]


def test_between_the_thresholds_a_fresh_case_takes_day_and_no_fog():
    assert sense(LightSurroundings(), 1500.0, 0.005, SWITCH) == LightSurroundings(False, False)


def test_thresholds_in_the_wrong_order():
    with pytest.raises(ValueError, match="bright_above_lx: given 500, allowed: at least"):
        LightsSwitch(bright_above_lx=500.0)
    with pytest.raises(ValueError, match=r"clear_below_per_m: given 0\.01, allowed: at most"):
        LightsSwitch(clear_below_per_m=0.01)


# Transcribed from the comments of opencav_aeb.py in AutoDRIVE-Simulator-HPC: 1 low beam, 2 high
# beam, 3 parking lights, 4 fog lights, and what each further code is the sum of.
PUBLISHED = {0: (), 1: (1,), 2: (2,), 3: (3,), 4: (4,), 5: (1, 3), 6: (1, 4), 7: (2, 3)}
PUBLISHED |= {8: (2, 4), 9: (3, 4), 10: (1, 3, 4), 11: (2, 3, 4)}


@pytest.mark.parametrize("code", PUBLISHED)
def test_codes_are_the_published_ones_both_ways(code):
    lamps = Lights(**{name: n in PUBLISHED[code] for n, name in LAMPS.items()})
    assert of_code(code) == lamps
    assert code_of(lamps) == code
    words = [WORDS[n] for n in PUBLISHED[code]]
    assert name_of(code) == (", ".join(words) or "off")


LAMPS = {1: "low", 2: "high", 3: "parking", 4: "fog"}
WORDS = {1: "low beam", 2: "high beam", 3: "parking", 4: "fog"}


def test_high_beam_wins_and_indicators_are_carried():
    assert code_of(Lights(low=True, high=True, parking=True)) == 7
    assert of_code(9, indicators=3) == Lights(parking=True, fog=True, indicators=3)


@pytest.mark.parametrize("code", [-1, 12])
def test_there_are_no_other_codes(code):
    with pytest.raises(ValueError, match=f"headlight code {code}: allowed: 0 to 11"):
        of_code(code)
    with pytest.raises(ValueError, match=f"headlight code {code}"):
        name_of(code)
