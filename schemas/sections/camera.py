"""The campaign section ``camera``: the format of a camera's pictures."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.picture import ImageOutput
from schemas.names import Name
from schemas.sections.lens import EFFECTS, Effect


class Camera(Struct, frozen=True, forbid_unknown_fields=True):
    """One of the vehicle's cameras: format of its pictures. Place and lens are the vehicle's."""

    name: Name = "front_right"
    """Which of the cameras in the vehicle file; its random numbers are keyed by this name."""
    width: Annotated[int, Meta(ge=16, le=3840)] = 640
    """Image width [px]."""
    height: Annotated[int, Meta(ge=9, le=2160)] = 360
    """Image height [px]."""
    hz: Annotated[int, Meta(ge=1, le=100)] = 20
    """Frames per second [Hz]; a frame period is a whole number of physics steps."""
    hfov_deg: Annotated[float, Meta(ge=10, le=150)] = 70.0
    """Horizontal field of view [deg]."""
    noise: bool = True
    """Shot and read noise, drawn from the case's own stream."""
    reflections: bool = True
    """Second rays: wet roads, paint and panes mirror the street, and glass is clear. False: they
    mirror the sky alone and glass is dark; faster."""
    effects: list[Effect | Literal["all"]] = []
    """What lens and shutter do to the picture, how strongly is the lens's; none is the fastest."""
    outputs: list[ImageOutput] = []
    """Further pictures: the truth of every pixel."""

    def active_effects(self) -> tuple[str, ...]:
        """The effects that are on, in their fixed order."""
        return tuple(e for e in EFFECTS if e in self.effects or "all" in self.effects)
