"""The key ``free_driving`` of a scenario: the stack is watched for causeless brakings."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


class FreeDriving(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a full braking is false: truth says that no collision was near. Figures are our own."""

    near_ttc_s: Annotated[float, Meta(gt=0, le=60)] = 3.0
    """A collision was near if the time to it was below this, with all as fast as they are [s]."""
    before_s: Annotated[float, Meta(ge=0, le=10)] = 1.0
    """So long before the full braking truth is looked at, too: sensors and tracks have a memory
    [s]."""
    after_s: Annotated[float, Meta(ge=0, le=60)] = 3.0
    """So long after it the case ends [s]."""
    margin_m: Annotated[float, Meta(ge=0, le=5)] = 0.2
    """Passing nearer than this counts as a collision [m]."""
