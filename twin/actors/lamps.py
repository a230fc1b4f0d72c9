"""Lamps of road users that are switched one by one."""

from __future__ import annotations

from enum import IntEnum


class VehicleLamp(IntEnum):
    """Bit of a lamp in :attr:`twin.actors.motion.Placement.lights`, and tag of its faces.

    Faces without a tag have bit 0, which is never on.
    """

    HEAD = 1
    """Front lamps, by day as well: daytime running lamps, or beams that are switched on."""
    TAIL = 2
    """Tail lamps, by day as well."""
    HIGH_BEAM = 3
    """Light thrown far ahead."""
    INDICATOR_LEFT = 4
    INDICATOR_RIGHT = 5
    REVERSING = 6
    FOG_FRONT = 7
    FOG_REAR = 8
