"""Words that several file types share: names, times of day, weathers."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

Weather = Literal[
    "clear",
    "cloudy",
    "light_fog",
    "heavy_fog",
    "light_rain",
    "heavy_rain",
    "light_snow",
    "heavy_snow",
]
WEATHERS: tuple[str, ...] = Weather.__args__  # type: ignore[attr-defined]
"""The weathers that every campaign knows."""

Name = Annotated[str, Meta(pattern=r"^[a-z0-9]([a-z0-9._-]{0,62}[a-z0-9])?\Z")]
"""Names that become file names, Zenoh keys and Rerun ids."""

SHIPPED_STACKS = "devkit."
"""Prefix of the modules of stacks that are found wherever the commands are."""

TimeOfDay = Annotated[str, Meta(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]\Z")]
"""Local time ``HH:MM``."""


def minutes(time_of_day: str) -> int:
    """Minutes after midnight of ``HH:MM``."""
    hours, rest = time_of_day.split(":")
    return 60 * int(hours) + int(rest)
