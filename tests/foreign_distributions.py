"""Distributions of somebody else, as an installer would leave them."""

from __future__ import annotations

from pathlib import Path


def install(site: Path, name: str, version: str, points: str) -> None:
    """The metadata of a distribution in ``site``; ``points`` is its ``entry_points.txt``."""
    info = site / f"{name}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(points)
