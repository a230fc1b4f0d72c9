"""Cameras and lidars of one device: the same pictures as on the CPU, the same bytes in every slot.

    python tests/device/optics_check.py --device cuda:0 --out FOLDER

Renders the same cases on the CPU and on the device, compares them pixel by pixel (a pixel agrees
when no channel differs by more than 1 of 255), repeats them in other slots, runs ``twin bench
camera`` and ``twin bench lidar``, and writes ``FOLDER/optics_check.json`` and pictures of the worst
case. Exit code 1: fewer than 99.9 % of the pixels agree, or bytes depend on the slot.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from schemas.case import Case
from schemas.messages import Command, Lights
from schemas.plan import expand, parse_campaign

AGREE_MIN = 0.999
TICKS = 3


def cases(effects: list[str]) -> list[Case]:
    """Eight weathers at three hours, at speed, with all that a camera can give."""
    campaign, mistakes = parse_campaign(
        {
            "campaign": "optics",
            "seed": 3,
            "camera": {"width": 320, "height": 180, "effects": effects, "outputs": ["depth"]},
            "lidars": [{"name": "roof"}],
            "scenario": {"ego_start_m": 60.0, "ego_speed_mps": 10.0, "duration_s": 10.0},
            "matrix": {
                "time_of_day": ["05:00", "13:00", "18:00"],
                "weather": [
                    *("clear", "cloudy", "light_fog", "heavy_fog"),
                    *("light_rain", "heavy_rain", "light_snow", "heavy_snow"),
                ],
            },
        }
    )
    assert campaign is not None, mistakes
    return expand(campaign)


def look(
    device: str, wanted: list[Case], order: list[int], slots: int
) -> list[dict[str, np.ndarray]]:
    """Last reading of every sensor of every case, its slot chosen by ``order``."""
    from twin.rig.engine import Engine

    engine = Engine(wanted[0], slots, device)
    for slot, case in zip(order, wanted, strict=True):
        engine.reset(slot, case)
    last: dict[str, np.ndarray] = {}
    for tick in range(TICKS):
        for name, data in engine.sense().items():
            last[name] = data.values.copy()
        commands: list[Command | None] = [None] * slots
        for slot in order:
            commands[slot] = Command(slot, 0, tick, 0.3, 0.0, 0.01, lights=Lights(low=True))
        engine.step(commands)
    return [{name: values[slot] for name, values in last.items()} for slot in order]


def compare(device: str, effects: list[str], out: Path) -> dict[str, Any]:
    """Agreement of the device with the CPU, and of the device with itself in other slots."""
    wanted = cases(effects)
    count = len(wanted)
    own = look(device, wanted, list(range(count)), count)
    shuffled = look(device, wanted, [(7 * i + 5) % (count + 7) for i in range(count)], count + 7)
    equal = {
        name: all(
            a[name].tobytes() == b[name].tobytes() for a, b in zip(own, shuffled, strict=True)
        )
        for name in own[0]
    }
    reference = look("cpu", wanted, list(range(count)), count)
    agree = []
    for mine, theirs in zip(own, reference, strict=True):
        apart = np.abs(mine["camera"].astype(int) - theirs["camera"].astype(int)).max(axis=-1)
        agree.append(float((apart <= 1).mean()))
    worst = int(np.argmin(agree))
    pair = np.hstack([own[worst]["camera"], reference[worst]["camera"]])
    tag = "full" if effects else "fast"
    cv2.imwrite(str(out / f"worst-{tag}.png"), cv2.cvtColor(pair, cv2.COLOR_RGB2BGR))
    return {
        "slots_equal": equal,
        "agree_mean": float(np.mean(agree)),
        "agree_worst": agree[worst],
        "worst": wanted[worst].id,
        "depth_within_1_mm": _depths(own, reference),
        "lidar": _points(own, reference),
    }


def _depths(own: list[dict[str, np.ndarray]], reference: list[dict[str, np.ndarray]]) -> float:
    """Share of the pixels whose depths differ by less than 1 mm or 1e-4."""
    a = np.stack([row["depth"] for row in own])
    b = np.stack([row["depth"] for row in reference])
    with np.errstate(invalid="ignore"):
        close = (np.abs(a - b) <= np.maximum(1e-3, 1e-4 * b)) | (a == b)
    return float(close.mean())


def _points(own: list[dict[str, np.ndarray]], reference: list[dict[str, np.ndarray]]) -> float:
    """Share of the points that lie within 1 cm on both devices, or are missing on both."""
    name = next((n for n in own[0] if n.startswith("lidar")), None)
    if name is None:
        return float("nan")
    a = np.stack([row[name][..., :3] for row in own])
    b = np.stack([row[name][..., :3] for row in reference])
    both = np.isnan(a).all(axis=-1) & np.isnan(b).all(axis=-1)
    with np.errstate(invalid="ignore"):
        close = np.linalg.norm(a - b, axis=-1) <= 0.01
    return float((both | close).mean())


def bench(name: str, device: str, *more: str) -> Any:
    """A bench of the command line, as JSON."""
    command = [sys.executable, "-m", "twin", "bench", name, "--device", device, *more]
    done = subprocess.run([*command, "--output", "json"], capture_output=True, text=True)
    if done.returncode:
        return {"error": done.stderr[-2000:]}
    return json.loads(done.stdout)


def main() -> None:
    """Run all and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--no-bench", action="store_true", help="only compare")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {
        "device": options.device,
        "fast": compare(options.device, [], options.out),
        "full": compare(options.device, ["all"], options.out),
    }
    if not options.no_bench:
        large = ("--slots", "32", "--width", "1920", "--height", "1080")
        found["bench"] = {
            "camera": bench("camera", options.device),
            "camera 1920x1080": bench("camera", options.device, *large, "--quick"),
            "lidar": bench("lidar", options.device),
        }
    text = json.dumps(found, indent=1)
    (options.out / "optics_check.json").write_text(text)
    print(text)
    kinds = [found["fast"], found["full"]]
    good = all(k["agree_mean"] >= AGREE_MIN and all(k["slots_equal"].values()) for k in kinds)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
