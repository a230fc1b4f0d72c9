"""The campaign section ``objects``: how scripted objects of the scene differ from its file."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


class ObjectVariation(Struct, frozen=True, forbid_unknown_fields=True):
    """One scripted object of the scene, by its name there; what is left out is as the scene says.

    It is a matrix axis as well: ``objects.NAME.speed_mps``. Cases that differ only here share a
    rig.
    """

    speed_mps: Annotated[float, Meta(gt=0, le=60)] | None = None
    """Speed all the way; only of an object that has `speed_mps` in the scene [m/s]."""
    start_s: Annotated[float, Meta(ge=-3600, le=3600)] | None = None
    """Sim time at which it sets off [s]."""
    offset_m: Annotated[float, Meta(ge=-100, le=100)] = 0.0
    """Its whole way lies so far to the left of the scene's, seen in the direction in which it sets
    off; of an object that stands, to the left of it [m]."""


PARAMETERS = ObjectVariation.__struct_fields__
"""What a matrix may vary of an object."""
