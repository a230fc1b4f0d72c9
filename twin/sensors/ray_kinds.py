"""The table of ray sensors: who mounts each kind on a rig."""

from __future__ import annotations

from functools import cache

from schemas.kinds.registry import implementation
from twin.sensors.ray_sensor import RayRig

_RIGS = (
    "twin.sensors.camera.cameras:CAMERAS",
    "twin.sensors.lidar.lidars:LIDARS",
    "twin.sensors.declared:DECLARED",
)
"""``module:attribute`` by kind. Channels, launches and readings of a rig have this order."""


@cache
def ray_rigs() -> tuple[RayRig, ...]:
    """Every kind's :class:`~twin.sensors.ray_sensor.RayRig`, in the table's order."""
    return tuple(implementation(reference) for reference in _RIGS)
