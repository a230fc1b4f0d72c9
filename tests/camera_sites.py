"""Cameras as an episode names them, for tests of stacks."""

from __future__ import annotations

from schemas.messages import CameraSite
from schemas.sections.lens import Lens


def camera_site(
    width: int = 640,
    height: int = 360,
    position_m: tuple[float, float, float] = (2.05, -0.35, 1.32),
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    hfov_deg: float = 70.0,
) -> CameraSite:
    """The main camera of the shipped vehicle, or one like it."""
    return CameraSite(
        name="front_right",
        message="camera",
        width=width,
        height=height,
        hz=20,
        hfov_deg=hfov_deg,
        position_m=list(position_m),
        rotation_deg=list(rotation_deg),
        lens=Lens(),
    )
