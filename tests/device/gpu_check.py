"""Checks and measures everything on one device in one call; needs no test runner.

    PYTHONPATH=tests python tests/device/gpu_check.py --device cuda:0 --out FOLDER

Runs chaos-16 with 1, 4 and 16 slots and aeb-demo with 1 and 8, compares the fingerprints, measures
frames per second of the engine and vehicle substeps per second, counts results of portable
functions that differ from the CPU's, and writes ``FOLDER/gpu_check.json``. Exit code 1:
fingerprints, the bytes of vehicles or those of portable functions differ.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import msgspec
from case_changes import changed
from portable_kernels import differing

from conductor.run.source import load
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
    from twin.rig.engine import Engine

    case = load("aeb-demo").cases[0]
    camera = msgspec.structs.replace(case.rig.camera, width=width, height=height, hz=20)
    case = changed(case, camera=camera)
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


def vehicles(device: str) -> dict[str, object]:
    """Vehicle substeps per second, and whether slots and batches give the same bytes."""
    import warp as wp

    from twin.bench.vehicle import VEHICLES, measure
    from twin.validate.straight import DRY
    from twin.vehicle.fleet import Fleet
    from twin.vehicle.vehicle_file import load_vehicle
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()
    kind = device.partition(":")[0]
    bench = measure(device, VEHICLES[kind])

    def drive(slots: int, order: list[int]) -> list[bytes]:
        fleet = Fleet([load_vehicle("opencav")], slots, wp.get_device(device))
        for k, slot in enumerate(order):
            fleet.place(slot, 3.0 * k, 5.0 + 4.0 * k, DRY, refresh=False)
            fleet.commands[slot, 0, :] = (0.1 * k, 0.2 * (k % 3), 0.02 * k, 0.0, 1.0)
            fleet.switch_step[slot], fleet.active[slot] = 1000, 1
        fleet.refresh()
        for first in range(0, 1000, 25):
            fleet.first_step[:] = first
            fleet.advance(25)
        return [fleet.state[slot].tobytes() for slot in order]

    one = drive(8, list(range(8)))
    equal = (
        one == drive(8, [7, 2, 5, 0, 1, 3, 6, 4]) == drive(300, [299, 5, 17, 80, 1, 200, 64, 65])
    )
    return {
        "substeps_per_s": bench.substeps_per_s,
        "target_substeps_per_s": bench.target,
        "oracle_steps_per_s": bench.oracle_steps_per_s,
        "bytes_equal": equal,
    }


def sensor_bytes_equal(device: str) -> bool:
    """Whether encoders, GNSS and IMU read the same in any slot, alone and beside others."""
    from schemas.kinds.sensors.encoders import Encoders
    from schemas.kinds.sensors.gnss import Gnss
    from schemas.kinds.sensors.imu import Imu
    from schemas.sections.sensors import Sensors
    from twin.rig.engine import Engine

    sensors = Sensors(encoders=Encoders(), gnss=Gnss(dropouts_per_min=60.0), imu=Imu())
    cases = [changed(c, sensors=sensors) for c in load("chaos-16").cases]

    def drive(order: dict[int, int], slots: int) -> list[bytes]:
        engine = Engine(cases[0], slots, device)
        for slot, index in order.items():
            engine.reset(slot, cases[index])
        seen: dict[int, list[bytes]] = {slot: [] for slot in order}
        for _ in range(20):
            found = engine.sense()
            commands: list[Command | None] = [None] * slots
            for slot in order:
                own = (found[name].values[slot].tobytes() for name in sorted(found))
                seen[slot].append(b"".join(own))
                commands[slot] = Command(slot, 0, int(engine.tick[slot]), 0.5, 0.0, 0.05)
            engine.step(commands)
        return [b"".join(seen[slot]) for slot in order]

    together = drive({6: 0, 1: 5, 4: 9}, 8)
    return together == [b for index in (0, 5, 9) for b in drive({0: index}, 1)]


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
        "sensor_bytes_equal": (sensors := sensor_bytes_equal(options.device)),
        "vehicles": (cars := vehicles(options.device)),
        "portable_functions_differing": (portable := differing(options.device)),
        "frames_per_s_320x180": frames_per_s(options.device, options.slots, 320, 180, 30),
        "frames_per_s_640x360": frames_per_s(options.device, options.slots, 640, 360, 30),
        "runs": runs,
    }
    text = json.dumps(found, indent=1)
    (options.out / "gpu_check.json").write_text(text)
    print(text)
    same = equal and sensors and cars["bytes_equal"] and not any(portable.values())
    sys.exit(0 if same else 1)


if __name__ == "__main__":
    main()
