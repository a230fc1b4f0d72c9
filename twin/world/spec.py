"""Base type and plain types of scene files."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


class Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of scene types: frozen, unknown keys are errors."""


Length = Annotated[float, Meta(gt=0, le=2000)]
"""A length [m]."""
Share = Annotated[float, Meta(ge=0, le=1)]
"""A part of the whole [-]."""
Position = Annotated[float, Meta(ge=-2000, le=2000)]
"""A world coordinate [m]."""
Range = Annotated[list[Length], Meta(min_length=2, max_length=2)]
"""Smallest and largest [m]."""
Rgb = Annotated[list[Share], Meta(min_length=3, max_length=3)]
"""Linear RGB reflectance [-]."""
Point = Annotated[list[Position], Meta(min_length=3, max_length=3)]
"""World x, y, z [m]."""
