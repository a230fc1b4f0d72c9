"""Daylight: order and limits that follow from physics, and the sky's table behind it."""

import math

import numpy as np
import pytest

from schemas.steady import steady
from twin.world.sky import atmosphere, sky_table
from twin.world.sky.atmosphere import LUMINANCE, SUN_LX, SUN_RGB
from twin.world.sky.sun import (
    EXPOSURE_FLOOR_LX,
    WHITE_SIGNAL,
    daylight,
    twilight_lx,
)
from twin.world.sky.weather import WEATHER, blended

CLEAR_LEVEL = atmosphere.haze_level(0.88e-4)


def test_light_grows_to_noon_and_falls_with_clouds():
    clear = [daylight(m, WEATHER["clear"]).illuminance_lx for m in range(300, 741, 20)]
    assert clear == sorted(clear)
    assert 60_000 < clear[-1] < 120_000
    for minute in (420, 720, 1020):
        overcast = daylight(minute, WEATHER["heavy_rain"])
        assert overcast.illuminance_lx < daylight(minute, WEATHER["clear"]).illuminance_lx
        assert not overcast.shadows
        assert not overcast.sun_rgb_lx.any()


def test_clouds_close_without_a_step():
    steps = [
        daylight(720, blended(WEATHER["clear"], WEATHER["heavy_rain"], i / 200)) for i in range(201)
    ]
    total = np.array([s.illuminance_lx for s in steps])
    assert np.diff(np.log(total)).max() < 0.001  # it darkens all the way, or stays
    assert np.abs(np.diff(np.log(total))).max() < 0.06
    exposure = np.array([s.exposure for s in steps])
    assert np.abs(np.diff(np.log(exposure))).max() < 0.06
    shadows = [s.shadows for s in steps]
    assert shadows == sorted(shadows, reverse=True)
    assert shadows[0] > shadows[-1]


def test_nights_are_dark_and_exposure_is_clamped():
    floor = daylight(0, WEATHER["clear"])
    for minute in (0, 300, 1200):
        night = daylight(minute, WEATHER["clear"])
        assert night.illuminance_lx < 1
        assert night.lamps_on
        assert night.exposure == floor.exposure
        assert night.exposure == pytest.approx(math.pi * WHITE_SIGNAL / EXPOSURE_FLOOR_LX, rel=1e-5)
    assert not daylight(720, WEATHER["clear"]).lamps_on
    assert daylight(720, WEATHER["clear"]).exposure < floor.exposure / 100


def test_fixed_exposure_saturates_where_iso_says():
    for minute in (0, 720):
        light = daylight(minute, WEATHER["clear"], exposure_ev100=12.0)
        assert light.exposure * 1.2 * 2.0**12 == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize(("elevation", "lux"), [(0, 759), (-6, 3.4), (-12, 0.0083), (-18, 6.5e-4)])
def test_twilight_is_the_naval_observatorys(elevation, lux):
    assert twilight_lx(elevation) == pytest.approx(lux, rel=0.05)


def test_twilight_has_no_steps():
    values = [math.log(twilight_lx(-i / 50)) for i in range(900)]
    assert np.diff(values).max() < 0
    assert np.abs(np.diff(values)).max() < 0.05


def ies(elevation_rad):
    """Clear diffuse and direct normal illuminance of the IES [lx]."""
    degrees = math.degrees(elevation_rad)
    mass = 1.0 / (math.sin(elevation_rad) + 0.15 * (degrees + 3.885) ** -1.253)
    return 800 + 15_500 * math.sqrt(math.sin(elevation_rad)), 127_500 * math.exp(-0.21 * mass)


@pytest.mark.parametrize("degrees", [7, 10, 15, 20, 30, 45, 60, 80])
def test_the_atmosphere_agrees_with_measured_availability(degrees):
    """Unscaled: 25 % in skylight, 15 % in the beam, at the two hazes of clear days."""
    elevation = math.radians(degrees)
    diffuse_lx, direct_lx = ies(elevation)
    sun = np.array([math.cos(elevation), 0.0, math.sin(elevation)])
    found = []
    for level in (CLEAR_LEVEL, CLEAR_LEVEL + 1):
        sky = sky_table.clear(sun, elevation, level) * SUN_RGB * SUN_LX
        found.append(float(sky_table.illuminance_rgb(sky) @ LUMINANCE))
    beam = float(SUN_RGB * SUN_LX * atmosphere.sunlight_left(elevation, CLEAR_LEVEL) @ LUMINANCE)
    assert min(abs(f / diffuse_lx - 1.0) for f in found) < 0.25
    assert beam == pytest.approx(direct_lx, rel=0.15)


@pytest.mark.parametrize(("degrees", "factor"), [(0, 1.5), (-2, 2.0), (-4, 2.0), (-6, 2.5)])
def test_the_atmosphere_follows_twilight_below_the_horizon(degrees, factor):
    """What Preetham and Hosek-Wilkie have no values for."""
    elevation = math.radians(degrees)
    sun = np.array([math.cos(elevation), 0.0, math.sin(elevation)])
    sky = sky_table.clear(sun, elevation, CLEAR_LEVEL) * SUN_RGB * SUN_LX
    lux = float(sky_table.illuminance_rgb(sky) @ LUMINANCE)
    assert 1 / factor < lux / twilight_lx(degrees) < factor


@pytest.mark.slow
def test_the_sky_moves_without_steps_through_sunset():
    tables = []
    for tenth in range(40, -91, -1):
        elevation = math.radians(tenth / 10)
        sun = np.array([math.cos(elevation), 0.0, math.sin(elevation)])
        tables.append(sky_table.clear(sun, elevation, CLEAR_LEVEL) @ LUMINANCE)
    zenith = np.array([t[-1, 0] for t in tables])
    assert (np.diff(zenith) < 0).all()
    assert np.abs(np.diff(np.log(zenith))).max() < 0.15  # twilight itself falls by 0.1


def test_colours_of_the_sky():
    noon = daylight(740, WEATHER["clear"])
    zenith = noon.zenith_rgb / (noon.zenith_rgb @ LUMINANCE)
    assert zenith[2] > 1.2 > 1.0 > zenith[0]
    rise = daylight(405, WEATHER["clear"])  # the sun stands 2 deg over the horizon, ahead
    ahead = int(np.argmax(sky_table.HEADING[:, 0]))
    low = rise.sky[1, ahead]
    assert low[0] > 1.5 * low[1] > 3 * low[2]  # orange
    behind = rise.sky[1, (ahead + 32) % 64]
    assert low.sum() > 3 * behind.sum()
    dusk = daylight(1145, WEATHER["clear"])
    blue = dusk.zenith_rgb / (dusk.zenith_rgb @ LUMINANCE)
    assert blue[2] > 1.6
    assert blue[0] < 0.9  # blue, not purple


def test_skies_give_the_ground_what_they_say():
    for name in WEATHER:
        for minute in (0, 390, 720, 1140):
            light = daylight(minute, WEATHER[name])
            found = sky_table.illuminance_rgb(light.sky.astype(float))
            np.testing.assert_allclose(found, light.sky_rgb_lx, rtol=1e-4)
    noon = daylight(740, WEATHER["clear"])
    diffuse_lx, _ = ies(math.asin(noon.sun_direction[2]))
    assert noon.sky_rgb_lx @ LUMINANCE == pytest.approx(diffuse_lx, rel=0.15)


def test_overcast_is_three_times_as_bright_at_the_zenith():
    table = sky_table.overcast(np.ones(3), 10_000.0)
    assert table[-1, 0, 1] / table[0, 0, 1] == pytest.approx(3.0)
    assert sky_table.illuminance_rgb(table)[1] == pytest.approx(10_000.0)
    assert table[-1, 0, 1] == pytest.approx(9 * 10_000 / (7 * math.pi), rel=2e-3)
    sky = daylight(720, WEATHER["heavy_rain"]).sky
    assert sky[-1].mean() / sky[0].mean() == pytest.approx(3.0, rel=0.02)


def test_integration_over_the_table_is_right():
    assert sky_table.illuminance_rgb(np.ones((32, 64, 3)))[0] == pytest.approx(math.pi, rel=1e-3)


def test_the_moon_lights_its_nights():
    # The full moon of 2025-03-14 stands high at midnight, the new moon of 29 does not.
    full = daylight(60, WEATHER["clear"], date="2025-03-14")
    new = daylight(60, WEATHER["clear"], date="2025-03-29")
    assert full.moon_direction[2] > 0.5
    assert full.moon_rgb.max() > 1000
    assert 0.1 < full.illuminance_lx - new.illuminance_lx < 0.4
    assert not new.moon_rgb.any()


def test_parity_mode_rises_at_six_and_culminates_at_noon():
    for minute, height in ((360, 0.0), (720, 1.0), (1080, 0.0)):
        light = daylight(minute, WEATHER["clear"], mode="autodrive")
        assert light.sun_direction[2] == pytest.approx(height, abs=1e-5)


def test_steady_numbers_forget_their_last_bits():
    values = np.array([math.pi, -1e-7, 0.0, 6e8, 1.0])
    assert steady(values).tobytes() == steady(values * (1 + 1e-12)).tobytes()
    np.testing.assert_allclose(steady(values), values, rtol=4e-6)
