"""Latitude and longitude on the map, against the arc of the meridian and conformality."""

from __future__ import annotations

import math

import pytest

from twin.road.opendrive.georeference import projection_of

mpmath = pytest.importorskip("mpmath")

UTM = "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"
AXIS_M, FLATTENING = 6378137.0, 1.0 / 298.257223563
SQUARE = FLATTENING * (2.0 - FLATTENING)


def meridian_m(latitude_rad):
    """From the equator along a meridian of the ellipsoid: the integral of its radius."""
    radius = lambda phi: AXIS_M * (1 - SQUARE) / (1 - SQUARE * mpmath.sin(phi) ** 2) ** 1.5  # noqa: E731
    return float(mpmath.quad(radius, [0, latitude_rad]))


@pytest.mark.parametrize("latitude_deg", [-80.0, -33.9, 0.0, 1e-3, 48.1, 60.0, 84.0])
def test_the_central_meridian_has_the_length_of_the_arc(latitude_deg):
    latitude = math.radians(latitude_deg)
    x, y = projection_of(UTM).place(latitude, math.radians(9.0))
    assert x == pytest.approx(500_000.0, abs=1e-6)
    assert y == pytest.approx(0.9996 * meridian_m(latitude), abs=2e-6)
    tmerc = f"+proj=tmerc +lat_0={latitude_deg} +lon_0=9 +k=1 +x_0=7 +y_0=-3 +ellps=WGS84"
    assert projection_of(tmerc).place(latitude, math.radians(9.0)) == (7.0, -3.0)


@pytest.mark.parametrize("latitude_deg", [-40.0, 5.0, 52.0])
@pytest.mark.parametrize("away_deg", [-4.0, 0.5, 3.0])
def test_it_is_conformal(latitude_deg, away_deg):
    """Steps of one length to the north and to the east are as long and square on the map. A map
    that is conformal and true along the meridian is this one."""
    latitude, longitude = math.radians(latitude_deg), math.radians(9.0 + away_deg)
    across = AXIS_M / math.sqrt(1.0 - SQUARE * math.sin(latitude) ** 2) * math.cos(latitude)
    along = AXIS_M * (1.0 - SQUARE) / (1.0 - SQUARE * math.sin(latitude) ** 2) ** 1.5
    step, place = 100.0, projection_of(UTM).place
    north = [place(latitude + sign * step / along, longitude) for sign in (-1, 1)]
    east = [place(latitude, longitude + sign * step / across) for sign in (-1, 1)]
    to_north = [(b - a) / (2 * step) for a, b in zip(*north, strict=True)]
    to_east = [(b - a) / (2 * step) for a, b in zip(*east, strict=True)]
    assert to_east[0] == pytest.approx(to_north[1], abs=1e-7)
    assert to_east[1] == pytest.approx(-to_north[0], abs=1e-7)
    assert 0.9995 < math.hypot(*to_east) < 1.003


def test_the_south_counts_from_its_own_origin():
    south = projection_of("+proj=utm +zone=32 +south +ellps=GRS80")
    x, y = south.place(0.0, math.radians(9.0))
    assert (x, y) == (500_000.0, 10_000_000.0)


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("", "has no geoReference"),
        ("+proj=longlat +datum=WGS84", "+proj=longlat is not understood"),
        ("+proj=merc +lon_0=0", "+proj=merc is not understood"),
        ('PROJCS["WGS 84"]', "is not understood"),
        ("+proj=utm +zone=61", "+zone=61; 1 to 60"),
        ("+proj=utm", "+zone=; 1 to 60"),
        ("+proj=tmerc +lat_0=x", "+lat_0=x, which is no number"),
        ("+proj=tmerc +k=0", "the scale 0"),
        ("+proj=tmerc +ellps=bessel", "ellipsoid bessel"),
        ("+proj=tmerc +datum=potsdam", "datum potsdam"),
        ("+proj=tmerc +units=us-ft", "other units"),
        ("+proj=tmerc +towgs84=598.1,73.7,418.2", "towgs84"),
        ("+proj=tmerc +alpha=3", "+alpha, which is not understood"),
    ],
)
def test_what_is_not_understood_is_said(reference, words):
    with pytest.raises(ValueError) as failure:
        projection_of(reference)
    assert words in str(failure.value)
    assert "\n" not in str(failure.value)


def test_places_that_no_map_has():
    place = projection_of(UTM).place
    with pytest.raises(ValueError, match="latitude 90 degrees"):
        place(math.radians(90.0), 0.0)
    with pytest.raises(ValueError, match="from the central meridian"):
        place(0.0, math.radians(120.0))
