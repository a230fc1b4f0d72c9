"""What a campaign says about a stack that is not a Python class of this installation."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

Word = Annotated[str, Meta(min_length=1, max_length=4096)]
"""One word of a command line."""

Bridge = Literal["none", "autodrive"]
"""Protocol that a stack speaks instead of the drive plane."""

BRIDGES: dict[str, str] = {"autodrive": "devkit.bridges.autodrive:AutodriveBridge"}
"""Bridge -> the stack class that translates."""


class Foreign(Struct, frozen=True, forbid_unknown_fields=True):
    """How the stack of a case is started; part of :class:`schemas.campaign.Case`."""

    command: list[Word]
    """Words of the command line."""
    bridge: Bridge = "none"
    """``none``: the command speaks the drive plane itself."""
