"""Short runs of shipped campaigns without networks, by `conductor run`."""

from __future__ import annotations

import shutil
import subprocess
import sys
from typing import Any

import yaml

from conductor.run.source import find


def campaigns(found: Any) -> None:
    """The fingerprint of every run, as `conductor fingerprint` says it."""
    folder = (found.out / "campaigns").resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, section in wanted().items():
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(section, sort_keys=False))
        conductor = [sys.executable, "-m", "conductor"]
        out = folder / name
        run = [*conductor, "run", str(path), "--out", str(out), "--view", "none",
               "--device", found.device]  # fmt: skip
        done = subprocess.run(run, capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stdout + done.stderr
        told = subprocess.run([*conductor, "fingerprint", str(out)], capture_output=True, text=True)
        assert told.returncode == 0, told.stderr
        found.say(f"campaign {name}", told.stdout.split()[0])


def wanted() -> dict[str, dict[str, Any]]:
    """Campaign files by name."""
    chaos, lane, demo = (yaml.safe_load(find(n).read_text()) for n in
                         ("chaos-16", "lane-loop", "aeb-demo"))  # fmt: skip
    lane["scenario"]["distance_m"] = 120
    lane["matrix"]["weather"] = ["clear"]
    demo["matrix"]["model"] = ["ground_truth"]
    scenario = {
        "schema": 1,
        "campaign": "cut-ins",
        "seed": 4,
        "control_hz": 20,
        "camera": {"width": 160, "height": 90, "hz": 10, "noise": True},
        "sensors": {"gnss": {}, "imu": {}, "encoders": {}},
        "scenario": {"type": "storyboard", "storyboard": "cut-in"},
        "autonomy": {"parameters": {"cruise_speed_mps": 30}},
        "matrix": {"weather": ["heavy_rain"], "storyboard.actors.van.ahead_m": [30, 40]},
    }
    return {"chaos-16": chaos, "lane-loop": lane, "aeb-demo": demo, "cut-ins": scenario}
