"""Weather families: the figures they promise, and smooth ways between them."""

import dataclasses
import math

import numpy as np
import pytest

from schemas.campaign import WEATHERS
from schemas.sections.environment import Conditions, Environment
from twin.world.sky.weather import (
    FAMILIES,
    PRESETS,
    WEATHER,
    WEATHER_AUTODRIVE,
    blended,
    overridden,
    parameters,
    weather_of,
)


def test_every_weather_has_parameters_in_every_family():
    for table in FAMILIES.values():
        assert tuple(table) == WEATHERS
        for weather in table.values():
            for field in dataclasses.fields(weather):
                assert math.isfinite(getattr(weather, field.name)), field.name


def test_physical_fog_rain_and_snow_are_the_literatures():
    assert WEATHER["light_fog"].mor_m == pytest.approx(500.0)
    assert WEATHER["heavy_fog"].mor_m == pytest.approx(120.0)
    assert WEATHER["light_rain"].rain_mm_per_h == pytest.approx(2.0)
    assert WEATHER["heavy_rain"].rain_mm_per_h == pytest.approx(25.0)
    for name, visibility_m in (("light_snow", 3000.0), ("heavy_snow", 400.0)):
        assert 3.912 / WEATHER[name].extinction_per_m == pytest.approx(visibility_m)
    for name in ("light_rain", "heavy_rain"):
        weather = WEATHER[name]
        itu_db_per_km = 1.076 * weather.rain_mm_per_h**0.67
        own = (
            (weather.extinction_per_m - WEATHER["clear"].extinction_per_m)
            * 1000
            * 10
            / math.log(10)
        )
        assert own == pytest.approx(1.5 * itu_db_per_km)
    for name in ("light_snow", "heavy_snow"):
        weather = WEATHER[name]
        own = (
            (weather.extinction_per_m - WEATHER["clear"].extinction_per_m)
            * 1000
            * 10
            / math.log(10)
        )
        assert 5.53 * weather.snow_mm_per_h**1.38 == pytest.approx(own)


def test_physical_friction_is_the_handbooks():
    expected = {"clear": 0.80, "cloudy": 0.80, "light_fog": 0.80, "heavy_fog": 0.80}
    expected |= {"light_rain": 0.65, "heavy_rain": 0.55, "light_snow": 0.30, "heavy_snow": 0.20}
    assert {n: w.friction for n, w in WEATHER.items()} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "length_m"),
    [
        ("light_fog", 150),
        ("heavy_fog", 50),
        ("light_rain", 200),
        ("heavy_rain", 100),
        ("light_snow", 200),
        ("heavy_snow", 100),
    ],
)
def test_autodrives_family_has_its_mean_free_paths_and_a_dry_road(name, length_m):
    weather = WEATHER_AUTODRIVE[name]
    assert 1.0 / weather.extinction_per_m == pytest.approx(length_m)
    assert weather.friction == 0.80
    assert weather.wind_mps == 0.0
    custom = parameters(PRESETS[name], "autodrive")
    assert custom.extinction_per_m == weather.extinction_per_m


@pytest.mark.parametrize("intensity", [0.01, 0.25, 0.5, 0.9, 1.0])
def test_autodrives_custom_fog(intensity):
    weather = parameters(Conditions(fog=intensity), "autodrive")
    assert 1.0 / weather.extinction_per_m == pytest.approx(50 + (1 - intensity) * 200)


@pytest.mark.parametrize("kind", ["fog", "rain", "snow"])
def test_intensities_are_monotone_and_continuous_from_clear_through_the_presets(kind):
    steps = np.linspace(0.0, 1.0, 201)
    rows = [parameters(Conditions(**{kind: float(i)})) for i in steps]
    extinction = np.array([r.extinction_per_m for r in rows])
    friction = np.array([r.friction for r in rows])
    assert (np.diff(extinction) > 0).all()
    assert (np.diff(friction) <= 0).all()
    assert extinction[0] == WEATHER["clear"].extinction_per_m
    assert np.diff(extinction).max() < 0.04 * extinction[-1]
    for i, name in ((100, f"light_{kind}"), (200, f"heavy_{kind}")):
        assert extinction[i] == pytest.approx(WEATHER[name].extinction_per_m)
        assert friction[i] == pytest.approx(WEATHER[name].friction)
        assert rows[i].rain == WEATHER[name].rain
        assert rows[i].snow == WEATHER[name].snow


def test_extinctions_of_combined_weathers_add():
    air = WEATHER["clear"].extinction_per_m
    alone = [parameters(Conditions(**{k: 0.7})).extinction_per_m for k in ("fog", "rain", "snow")]
    both = parameters(Conditions(fog=0.7, rain=0.7, snow=0.7)).extinction_per_m
    assert both - air == pytest.approx(sum(a - air for a in alone))
    assert parameters(Conditions(rain=1.0, snow=0.5)).friction == 0.30


def test_overrides_change_the_road_only():
    rain = WEATHER["light_rain"]
    deep = overridden(rain, None, 2.0)
    assert (deep.water_mm, deep.wetness, deep.friction) == (2.0, 1.0, 0.50)
    assert deep.extinction_per_m == rain.extinction_per_m
    assert overridden(rain, 0.1, None).friction == 0.1
    assert overridden(rain, None, None) == rain
    assert overridden(WEATHER["heavy_snow"], None, 0.1).friction == 0.20


def test_blending_is_linear_between_its_ends():
    a, b = WEATHER["clear"], WEATHER["heavy_rain"]
    assert blended(a, b, 0.0) == a
    assert blended(a, b, 1.0) == b
    middle = blended(a, b, 0.25)
    assert middle.friction == pytest.approx(0.75 * a.friction + 0.25 * b.friction)
    assert middle.extinction_per_m == pytest.approx(
        0.75 * a.extinction_per_m + 0.25 * b.extinction_per_m
    )


def test_unknown_weathers_are_one_line():
    with pytest.raises(ValueError, match="did you mean 'heavy_fog'") as error:
        weather_of("hevy_fog")
    assert "\n" not in str(error.value)
    own = {"drizzle": Conditions(rain=0.2)}
    assert weather_of("drizzle", Environment(custom=own)) == parameters(own["drizzle"])


def test_intensities_of_the_environment_hold_whatever_the_weather():
    as_heavy = weather_of("light_rain", Environment(rain=1.0, cloud=1.0, wind=0.5))
    assert as_heavy == WEATHER["heavy_rain"]
    between = weather_of("clear", Environment(rain=0.75))
    assert WEATHER["light_rain"].rain_mm_per_h < between.rain_mm_per_h < 25.0
    assert between.cloud_cover == WEATHER["clear"].cloud_cover
    assert weather_of("heavy_fog", Environment(fog=0.0)).mor_m > 2000.0
    drizzle = Environment(custom={"drizzle": Conditions(rain=0.2, fog=0.1)}, rain=0.4)
    assert weather_of("drizzle", drizzle) == parameters(Conditions(rain=0.4, fog=0.1))
    shown = weather_of("light_rain", Environment(family="autodrive", rain=1.0))
    assert shown.extinction_per_m > WEATHER_AUTODRIVE["light_rain"].extinction_per_m
