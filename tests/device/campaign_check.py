"""Checks and measures whole campaigns on one device in one call; needs no test runner.

    PYTHONPATH=tests python tests/device/campaign_check.py --device cuda:0 --out FOLDER

Parts, in this order (``--parts``): ``handles``: memory opened by its handle in another process
holds the same bytes. ``same``: the fingerprint of chaos-16 and of a campaign with networks, two
cameras and a LiDAR, however frames travel and whatever the number of slots. ``engine``: the engine
alone, by laps. ``full``: aeb-256 with networks, two cameras at 20 Hz and a LiDAR at 10 Hz, with
one, four and six workers that share a GPU; the first run compiles kernels, unless ``same`` or
``engine`` did. ``lockstep``: the same, 64 cases in 64 slots, with the stack in a process of its own
and in the simulator's. ``paper``: aeb-256 as it is, with one worker and with four. ``scaling``:
1,024 cases on one GPU, on two and so on; ``scaling_long``: the same with cases of half a minute.
Writes ``FOLDER/campaign_check.json`` after every part and long run. Exit code 1: something differs
that must not.

On a CPU (``--device cpu --cases 4 --slots 4``) it is the same with small pictures, a rehearsal.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from darknet_oracle import random_weights

from conductor.run.places import gpu_slots
from conductor.run.source import find, load
from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import ARCHITECTURES, architecture_network
from devkit.detector.model_files import shipped_models
from schemas.files.yaml_file import load_yaml
from schemas.messages import Command
from twin.base.gpu.nvml import visible_gpus
from twin.bench.campaign import Request, as_json, lines, measure
from twin.rig.simulator import TRANSPORT_VARIABLE

LABELS = ["car", "truck", "pedestrian", "traffic_sign"]
NETWORK_PX = (320, 192)
VISIBLE = "CUDA_VISIBLE_DEVICES"
LOCKSTEP_SLOTS = 64


class Check:
    """Options, what was found so far, and what differs."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.device: str = options.device
        self.cpu = options.device == "cpu"
        self.out: Path = options.out
        self.slots: int = options.slots
        self.cases: int | None = options.cases
        self.models: list[Path] = options.model
        self.found: dict[str, Any] = {"device": options.device, "differs": []}

    def expect(self, name: str, *, holds: bool) -> None:
        """Note what does not hold."""
        if not holds:
            self.found["differs"].append(name)
            print(f"DIFFERS: {name}", file=sys.stderr, flush=True)

    def write(self) -> None:
        """Write everything so far."""
        text = json.dumps(self.found, indent=1)
        (self.out / "campaign_check.json").write_text(text)

    def run(
        self,
        name: str,
        campaign: str,
        slots: int,
        transport: str = "device",
        workers: str = "1",
        *,
        everything: bool = True,
    ) -> dict[str, Any]:
        """One run by `conductor run`; its row. ``everything``: all sensors are read."""
        os.environ[TRANSPORT_VARIABLE] = transport
        cases = None if name.startswith("same") else self.cases
        request = Request(campaign, self.device, self.out / "runs" / name, cases, workers)
        row = measure(request, slots, everything=everything)
        print(f"--- {name}", *lines([row]), sep="\n", file=sys.stderr, flush=True)
        found: dict[str, Any] = as_json(request, [row])["rows"][0]
        return found


def handles(check: Check) -> None:
    """A child process opens our memory; only where a GPU is."""
    from twin.base.gpu import cuda

    probe = cuda.offer(check.device)
    check.found["handles"] = {"offered": probe is not None}
    if check.cpu:
        check.expect("a CPU offers no device memory", holds=probe is None)
        return
    check.expect("the GPU's memory can be offered", holds=probe is not None)
    if probe is None:
        return
    import warp as wp

    pictures = np.random.default_rng(1).integers(0, 256, (64, 360, 640, 3), dtype=np.uint8)
    with wp.ScopedMempool(check.device, False):
        there = wp.zeros(pictures.shape, dtype=wp.uint8, device=check.device)
    there.assign(pictures)
    wp.synchronize_device(check.device)
    child = (
        "import sys, hashlib, time; from twin.base.gpu import cuda\n"
        "h, p, n, d = sys.argv[1:]\n"
        "proved = cuda.proves(bytes.fromhex(p), n, d)\n"
        "m = cuda.DeviceMemory(bytes.fromhex(h), '|u1', [64, 360, 640, 3], d)\n"
        "m.copied(); t = time.perf_counter(); a = m.frame().host(); t = time.perf_counter() - t\n"
        "print(proved, cuda.proves(bytes.fromhex(p), 'x' * 32, d), "
        "hashlib.sha256(a.tobytes()).hexdigest(), a.nbytes / t / 1e9)\n"
    )
    import hashlib

    arguments = [cuda.handle_of(there).hex(), probe.handle.hex(), probe.nonce, check.device]
    done = subprocess.run([sys.executable, "-c", child, *arguments], capture_output=True, text=True)
    print(done.stderr[-2000:], file=sys.stderr)
    said = (done.stdout.splitlines() or [""])[-1].split()
    expected = ["True", "False", hashlib.sha256(pictures.tobytes()).hexdigest()]
    check.expect("another process reads the same bytes by handle", holds=said[:3] == expected)
    from twin.world.mirror import Mirror

    mirror = Mirror(pictures.shape, wp.uint8, wp.get_device(check.device), large=True)
    wp.copy(mirror.device, there)
    mirror.pull()
    started = time.perf_counter()
    pulled = mirror.pull()
    spent = time.perf_counter() - started
    check.expect("a mirror brings the same bytes", holds=pulled.tobytes() == pictures.tobytes())
    check.found["handles"] |= {
        "said": said,
        "pages_pinned": mirror._pages is not None,
        "pull_gb_per_s": pictures.nbytes / spent / 1e9,
    }


def models(check: Check) -> dict[str, Path]:
    """Up to four networks: the given ones, the shipped ones, or ones with random weights."""
    known = {path.stem: path for path in check.models} or shipped_models()
    if known:
        return dict(list(known.items())[:4])
    found = {}
    for name in ARCHITECTURES:
        width, height = NETWORK_PX if not check.cpu else (96, 64)
        network = architecture_network(f"{name}-w25", classes=4, width=width, height=height)
        path = check.out / f"{name}-w25-random.onnx"
        onnx.save(write_onnx(network, random_weights(network, 1), LABELS), path)
        found[name] = path
    return found


def full_campaign(check: Check, name: str, **changes: Any) -> str:
    """aeb-256 with networks, two cameras at 20 Hz and a LiDAR at 10 Hz; its path."""
    data = load_yaml(find("aeb-256"))
    networks = models(check)
    size = {"width": 96, "height": 54} if check.cpu else {}
    data["campaign"] = name
    data["camera"] |= size
    data["cameras"] = [{**data["camera"], "name": "front_left"}]
    data["lidars"] = [] if check.cpu else [{"name": "roof", "hz": 10}]
    # Random weights see nothing with this much confidence: every case drives its whole way.
    trained = bool(check.models or shipped_models())
    limit = changes.pop("confidence_min", 0.25 if trained else 0.9)
    data["autonomy"]["perception"] = {
        model: {"type": "network", "model": str(path), "confidence_min": limit}
        for model, path in networks.items()
    }
    data["matrix"]["model"] = list(networks)
    data["scenario"] |= changes.pop("scenario", {})
    data["autonomy"] |= changes.pop("autonomy", {})
    data["matrix"] |= changes
    path = check.out / f"{name}.yaml"
    path.write_text(json.dumps(data))  # JSON is YAML
    return str(path)


def same(check: Check) -> None:
    """However frames travel, whatever the number of slots."""
    chaos = load_yaml(find("chaos-16"))
    chaos["autonomy"]["placement"] = "inline"
    inline = check.out / "chaos-inline.yaml"
    inline.write_text(json.dumps(chaos))
    # Two seconds; the sensors' files and networks are the real ones.
    short = {"ego_start_m": 40.0, "ego_speed_mps": 8.0, "duration_s": 2.0}
    axes = {"weather": ["clear", "heavy_fog"], "time_of_day": ["13:00", "19:00"]}
    eyes = full_campaign(check, "eyes", scenario=short, **axes)
    inside = full_campaign(
        check, "eyes-inline", scenario=short, autonomy={"placement": "inline"}, **axes
    )
    best = "memory" if check.cpu else "device"
    plans = {
        "chaos": [
            ("chaos-16", 16, "device", best),
            ("chaos-16", 1, "device", best),
            ("chaos-16", 5, "memory", "memory"),
            ("chaos-16", 16, "bytes", "bytes"),
            (str(inline), 16, "device", "inline"),
        ],
        "eyes": [
            (eyes, 16, "device", best),
            (eyes, 3, "memory", "memory"),
            (eyes, 256, "device", best),
            (inside, 5, "device", "inline"),
        ],
    }
    if check.cpu:
        plans["eyes"] = [plan for plan in plans["eyes"] if plan[1] < 256]
    for kind, runs in plans.items():
        rows = {
            f"{kind}-{place}-{slots}-{transport}": (
                check.run(f"same-{kind}-{place}", campaign, slots, transport),
                expected,
            )
            for place, (campaign, slots, transport, expected) in enumerate(runs)
        }
        prints = {name: row["fingerprint"] for name, (row, _) in rows.items()}
        check.found[f"same_{kind}"] = {
            name: [row["fingerprint"][:16], row["transport"], round(row["wall_s"], 1)]
            for name, (row, _) in rows.items()
        }
        check.expect(f"{kind}: fingerprints {prints}", holds=len(set(prints.values())) == 1)
        for name, (row, expected) in rows.items():
            check.expect(f"{name} travels by {expected}", holds=row["transport"] == expected)
        check.write()


def engine(check: Check) -> None:
    """The engine alone, ms per tick by laps, with pictures left on the device or brought over."""
    from twin.base.stopwatch import Stopwatch
    from twin.rig.engine import Engine

    cases = load(full_campaign(check, "engine")).cases
    slots, ticks = check.slots, 4 if check.cpu else 20
    watch = Stopwatch()
    simulator = Engine(cases[0], slots, check.device, watch=watch)
    for slot in range(slots):
        simulator.reset(slot, cases[slot % len(cases)])
    watch.lap("resets")
    found: dict[str, Any] = {"resets_s": watch.seconds["resets"]}

    def tick(look: Callable[[Any], object]) -> None:
        sensed = simulator.sense()
        simulator.wait()
        watch.lap("render")
        for data in sensed.values():
            look(data)
        watch.lap("pull")
        commands: list[Command | None] = [
            Command(slot, 0, now, 0.5, 0.0, 0.0) for slot, now in enumerate(simulator.tick.tolist())
        ]
        watch.lap("commands")
        simulator.step(commands)

    looks: dict[str, Callable[[Any], object]] = {
        "left": lambda data: None,
        "pulled": lambda data: data.values,
    }
    for name, look in looks.items():
        for _ in range(2):
            tick(look)
        watch.seconds.clear()
        for _ in range(ticks):
            tick(look)
        found[f"{name}_ms_per_tick"] = {
            lap: round(1e3 * spent / ticks, 3) for lap, spent in watch.seconds.items()
        }
    simulator.close()
    check.found["engine"] = found
    print(json.dumps(found), file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Plan:
    """A run with ``per_gpu`` workers on each GPU."""

    name: str
    path: str
    per_gpu: int
    gpus: int = 1
    slots: int | None = None
    """Of each worker; None: the workers of a GPU share ``check.slots``."""
    everything: bool = True
    """All sensors are read, also those that the stack does not look at."""


def compare(check: Check, part: str, plans: Sequence[Plan]) -> dict[str, dict[str, Any]]:
    """Run these; their rows, which must have one fingerprint. On a CPU there is one worker."""
    rows: dict[str, dict[str, Any]] = {}
    for plan in plans:
        slots = plan.slots or -(-check.slots // plan.per_gpu)
        workers = "1" if check.cpu else f"{plan.per_gpu}xcuda"
        with visible(plan.gpus):
            rows[plan.name] = check.run(
                f"{part}-{plan.name}", plan.path, slots, workers=workers, everything=plan.everything
            )
        check.found[part] = rows
        check.write()
    prints = {name: row["fingerprint"] for name, row in rows.items()}
    check.expect(f"{part}: fingerprints {prints}", holds=len(set(prints.values())) == 1)
    return rows


@contextlib.contextmanager
def visible(gpus: int) -> Iterator[None]:
    """Only so many GPUs, the first of those that may be used."""
    before = os.environ.get(VISIBLE)
    listed = before.split(",") if before else [str(index) for index in range(gpus)]
    os.environ[VISIBLE] = ",".join(listed[:gpus])
    try:
        yield
    finally:
        os.environ.pop(VISIBLE)
        if before is not None:
            os.environ[VISIBLE] = before


def paper(check: Check) -> None:
    """aeb-256 as it is shipped, one camera and networks."""
    compare(check, "paper", [Plan("one", "aeb-256", 1), Plan("four", "aeb-256", 4)])


def full(check: Check) -> None:
    """All sensors and networks."""
    path = full_campaign(check, "aeb-full")
    names = {"cold": 4, "four": 4, "six": 6, "one": 1}
    plans = [Plan(name, path, count) for name, count in names.items()]
    compare(check, "full", [*plans, Plan("read", path, 4, everything=False)])


def lockstep(check: Check) -> None:
    """What the drive plane costs: the same cases with the stack in the simulator's process."""
    one: dict[str, list[str]] = {"model": list(models(check))[:1]}
    if check.cpu:
        one |= {"weather": ["clear"], "time_of_day": ["09:00"]}
    apart = full_campaign(check, "apart", **one)
    inside = full_campaign(check, "inside", autonomy={"placement": "inline"}, **one)
    slots, check.slots = check.slots, min(check.slots, LOCKSTEP_SLOTS)
    rows = compare(check, "lockstep", [Plan("apart", apart, 1), Plan("inside", inside, 1)])
    check.slots = slots
    check.found["lockstep_overhead"] = rows["apart"]["loop_s"] / rows["inside"]["loop_s"] - 1.0


def scaling(check: Check) -> None:
    """The cases of ``full`` at 32 hours of the day: their mean is 11 s, the longest 26 s."""
    scale(check, "scaling", full_campaign(check, "aeb-many", time_of_day=hours(check)))


def scaling_long(check: Check) -> None:
    """As many of half a minute, as the paper's are: at its speed, and nobody sees the car."""
    slow = {"parameters": {"cruise_speed_mps": 5.0}}
    axes = {"time_of_day": hours(check)}
    path = full_campaign(check, "aeb-long", autonomy=slow, confidence_min=0.99, **axes)
    scale(check, "scaling_long", path)


def hours(check: Check) -> list[str]:
    """Times of day that make 1,024 cases."""
    found = [f"{m // 60:02d}:{m % 60:02d}" for m in range(5 * 60, 5 * 60 + 32 * 27, 27)]
    return found[:1] if check.cpu else found


def scale(check: Check, part: str, path: str) -> None:
    """A campaign on one GPU, two and so on, with the slots that `conductor run` chooses: by wall
    time, and from the first tick to the last."""
    gpus = 1 if check.cpu else len(visible_gpus())
    cases = len(load(path).cases)
    plans = [
        Plan(f"gpus-{n}", path, 4, n, None if check.cpu else gpu_slots(cases, 4 * n, None))
        for n in (1, 2, 4, 8)
        if n <= gpus
    ]
    rows = compare(check, part, plans)
    first = rows["gpus-1"]
    check.found[f"{part}_speedup"] = {
        name: [first["wall_s"] / row["wall_s"], first["loop_s"] / row["loop_s"]]
        for name, row in rows.items()
    }


PARTS: dict[str, Callable[[Check], None]] = {
    part.__name__: part
    for part in (handles, same, engine, full, lockstep, paper, scaling, scaling_long)
}


def main() -> None:
    """Run the parts and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--slots", type=int, default=256, help="of the large runs")
    parser.add_argument("--cases", type=int, default=None, help="of the large runs; default: all")
    parser.add_argument("--model", type=Path, action="append", default=[], help="an ONNX file")
    parser.add_argument("--parts", default=",".join(PARTS), help="which, with commas")
    options = parser.parse_args()
    options.out = options.out.absolute()
    options.out.mkdir(parents=True, exist_ok=True)
    check = Check(options)
    for part in options.parts.split(","):
        started = time.monotonic()
        PARTS[part](check)
        check.found[f"{part}_s"] = round(time.monotonic() - started, 1)
        check.write()
    print(json.dumps(check.found, indent=1))
    sys.exit(1 if check.found["differs"] else 0)


if __name__ == "__main__":
    main()
