"""Short runs of shipped campaigns without float networks, by `conductor run`."""

from __future__ import annotations

import shutil
import subprocess
import sys
from typing import Any

import yaml

from conductor.run.source import find
from twin.scenario.storyboard.native.document import shipped_scenarios


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
    names = ("chaos-16", "lane-loop", "aeb-demo", "aeb-demo-int8", "aeb-fusion")
    chaos, lane, demo, whole, fused = (yaml.safe_load(find(n).read_text()) for n in names)
    lane["scenario"]["distance_m"] = 120
    lane["matrix"]["weather"] = ["clear"]
    demo["matrix"]["model"] = ["ground_truth"]
    fused["autonomy"]["perception"] = {
        "ground_truth": {"type": "ground_truth"},
        "whole": {"type": "network", "model": "yolov3-w25-int8"},
    }
    fused["matrix"]["model"] = ["ground_truth", "whole"]
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
    shipped = {
        **scenario,
        "campaign": "scenarios",
        "camera": {"width": 64, "height": 36, "hz": 10, "noise": True},
        "scenario": {"type": "storyboard", "storyboard": "cut-in", "duration_s": 12},
        "autonomy": {},
        "matrix": {"scenario.storyboard": list(shipped_scenarios(of_rulebooks=False))},
    }
    wanted = {
        "chaos-16": chaos,
        "lane-loop": lane,
        "aeb-demo": demo,
        "cut-ins": scenario,
        "scenarios": shipped,
        "aeb-demo-int8": whole,
        "aeb-fusion": fused,
    }
    for section in wanted.values():
        section["autonomy"]["sandbox"] = "off"  # it would keep settings of NumPy from the stack
        section["deadline_s"] = 3600  # kernels of a new cache are compiled in the first tick
    return wanted
