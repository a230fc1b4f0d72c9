"""Pictures of every effect, lens and output, in all weathers, by day and by night."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from golden.looks_scene import write_yard

import twin.vehicle
from schemas.case import Case
from schemas.messages import Command, Lights
from schemas.plan import expand, parse_campaign
from schemas.sections.lens import EFFECTS
from twin.rig.engine import Engine

MODELS = Path(twin.vehicle.__file__).parent / "models"
WEATHERS = [
    "clear", "cloudy", "light_fog", "heavy_fog", "light_rain", "heavy_rain", "light_snow",
    "heavy_snow",
]  # fmt: skip
HOURS = ["05:00", "13:00", "19:30"]
PICTURES = 96
SIZE = {"width": 320, "height": 180}
OUTPUTS = ["depth", "instance", "semantic", "normal", "flow"]
LENSES: dict[str, dict[str, Any]] = {
    "shifted": {"fx": 0.9, "fy": 1.4, "cx": 0.4, "cy": 0.6},
    "brown_conrady": {"model": "brown_conrady", "k1": -0.2, "k2": 0.03, "p1": 0.001},
    "fisheye": {"model": "fisheye", "k1": 0.02},
}


def cases(camera: dict[str, Any], **scenario: Any) -> list[Case]:
    """Eight weathers at three hours, at speed."""
    campaign, mistakes = parse_campaign(
        {
            "campaign": "bytes",
            "seed": 3,
            "camera": {**SIZE, "noise": True, **camera},
            "scenario": {
                "ego_start_m": 60.0, "ego_speed_mps": 10.0, "duration_s": 10.0, **scenario,
            },
            "matrix": {"time_of_day": HOURS, "weather": WEATHERS},
        }
    )  # fmt: skip
    assert campaign is not None, mistakes
    return expand(campaign)


def pictures(found: Any) -> None:
    """A hundred of each effect, of all of them with all outputs, of each lens, and of materials."""
    kinds: dict[str, dict[str, Any]] = {e: {"effects": [e]} for e in EFFECTS}
    kinds["all effects, all outputs"] = {"effects": ["all"], "outputs": OUTPUTS}
    for name, camera in kinds.items():
        shoot(found, name, cases(camera))
    folder = found.out.resolve() / "files"
    folder.mkdir(parents=True, exist_ok=True)
    for name, lens in LENSES.items():
        vehicle = yaml.safe_load((MODELS / "opencav.yaml").read_text())
        vehicle["cameras"]["front_right"]["lens"] = lens
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(vehicle, sort_keys=False))
        shoot(found, f"lens {name}", cases({"outputs": ["depth"]}, vehicle=str(path)))
    yard = cases({"outputs": ["depth"]}, scene=str(write_yard(folder)), ego_start_m=5.0)
    shoot(found, "materials from files", yard)


def shoot(found: Any, name: str, wanted: list[Case]) -> None:
    """Digest the readings of some ticks of all cases."""
    wanted = wanted[: found.count(len(wanted))]
    slots = len(wanted)
    engine = Engine(wanted[0], slots, found.device)
    for slot, case in enumerate(wanted):
        engine.reset(slot, case)
    arrays: list[np.ndarray] = []
    sample = None
    for tick in range(2 * (PICTURES // 24)):
        for data in engine.sense().values():
            arrays.append(data.values.copy())
            if data.values.dtype == np.uint8 and data.values.ndim == 4:
                sample = data.values[[0, slots // 2, slots - 1], ::2].copy()
        commands: list[Command | None] = [
            Command(slot, 0, tick, 0.3, 0.0, 0.01 * (slot % 5 - 2), lights=Lights(low=True))
            for slot in range(slots)
        ]
        engine.step(commands)
    assert sample is not None, "no picture"
    found.add(f"pictures {name}", *arrays, sample=sample)
