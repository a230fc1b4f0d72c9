"""Weather, light and road that a scenario sets, against those of the campaign."""

import math

import numpy as np
import pytest

from schemas.plan import parse_plan
from schemas.sections.environment import Environment
from schemas.wire.interventions import SetEnvironment
from twin.world.scene import Origin
from twin.world.sky.environment import CaseEnvironment, light_of
from twin.world.sky.scripted import FRICTION_LIMITS, ScriptedEnvironment
from twin.world.sky.weather import (
    AIR_PER_M,
    MOR_PER_EXTINCTION,
    PRESETS,
    WEATHER,
    fog_extinction_per_m,
    with_parts,
)

PLACE = Origin(latitude_deg=48.0, longitude_deg=11.0, heading_deg=90.0)
NOON = 720.0


def case_environment(weather="clear", time_of_day="12:00", **environment):
    matrix = {"weather": [weather], "time_of_day": [time_of_day]}
    plan, mistakes = parse_plan({"campaign": "c", "environment": environment, "matrix": matrix})
    assert mistakes == []
    return CaseEnvironment(plan.cases[0], PLACE)


def scripted(**values):
    environment = case_environment()
    environment.script(ScriptedEnvironment(**values))
    return environment.at(0)


def light_under(**values):
    said = ScriptedEnvironment(**values)
    return light_of(Environment(), PLACE, NOON, WEATHER["clear"], said)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_a_weather_in_parts_is_the_weather(name):
    weather = WEATHER[name]
    again = with_parts(
        weather, fog_extinction_per_m(weather), weather.rain_mm_per_h, weather.snow_mm_per_h
    )
    for field in weather.__slots__:
        assert getattr(again, field) == pytest.approx(getattr(weather, field), rel=1e-4), field


def test_what_is_not_said_stays_as_the_campaign_has_it():
    before = case_environment("heavy_rain", "18:00")
    weather, light = before.at(0)
    before.script(ScriptedEnvironment())
    assert before.at(0)[0] == weather
    np.testing.assert_array_equal(before.at(0)[1].sky, light.sky)
    assert before.shown == "heavy_rain"


def test_fog_is_as_thick_as_its_visual_range():
    weather, _ = scripted(fog_visual_range_m=100.0)
    assert weather.extinction_per_m == pytest.approx(MOR_PER_EXTINCTION / 100.0, rel=1e-6)
    assert weather.mor_m == pytest.approx(100.0, rel=1e-6)
    clear, _ = scripted(fog_visual_range_m=1e6)
    assert clear.extinction_per_m == pytest.approx(AIR_PER_M, rel=1e-6)
    closed, _ = scripted(fog_visual_range_m=0.0)
    assert closed.mor_m == pytest.approx(1.0, rel=1e-6)


def test_rain_and_snow_change_sight_road_and_sky_together():
    rain, _ = scripted(rain_mm_per_h=25.0, snow_mm_per_h=0.0)
    heavy = WEATHER["heavy_rain"]
    for field in ("extinction_per_m", "rain", "wetness", "friction", "water_mm", "sky_factor"):
        assert getattr(rain, field) == pytest.approx(getattr(heavy, field), rel=1e-4), field
    snow, _ = scripted(rain_mm_per_h=0.0, snow_mm_per_h=WEATHER["heavy_snow"].snow_mm_per_h)
    assert snow.snow_cover == pytest.approx(0.95, abs=1e-4)
    assert snow.friction == pytest.approx(0.2, abs=1e-4)
    worse, _ = scripted(rain_mm_per_h=100.0, snow_mm_per_h=0.0)
    assert worse.rain_mm_per_h == 100.0
    assert worse.extinction_per_m > 2.0 * heavy.extinction_per_m
    assert worse.friction == heavy.friction


def test_dry_means_dry_in_any_weather_of_the_campaign():
    environment = case_environment("heavy_rain")
    environment.script(ScriptedEnvironment(rain_mm_per_h=0.0, snow_mm_per_h=0.0))
    weather, _ = environment.at(0)
    assert (weather.rain, weather.wetness) == (0.0, 0.0)
    assert weather.friction == WEATHER["clear"].friction
    assert weather.cloud_cover == WEATHER["heavy_rain"].cloud_cover
    assert weather.wind_mps == WEATHER["heavy_rain"].wind_mps
    assert environment.shown == ""


def test_the_roads_friction_is_scaled_and_stays_a_road():
    base = WEATHER["clear"].friction
    assert scripted(friction_factor=0.5)[0].friction == 0.5 * base
    assert scripted(friction_factor=0.0)[0].friction == FRICTION_LIMITS[0]
    assert scripted(friction_factor=100.0)[0].friction == FRICTION_LIMITS[1]
    wet, _ = scripted(water_mm=1.0, friction_factor=1.0)
    assert (wet.wetness, wet.friction) == (1.0, base)
    own = case_environment(friction=0.4)
    own.script(ScriptedEnvironment(friction_factor=0.5, rain_mm_per_h=25.0, snow_mm_per_h=0.0))
    assert own.at(0)[0].friction == 0.2


def test_wind_blows_where_the_scenario_says():
    environment = case_environment(wind_from_deg=270.0)
    assert environment.wind_towards == (1.0, 0.0)
    environment.script(ScriptedEnvironment(wind_direction_rad=math.pi / 2, wind_speed_mps=10.0))
    assert environment.wind_towards == (0.0, 1.0)
    weather, _ = environment.at(0)
    assert (weather.wind_mps, weather.gust_mps) == (10.0, pytest.approx(2.0, rel=1e-6))


def test_the_sun_stands_where_the_scenario_has_it():
    # x points east, so north is y; an azimuth of a quarter turn to the left of north is west.
    up = math.radians(30.0)
    west = light_under(sun_azimuth_rad=math.pi / 2, sun_elevation_rad=up)
    np.testing.assert_allclose(west.sun_direction, (-math.cos(up), 0.0, 0.5), atol=1e-5)
    south = light_under(sun_azimuth_rad=math.pi, sun_elevation_rad=up)
    np.testing.assert_allclose(south.sun_direction, (0.0, -math.cos(up), 0.5), atol=1e-5)


@pytest.mark.parametrize("light_lx", [1.5, 400.0, 20_000.0])
def test_a_sun_of_less_light_stands_lower(light_lx):
    said = {"sun_azimuth_rad": 3.0, "sun_elevation_rad": 1.1, "sun_illuminance_lx": light_lx}
    light = light_of(
        Environment(),
        PLACE,
        NOON,
        with_clouds(0.0),
        ScriptedEnvironment(**said),
    )
    assert light.illuminance_lx == pytest.approx(light_lx, rel=0.02)
    assert light.lamps_on == (light_lx < 60.0)


def test_a_sun_of_moonlight_is_the_moon():
    said = {"sun_azimuth_rad": 3.0, "sun_elevation_rad": 1.1, "sun_illuminance_lx": 0.1}
    light = light_under(**said)
    assert light.lamps_on
    assert light.sun_direction[2] < -0.3
    assert light.moon_direction[2] == pytest.approx(math.sin(1.1), abs=1e-5)
    assert 0.05 < light.illuminance_lx < 0.2


def with_clouds(cover):
    environment = case_environment()
    environment.script(ScriptedEnvironment(cloud_fraction=cover))
    return environment.at(0)[0]


def test_the_clock_is_the_scenarios():
    eight = 8 * 3600.0 + 20 * 86_400.0  # 21 January 1970
    said = ScriptedEnvironment(clock_s=eight)
    assert said.minute == 480.0
    own = case_environment(time_of_day="08:00", date="1970-01-21").at(0)[1]
    environment = case_environment(time_of_day="23:00")
    environment.script(said)
    np.testing.assert_array_equal(environment.at(0)[1].sun_direction, own.sun_direction)
    assert environment.clock_min(0) == 480.0


def test_an_hour_without_a_date_is_of_the_campaigns_day():
    own = case_environment(time_of_day="08:00", date="2025-07-01").at(0)[1]
    environment = case_environment(time_of_day="23:00", date="2025-07-01")
    environment.script(ScriptedEnvironment(minute_of_day=480.0))
    np.testing.assert_array_equal(environment.at(0)[1].sun_direction, own.sun_direction)
    dated = ScriptedEnvironment(clock_s=1e9).then(ScriptedEnvironment(minute_of_day=480.0))
    assert (dated.clock_s, dated.minute) == (None, 480.0)


def test_later_words_go_before_and_time_moves_the_sun_again():
    sun = ScriptedEnvironment(
        sun_azimuth_rad=1.0, sun_elevation_rad=0.5, sun_illuminance_lx=9.0, friction_factor=0.7
    )
    rain = sun.then(ScriptedEnvironment(rain_mm_per_h=3.0, snow_mm_per_h=0.0))
    assert (rain.sun_elevation_rad, rain.friction_factor, rain.rain_mm_per_h) == (0.5, 0.7, 3.0)
    brighter = rain.then(ScriptedEnvironment(sun_azimuth_rad=2.0, sun_elevation_rad=0.6))
    assert (brighter.sun_elevation_rad, brighter.sun_illuminance_lx) == (0.6, None)
    later = rain.then(ScriptedEnvironment(clock_s=100.0))
    assert (later.sun_elevation_rad, later.clock_s, later.rain_mm_per_h) == (None, 100.0, 3.0)


def test_an_intervention_goes_before_the_scenario():
    environment = case_environment()
    environment.script(ScriptedEnvironment(fog_visual_range_m=50.0, clock_s=0.0))
    environment.override(SetEnvironment(weather="heavy_rain", time_of_day_min=600.0))
    weather, _ = environment.at(0)
    assert weather == WEATHER["heavy_rain"]
    assert environment.clock_min(0) == 600.0
    assert environment.shown == "heavy_rain"
    environment.script(None)
    assert environment.at(0)[0] == WEATHER["heavy_rain"]
