"""The simulator's boxes, seen as well as the picture allows."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.kinds.perception import PerceptionKind


class GroundTruthPerception(
    Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="ground_truth"
):
    """The box sensor seen through a contrast threshold: fog, night and rain make it miss."""

    contrast_min: Annotated[float, Meta(gt=0, le=1)] = 0.05
    """Contrast of object against surroundings at which confidence is 0.5 [-]."""
    pixels_min: Annotated[int, Meta(ge=1)] = 24
    """Fewest visible pixels of an object that can be detected [px]."""


KIND = PerceptionKind(
    name="ground_truth",
    config=GroundTruthPerception,
    implementation="devkit.perception:ContrastPerception",
    told_truth=True,
    portable=lambda _variant: True,  # whole numbers, and what IEEE 754 rounds correctly
    text="the simulator's boxes, no network",
    shown=("contrast_min",),
)
