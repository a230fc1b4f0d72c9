"""Shipped campaigns with a change, as files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

import conductor
from schemas.files.yaml_file import load_yaml


def changed(folder: Path, name: str, change: Callable[[dict[str, Any]], None]) -> str:
    """``folder/campaign.yaml``: the shipped campaign ``name``, changed."""
    data = load_yaml(Path(conductor.__file__).parent / "campaigns" / f"{name}.yaml")
    change(data)
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return str(path)


def from_nearby(data: dict[str, Any]) -> None:
    """Every case of the demo, from when the obstacle is near: half of its processor time."""
    near = {"ego_start_m": 30, "ego_speed_mps": 8.0, "duration_s": 4, "standstill_s": 0.5}
    data["scenario"].update(near)
