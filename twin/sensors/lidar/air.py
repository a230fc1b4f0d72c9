"""What the air and wet or white surfaces do to a slot's LiDAR: one struct per slot, host-filled."""

from __future__ import annotations

import warp as wp

_DECIBEL_PER_KM = 0.1 * 2.302585 / 1000.0
"""Nepers of power per decibel, and metres per kilometre."""


@wp.struct
class LidarAir:
    """Air, surfaces and random stream of one slot."""

    extinction: wp.float32
    """At the LiDAR's wavelength, fog and precipitation together [1/m]."""
    rain: wp.float32
    """[mm/h]"""
    snow: wp.float32
    """Water equivalent [mm/h]."""
    wetness: wp.float32
    """Water on surfaces, 0 dry, 1 a closed film [-]."""
    snow_cover: wp.float32
    """Share of open, level surfaces under snow [-]."""
    noise: wp.int32
    """1: errors of the sensor."""
    motion: wp.int32
    """1: vehicle and objects move during the sweep."""
    tick: wp.int32
    """Case tick."""
    active: wp.int32
    key: wp.uint64
    """Of the random stream."""
    fresh: wp.int32
    """1: no sweep before this one. Kept by the sensor, as all that follows."""
    fog_row: wp.int32
    """Row of the fog table; -1: fog returns nothing that could be detected."""
    fog_gain: wp.float32
    """Scales the row's signals [1/m]."""
    drop_row: wp.int32
    """Row of the table of drops; -1: no precipitation."""
    drop_share: wp.float32
    """Probability that a pulse meets a drop that could be detected [-]."""


def rain_extinction(rain_mm_per_h: float) -> float:
    """Extinction by rain [1/m]: 1.076 R^0.67 dB/km (ITU-R P.1814)."""
    return 1.076 * rain_mm_per_h**0.67 * _DECIBEL_PER_KM if rain_mm_per_h > 0.0 else 0.0


def snow_extinction(snow_mm_per_h: float) -> float:
    """Extinction by falling dry snow [1/m]: 5.53 S^1.38 dB/km (ITU-R P.1814)."""
    return 5.53 * snow_mm_per_h**1.38 * _DECIBEL_PER_KM if snow_mm_per_h > 0.0 else 0.0


def fog_extinction(extinction_per_m: float, rain_mm_per_h: float, snow_mm_per_h: float) -> float:
    """Extinction by fog droplets [1/m]: what rain leaves over; in snow all of it is the flakes'."""
    if snow_mm_per_h > 0.0:
        return 0.0
    return max(0.0, extinction_per_m - rain_extinction(rain_mm_per_h))
