"""Rain and snow at millimetre waves: what they take away, and what they send back."""

from __future__ import annotations

import math

# ITU-R P.838-3 (2005), tables 1 to 4: rows of a, b, c; then m and c of the straight line.
_K_H = (
    (-5.33980, -0.10008, 1.13098),
    (-0.35351, 1.26970, 0.45400),
    (-0.23789, 0.86036, 0.15354),
    (-0.94158, 0.64552, 0.16817),
)
_K_V = (
    (-3.80595, 0.56934, 0.81061),
    (-3.44965, -0.22911, 0.51059),
    (-0.39902, 0.73042, 0.11899),
    (0.50167, 1.07319, 0.27195),
)
_ALPHA_H = (
    (-0.14318, 1.82442, -0.55187),
    (0.29591, 0.77564, 0.19822),
    (0.32177, 0.63773, 0.13164),
    (-5.37610, -0.96230, 1.47828),
    (16.1721, -3.29980, 3.43990),
)
_ALPHA_V = (
    (-0.07771, 2.33840, -0.76284),
    (0.56727, 0.95545, 0.54039),
    (-0.20238, 1.14520, 0.26809),
    (-48.2991, 0.791669, 0.116226),
    (48.5833, 0.791459, 0.116479),
)
_LINES = {
    "k_h": (-0.18961, 0.71147),
    "k_v": (-0.16398, 0.63297),
    "alpha_h": (0.67849, -1.95537),
    "alpha_v": (-0.053739, 0.83433),
}

_NEPERS_PER_DB = 0.1 * math.log(10.0)

RAIN_ECHO = (1.147e-4, 0.717)
"""Factor [m^2/m^3] and exponent of the echo of rain in :func:`echo_per_m`, R in mm/h."""
SNOW_ECHO = (4.457e-6, 0.428)
"""The same of dry snow, R of water."""
SNOW_LOSS = (0.3526, 1.358)
"""Factor [dB/km] and exponent of the attenuation by dry snow at 77 GHz, R in mm/h of water."""


def coefficients(carrier_hz: float, *, vertical: bool) -> tuple[float, float]:
    """k and alpha of the specific attenuation k R^alpha [dB/km], R in mm/h, for a level path.

    ITU-R P.838-3, 1 to 1000 GHz: sums of Gaussians in the logarithm of the frequency.
    """
    log_ghz = math.log10(carrier_hz / 1e9)
    sort = "v" if vertical else "h"
    k = _sum(_K_V if vertical else _K_H, _LINES[f"k_{sort}"], log_ghz)
    alpha = _sum(_ALPHA_V if vertical else _ALPHA_H, _LINES[f"alpha_{sort}"], log_ghz)
    return 10.0**k, alpha


def _sum(
    rows: tuple[tuple[float, float, float], ...], line: tuple[float, float], at: float
) -> float:
    bumps = sum(a * math.exp(-(((at - b) / c) ** 2)) for a, b, c in rows)
    return bumps + line[0] * at + line[1]


def attenuation_per_m(carrier_hz: float, rain_mm_per_h: float, snow_mm_per_h: float) -> float:
    """Loss of power by rain and snow, one way, in nepers of power [1/m]; vertical polarisation.

    Snow is that of 77 GHz, see :func:`echo_per_m`.
    """
    k, alpha = coefficients(carrier_hz, vertical=True)
    rain = _power_law((k, alpha), rain_mm_per_h)
    snow = _power_law(SNOW_LOSS, snow_mm_per_h)
    return (rain + snow) * _NEPERS_PER_DB / 1000.0


def echo_per_m(rain_mm_per_h: float, snow_mm_per_h: float) -> float:
    """Radar cross section of a cubic metre of rain and snow at 77 GHz [m^2/m^3].

    Power laws through Mie sums (``tests/kernel/test_rain_echo.py`` computes them). Rain: drops of
    Marshall and Palmer's sizes, water of 10 degrees Celsius, from 1 to 50 mm/h. Dry snow: flakes of
    the sizes of Sekhon and Srivastava (1970), as spheres of ice and air (Maxwell Garnett) with a
    density of 0.1 g/cm^3, from 0.25 to 4.4 mm/h of water.
    """
    return _power_law(RAIN_ECHO, rain_mm_per_h) + _power_law(SNOW_ECHO, snow_mm_per_h)


def _power_law(law: tuple[float, float], rate_mm_per_h: float) -> float:
    return law[0] * rate_mm_per_h ** law[1] if rate_mm_per_h > 0.0 else 0.0
