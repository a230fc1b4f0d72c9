"""Key performance indicators: one row per control tick, and the scalars of a case.

A row holds the state at the tick's time and the command computed from that tick's frames. Command
columns are null in the last row (the case has ended, nothing was asked). Missing is null, never 0.
"""

from __future__ import annotations

from schemas.kinds.kpi import shipped

KPI_COLUMNS = shipped("column")
"""Columns of the KPI rows, in the order of the file."""

SCALARS = shipped("scalar")
"""Scalars of every case."""

NAMES = shipped("name")
"""Scalars of a case that are names; a missing one is left out."""

DETECTION_FIELDS = ("label", "confidence", "x_px", "y_px", "width_px", "height_px")

HEADLIGHTS = (
    ("off", ""),
    ("low beam", "low"),
    ("high beam", "high"),
    ("parking", "parking"),
    ("fog", "fog"),
    ("low beam, parking", "low parking"),
    ("low beam, fog", "low fog"),
    ("high beam, parking", "high parking"),
    ("high beam, fog", "high fog"),
    ("parking, fog", "parking fog"),
    ("low beam, parking, fog", "low parking fog"),
    ("high beam, parking, fog", "high parking fog"),
)
"""Headlight codes 0 to 11 as AutoDRIVE publishes them, in ``opencav_aeb.py`` of
AutoDRIVE-Simulator-HPC (0 disabled, 1 low beam, 2 high beam, 3 parking, 4 fog, 5 = 1 + 3,
6 = 1 + 4, 7 = 2 + 3, 8 = 2 + 4, 9 = 3 + 4, 10 = 1 + 3 + 4, 11 = 2 + 3 + 4): name and lamps."""

INDICATORS = ("off", "left", "right", "hazard")
"""Indicator codes 0 to 3, of the same source."""

_CODES = {frozenset(lamps.split()): code for code, (_, lamps) in enumerate(HEADLIGHTS)}


def headlight_code(low: bool, high: bool, parking: bool, fog: bool) -> int:
    """AutoDRIVE's code of a lamp combination; high beam wins over low beam."""
    burning = {"low": low and not high, "high": high, "parking": parking, "fog": fog}
    return _CODES[frozenset(lamp for lamp, on in burning.items() if on)]
