"""From latitude and longitude to the coordinates of a road file.

A road file says by a PROJ string how its coordinates were made (OpenDRIVE 1.4 to 1.8,
``geoReference``); transverse Mercator and its zones (UTM) are understood. The projection is that of
Karney 2011, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85(8), equations
7 to 11 and 35: the conformal latitude, then Kruger's series to the sixth power of the third
flattening n, within 5e-9 m of the exact one up to 3900 km from the central meridian.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_GRID = 2.0**20
"""Per metre: results are on a grid of 1e-6 m, far above the last bits of a host's sines."""
_ELLIPSOIDS = {
    "WGS84": (6378137.0, 1.0 / 298.257223563),
    "GRS80": (6378137.0, 1.0 / 298.257222101),
}
"""Semi-major axis [m] and flattening; they differ by 0.1 mm."""
_DATUMS = ("WGS84", "ETRS89")
_IGNORED = ("no_defs", "type", "wktext", "vunits", "geoidgrids", "axis", "over")
"""Words without a meaning for x and y; ``axis`` only as ``enu``."""
_UTM_SCALE, _UTM_EAST_M, _UTM_SOUTH_M = 0.9996, 500_000.0, 10_000_000.0


@dataclass(frozen=True, slots=True)
class TransverseMercator:
    """A projection with its false origin; make it with :func:`projection_of`."""

    axis_m: float
    flattening: float
    latitude_rad: float
    """Of the origin."""
    longitude_rad: float
    """Of the central meridian."""
    scale: float
    """Along the central meridian."""
    east_m: float
    """x of the origin."""
    north_m: float
    """y of the origin."""

    def place(self, latitude_rad: float, longitude_rad: float) -> tuple[float, float]:
        """x to the east and y to the north [m], on a grid of 1e-6 m.

        Raises:
            ValueError: a pole, or 90 degrees or more from the central meridian.
        """
        if not abs(latitude_rad) < 0.5 * math.pi:
            raise ValueError(f"latitude {math.degrees(latitude_rad):g} degrees is no place of it")
        away = math.remainder(longitude_rad - self.longitude_rad, 2.0 * math.pi)
        if not abs(away) < math.radians(80.0):
            raise ValueError(f"it lies {math.degrees(away):g} degrees from the central meridian")
        east, north = self._kruger(latitude_rad, away)
        _, origin = self._kruger(self.latitude_rad, 0.0)
        x, y = self.east_m + east, self.north_m + north - origin
        return round(x * _GRID) / _GRID, round(y * _GRID) / _GRID

    def _kruger(self, latitude_rad: float, away_rad: float) -> tuple[float, float]:
        """East of the central meridian, and north of the equator [m]."""
        f = self.flattening
        n = f / (2.0 - f)
        first = math.sqrt(f * (2.0 - f))
        tangent = math.tan(latitude_rad)
        sigma = math.sinh(first * math.atanh(first * tangent / math.hypot(1.0, tangent)))
        conformal = tangent * math.hypot(1.0, sigma) - sigma * math.hypot(1.0, tangent)
        xi = math.atan2(conformal, math.cos(away_rad))
        eta = math.asinh(math.sin(away_rad) / math.hypot(conformal, math.cos(away_rad)))
        north, east = xi, eta
        for j, alpha in enumerate(_series(n), start=1):
            north += alpha * math.sin(2 * j * xi) * math.cosh(2 * j * eta)
            east += alpha * math.cos(2 * j * xi) * math.sinh(2 * j * eta)
        n2 = n * n
        radius = self.axis_m / (1.0 + n) * (1.0 + n2 / 4.0 + n2 * n2 / 64.0 + n2**3 / 256.0)
        return self.scale * radius * east, self.scale * radius * north


def _series(n: float) -> tuple[float, ...]:
    """Kruger's coefficients alpha_1 to alpha_6 (Karney 2011, equation 35)."""
    rows = (
        (1 / 2, -2 / 3, 5 / 16, 41 / 180, -127 / 288, 7891 / 37800),
        (13 / 48, -3 / 5, 557 / 1440, 281 / 630, -1983433 / 1935360),
        (61 / 240, -103 / 140, 15061 / 26880, 167603 / 181440),
        (49561 / 161280, -179 / 168, 6601661 / 7257600),
        (34729 / 80640, -3418889 / 1995840),
        (212378941 / 319334400,),
    )
    return tuple(
        sum(factor * n ** (j + k) for k, factor in enumerate(row))
        for j, row in enumerate(rows, start=1)
    )


def projection_of(reference: str) -> TransverseMercator:
    """The projection that a PROJ string names.

    Raises:
        ValueError: there is none, or it is another one; says what is understood.
    """
    words = dict(_word(part) for part in reference.split())
    if not words:
        raise ValueError("the road file has no geoReference")
    kind = words.pop("proj", "")
    if kind not in ("tmerc", "utm"):
        named = f"+proj={kind}" if kind else f"'{reference[:40]}'"
        raise ValueError(
            f"its geoReference {named} is not understood; +proj=tmerc and +proj=utm are"
        )
    axis_m, flattening = _ellipsoid(words)
    if kind == "utm":
        origin = _utm(words)
    else:
        origin = (
            math.radians(_number(words, "lat_0", 0.0)),
            math.radians(_number(words, "lon_0", 0.0)),
            _number(words, "k_0", _number(words, "k", 1.0)),
            _number(words, "x_0", 0.0),
            _number(words, "y_0", 0.0),
        )
        words.pop("k", None)
    unit, axis = words.pop("units", "m"), words.get("axis", "enu")
    shift = words.pop("towgs84", "0").split(",")
    if unit != "m" or axis != "enu" or any(float(part or 0.0) for part in shift):
        raise ValueError("its geoReference has other units, axes or a shift of datum (towgs84)")
    further = [word for word in words if word not in _IGNORED]
    if further:
        raise ValueError(f"its geoReference has +{further[0]}, which is not understood")
    if not origin[2] > 0.0:
        raise ValueError(f"its geoReference has the scale {origin[2]:g}")
    return TransverseMercator(axis_m, flattening, *origin)


def _word(part: str) -> tuple[str, str]:
    name, _, value = part.removeprefix("+").partition("=")
    return name, value


def _number(words: dict[str, str], name: str, default: float) -> float:
    text = words.pop(name, "")
    try:
        value = float(text) if text else default
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"its geoReference has +{name}={text[:20]}, which is no number")
    return value


def _ellipsoid(words: dict[str, str]) -> tuple[float, float]:
    datum = words.pop("datum", "WGS84")
    name = words.pop("ellps", "GRS80" if datum == "ETRS89" else "WGS84")
    if datum not in _DATUMS or name not in _ELLIPSOIDS:
        raise ValueError(
            f"its geoReference has datum {datum} and ellipsoid {name}; datum WGS84 with WGS84 or "
            "GRS80 is understood"
        )
    return _ELLIPSOIDS[name]


def _utm(words: dict[str, str]) -> tuple[float, float, float, float, float]:
    """A zone of 6 degrees: origin on the equator, scale and false origin."""
    zone = words.pop("zone", "")
    south = words.pop("south", None) is not None
    if not zone.isdecimal() or not 1 <= int(zone) <= 60:
        raise ValueError(f"its geoReference has +zone={zone[:20]}; 1 to 60 are zones of UTM")
    meridian = math.radians(6.0 * int(zone) - 183.0)
    return 0.0, meridian, _UTM_SCALE, _UTM_EAST_M, _UTM_SOUTH_M if south else 0.0
