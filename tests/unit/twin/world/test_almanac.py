"""Sun and moon against the almanac of the package astral."""

import datetime
import math
from types import SimpleNamespace

import numpy as np
import pytest

from twin.world.sky.almanac import (
    FULL_MOON_LX,
    heavens,
    julian_day,
    moon_illuminance_lx,
    moon_position,
    sun_position,
    utc_offset_h,
)

astral = pytest.importorskip("astral")
sun = pytest.importorskip("astral.sun")
moon = pytest.importorskip("astral.moon")

PLACES = [(34.8, -82.32), (0.0, 0.0), (-33.9, 151.2), (59.3, 18.1), (69.6, 18.9), (-54.8, -68.3)]
DATES = ["1999-12-31", "2024-02-29", "2025-03-20", "2025-06-21", "2025-09-05", "2040-12-21"]


def apart_deg(a, b):
    """Angle between two directions given as (elevation, azimuth) [deg]."""
    vectors = []
    for elevation, azimuth in (a, b):
        h, z = math.radians(elevation), math.radians(azimuth)
        vectors.append([math.cos(h) * math.sin(z), math.cos(h) * math.cos(z), math.sin(h)])
    return math.degrees(math.acos(min(1.0, np.dot(*vectors))))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("date", DATES)
def test_the_sun_stands_where_the_almanac_says(place, date):
    observer = astral.Observer(*place)
    for minute in range(0, 1440, 97):
        when = datetime.datetime.fromisoformat(date).replace(tzinfo=datetime.UTC)
        when += datetime.timedelta(minutes=minute)
        elevation, azimuth = sun_position(julian_day(date, minute), *place)
        assert elevation == pytest.approx(sun.elevation(observer, when), abs=0.1)
        true = (sun.elevation(observer, when), sun.azimuth(observer, when))
        assert apart_deg((elevation, azimuth), true) < 0.1


@pytest.mark.parametrize("place", PLACES)
def test_the_moon_stands_within_a_degree(place):
    observer = astral.Observer(*place)
    worst = 0.0
    for date in DATES:
        for minute in range(0, 1440, 240):
            when = datetime.datetime.fromisoformat(date).replace(tzinfo=datetime.UTC)
            when += datetime.timedelta(minutes=minute)
            elevation, azimuth, _ = moon_position(julian_day(date, minute), *place)
            true = (moon.elevation(observer, when), moon.azimuth(observer, when))
            worst = max(worst, apart_deg((elevation, azimuth), true))
    assert worst < MOON_DEG


MOON_DEG = 1.5
"""Astral's series is as short as ours and leaves out parallax in part: a diameter or three."""


def test_the_moon_is_full_when_the_almanac_says():
    for first in ("2025-01-01", "2031-07-01"):
        day = datetime.date.fromisoformat(first)
        for _ in range(60):
            _, _, angle = moon_position(julian_day(day.isoformat(), 0.0), 0.0, 0.0)
            age = moon.phase(day)  # 0 new, 14 full, up to 28
            elongation = min(age, 28 - age) / 14.0 * 180.0
            assert abs((180.0 - angle) - elongation) < 18.0  # its ages are of whole days
            day += datetime.timedelta(days=1)


def test_known_full_and_new_moons():
    # 2025-03-14 06:55 UTC full, 2025-03-29 10:58 UTC new (NASA, eclipses of that month).
    assert moon_position(julian_day("2025-03-14", 6 * 60 + 55), 0.0, 0.0)[2] < 1.5
    assert moon_position(julian_day("2025-03-29", 10 * 60 + 58), 0.0, 0.0)[2] > 178.5


def test_moonlight_falls_with_its_phase():
    lux = [moon_illuminance_lx(i) for i in range(0, 180, 10)]
    assert lux[0] == FULL_MOON_LX
    assert lux == sorted(lux, reverse=True)
    assert lux[9] == pytest.approx(0.09 * FULL_MOON_LX, rel=0.15)  # a half moon gives a tenth


def test_parity_mode_and_axes():
    east = SimpleNamespace(latitude_deg=34.8, longitude_deg=-82.32, heading_deg=90.0)
    north = SimpleNamespace(latitude_deg=34.8, longitude_deg=-82.32, heading_deg=0.0)
    for minute in range(0, 1440, 60):
        pitch = math.radians(0.25 * minute - 90.0)
        found = heavens(east, "2025-03-20", minute, "autodrive")
        np.testing.assert_allclose(found.sun, [math.cos(pitch), 0, math.sin(pitch)], atol=1e-12)
    assert heavens(east, "2025-03-20", 420).sun[0] > 0.9  # the morning sun is ahead of one who
    assert heavens(north, "2025-03-20", 420).sun[1] < -0.9  # looks east, right of one looking north
    assert utc_offset_h(east) == -5.0
    east.utc_offset_h = -4.0
    assert utc_offset_h(east) == -4.0
