"""Weather and light of a case while it runs."""

import numpy as np
import pytest

from schemas.plan import parse_plan
from twin.world.scene import Origin
from twin.world.sky.environment import CaseEnvironment
from twin.world.sky.weather import WEATHER, WEATHER_AUTODRIVE, blended

PLACE = Origin(latitude_deg=34.8, longitude_deg=-82.32, heading_deg=90.0)
S = 1_000_000_000


def case(weather="clear", time_of_day="12:00", **environment):
    matrix = {"weather": [weather], "time_of_day": [time_of_day]}
    data = {"campaign": "c", "environment": environment, "matrix": matrix}
    plan, mistakes = parse_plan(data)
    assert mistakes == []
    return plan.cases[0]


def test_without_changes_it_stays_and_costs_nothing():
    environment = CaseEnvironment(case(), PLACE)
    assert not environment.changes
    first = environment.at(0)
    assert first[0] == WEATHER["clear"]
    assert environment.at(50 * S)[1] is first[1]


def test_a_change_runs_on_a_straight_line_and_stays():
    timeline = [
        {"at_s": 10, "over_s": 20, "weather": "heavy_fog"},
        {"at_s": 40, "weather": "cloudy"},
    ]
    environment = CaseEnvironment(case(timeline=timeline), PLACE)
    assert environment.changes
    a, b = WEATHER["clear"], WEATHER["heavy_fog"]
    expected = {0: a, 10: a, 15: blended(a, b, 0.25), 20: blended(a, b, 0.5), 30: b, 39: b}
    expected |= {40: WEATHER["cloudy"], 90: WEATHER["cloudy"]}
    for second, weather in expected.items():
        assert environment.at(second * S)[0] == weather
    assert environment.at(20 * S)[0] == blended(a, b, 0.5)  # also backwards


def test_the_clock_runs_forward_even_over_midnight():
    timeline = [{"at_s": 0, "over_s": 60, "time_of_day": "01:00"}]
    environment = CaseEnvironment(case(time_of_day="21:00", timeline=timeline), PLACE)
    still = {
        time: CaseEnvironment(case(time_of_day=time), PLACE).at(0)[1].sun_direction
        for time in ("21:00", "22:00", "23:00")
    }
    np.testing.assert_array_equal(environment.at(0)[1].sun_direction, still["21:00"])
    np.testing.assert_array_equal(environment.at(15 * S)[1].sun_direction, still["22:00"])
    np.testing.assert_array_equal(environment.at(30 * S)[1].sun_direction, still["23:00"])
    late = environment.at(61 * S)[1].sun_direction
    next_day = CaseEnvironment(case(time_of_day="01:00", date="2025-03-21"), PLACE).at(0)[1]
    np.testing.assert_array_equal(late, next_day.sun_direction)


def test_family_sun_exposure_and_road_are_the_cases():
    chosen = case(
        "light_snow", family="autodrive", sun="autodrive", exposure_ev100=10.0, friction=0.4
    )
    weather, light = CaseEnvironment(chosen, PLACE).at(0)
    assert weather.extinction_per_m == WEATHER_AUTODRIVE["light_snow"].extinction_per_m
    assert weather.friction == 0.4
    assert light.sun_direction[2] == 1.0
    assert light.exposure == pytest.approx(1 / (1.2 * 1024), rel=1e-5)


def test_custom_weathers_and_the_winds_direction():
    chosen = case("gale", custom={"gale": {"cloud": 0.5, "wind": 1.0}}, wind_from_deg=270.0)
    environment = CaseEnvironment(chosen, PLACE)  # the street runs east
    assert environment.wind_towards == (1.0, 0.0)
    assert environment.at(0)[0].wind_mps == pytest.approx(22.6, abs=0.1)
    north = CaseEnvironment(case(wind_from_deg=180.0), PLACE)
    assert north.wind_towards == (0.0, 1.0)  # to the left


def test_the_light_follows_the_weather_at_the_same_hour():
    timeline = [{"at_s": 10, "weather": "heavy_fog"}]
    environment = CaseEnvironment(case(timeline=timeline), PLACE)
    clear, fog = environment.at(0)[1], environment.at(20 * S)[1]
    alone = CaseEnvironment(case("heavy_fog"), PLACE).at(0)[1]
    assert fog.exposure == alone.exposure != clear.exposure
    np.testing.assert_array_equal(fog.sun_rgb_lx, alone.sun_rgb_lx)
