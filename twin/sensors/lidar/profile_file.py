"""LiDAR profiles, as vehicles mount them: shipped by name, given by path, or written inline."""

from __future__ import annotations

from pathlib import Path

from schemas.sections.lidar import LidarMount, LidarProfile
from twin.world.scene import load_named

_PROFILES = Path(__file__).parent / "profiles"


def load_lidar_profile(name_or_path: str) -> LidarProfile:
    """Load a shipped LiDAR profile by name, or a profile file by path.

    Raises:
        ValueError: no such profile, or a mistake in its file; one line.
    """
    return load_named(name_or_path, LidarProfile, _PROFILES, "LiDAR profile")


def mounted_profile(mount: LidarMount) -> LidarProfile:
    """The profile of ``mount``, inline or loaded.

    Raises:
        ValueError: as :func:`load_lidar_profile`.
    """
    return mount.inline or load_lidar_profile(mount.profile)
