"""Weather and daylight: order and limits that follow from physics."""

import math

import numpy as np
import pytest

from schemas.campaign import WEATHERS
from twin.world.sun import EXPOSURE_FLOOR_LX, daylight, sun_direction, sun_elevation_rad
from twin.world.weather import WEATHER


def test_every_weather_has_parameters():
    assert tuple(WEATHER) == WEATHERS


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
def test_mean_free_paths_are_the_originals(name, length_m):
    assert 1.0 / WEATHER[name].extinction_per_m == pytest.approx(length_m)


def test_friction_falls_from_dry_over_wet_to_snow():
    names = ("clear", "light_rain", "heavy_rain", "light_snow", "heavy_snow")
    friction = [WEATHER[n].friction for n in names]
    assert friction == sorted(friction, reverse=True)
    assert len(set(friction)) == len(friction)


def test_sunrise_noon_and_sunset():
    assert sun_elevation_rad(360) == pytest.approx(0.0, abs=1e-12)
    assert sun_elevation_rad(1080) == pytest.approx(0.0, abs=1e-12)
    assert math.degrees(sun_elevation_rad(720)) == pytest.approx(55.0)
    for minute in range(0, 1440, 45):
        direction = sun_direction(minute)
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        assert direction[2] == pytest.approx(math.sin(sun_elevation_rad(minute)))


def test_light_grows_to_noon_and_falls_with_clouds():
    clear = [daylight(m, WEATHER["clear"]).illuminance_lx for m in range(240, 721, 20)]
    assert clear == sorted(clear)
    assert 60_000 < clear[-1] < 120_000
    for minute in (420, 720, 1020):
        overcast = daylight(minute, WEATHER["heavy_rain"])
        assert overcast.illuminance_lx < daylight(minute, WEATHER["clear"]).illuminance_lx
        assert not overcast.shadows
        assert not overcast.sun_rgb_lx.any()


def test_nights_are_dark_and_exposure_is_clamped():
    floor = daylight(0, WEATHER["clear"])
    for minute in (0, 300, 1140):
        night = daylight(minute, WEATHER["clear"])
        assert night.illuminance_lx < 5
        assert night.lamps_on
        assert night.exposure == floor.exposure == math.pi * 0.85 / EXPOSURE_FLOOR_LX
    assert not daylight(720, WEATHER["clear"]).lamps_on
    assert daylight(720, WEATHER["clear"]).exposure < floor.exposure / 100
