"""Checks and measures everything on one device in one call; needs no test runner.

    python tests/device/gpu_check.py --device cuda:0 --out FOLDER

Runs chaos-16 with 1, 4 and 16 slots and aeb-demo with 1 and 8, compares the fingerprints, measures
frames per second of the engine, and writes ``FOLDER/gpu_check.json``. Exit code 1: fingerprints
differ.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import msgspec

from conductor.source import load
from schemas.campaign import expand
from schemas.messages import Command


def campaign(name: str, device: str, slots: int, out: Path) -> dict[str, object]:
    """Run a shipped campaign with one worker; its JSON."""
    folder = out / f"{name}-{slots}"
    command = [
        *(sys.executable, "-m", "conductor", "run", name, "--device", device, "--workers", "1"),
        *("--slots", str(slots), "--out", str(folder), "--output", "json"),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1) or not done.stdout:
        logs = "\n".join(path.read_text() for path in folder.glob("logs/*"))
        raise SystemExit(f"{name}: exit code {done.returncode}\n{done.stderr}\n{logs}")
    found: dict[str, object] = json.loads(done.stdout)
    return found


def frames_per_s(device: str, slots: int, width: int, height: int, ticks: int) -> float:
    """Rendered frames per second of the bare engine, without bus and stack."""
    from twin.engine import Engine

    case = expand(load("aeb-demo"))[0]
    camera = msgspec.structs.replace(case.camera, width=width, height=height, hz=20)
    case = msgspec.structs.replace(case, camera=camera)
    engine = Engine(case, slots, device)
    for slot in range(slots):
        engine.reset(slot, case)

    def tick() -> None:
        engine.sense()
        engine.step([Command(s, 0, int(engine.tick[s]), 0.5, 0.0, 0.0) for s in range(slots)])

    tick()
    started = time.perf_counter()
    for _ in range(ticks):
        tick()
    return slots * ticks / (time.perf_counter() - started)


def main() -> None:
    """Run all and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--slots", type=int, default=64, help="slots of the frame rate test")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    runs = {
        f"{name}-{slots}": campaign(name, options.device, slots, options.out / "runs")
        for name, all_slots in (("chaos-16", (1, 4, 16)), ("aeb-demo", (1, 8)))
        for slots in all_slots
    }
    equal = all(
        len({run["fingerprint"] for key, run in runs.items() if key.startswith(name)}) == 1
        for name in ("chaos-16", "aeb-demo")
    )
    found = {
        "device": options.device,
        "fingerprints_equal": equal,
        "frames_per_s_320x180": frames_per_s(options.device, options.slots, 320, 180, 30),
        "frames_per_s_640x360": frames_per_s(options.device, options.slots, 640, 360, 30),
        "runs": runs,
    }
    text = json.dumps(found, indent=1)
    (options.out / "gpu_check.json").write_text(text)
    print(text)
    sys.exit(0 if equal else 1)


if __name__ == "__main__":
    main()
