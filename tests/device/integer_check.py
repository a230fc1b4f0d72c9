"""Checks and measures the integer networks on one device; needs no test runner.

    PYTHONPATH=tests python tests/device/integer_check.py --device cuda:0 --out FOLDER

For every shipped integer network, or those given with ``--model``: the SHA-256 of its raw heads for
pictures that are the same everywhere, whether they are the same bits on the CPU, in batches of 1,
3 and 64, from device memory and beside other neighbours, and pictures per second with the float
network beside it. Writes ``FOLDER/integer_check.json``; ``--against`` compares the digests with
such a file of another machine. Exit code 1: something differs that must not.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from foreign_memory import Elsewhere

from devkit.detector.decode import Selection
from devkit.detector.detector import Detector
from devkit.detector.model_files import shipped_integer_models, shipped_models
from devkit.images import Images
from schemas.messages import Detection
from twin.base.software import device_class

CAMERA_PX = (640, 360)
BATCH = 32


def pictures(count: int, seed: int) -> np.ndarray:
    """Blocks of random colours under noise, uint8 [count, H, W, 3]; whole numbers throughout."""
    rng = np.random.default_rng(seed)
    width, height = CAMERA_PX
    blocks = rng.integers(0, 256, (count, height // 40, width // 40, 3))
    smooth = blocks.repeat(40, axis=1).repeat(40, axis=2)
    noise = rng.integers(-8, 9, smooth.shape)
    return np.clip(smooth + noise, 0, 255).astype(np.uint8)


def digest(heads: dict[str, np.ndarray]) -> str:
    """SHA-256 of raw heads."""
    whole = hashlib.sha256()
    for name in sorted(heads):
        whole.update(f"{name} {heads[name].shape}".encode())
        whole.update(heads[name].tobytes())
    return whole.hexdigest()


def digest_of_boxes(boxes: list[list[Detection]]) -> str:
    """SHA-256 of what a stack is told."""
    return hashlib.sha256(repr(boxes).encode()).hexdigest()


def on_device(array: np.ndarray, device: str) -> Any:
    """The array in the device's memory; on the CPU an object of which only the address is known."""
    if device == "cpu":
        return Elsewhere(array)
    import warp as wp

    there = wp.array(array, dtype=wp.uint8, device=device)
    wp.synchronize_device(device)
    return there


def sameness(path: Path, device: str, count: int) -> tuple[dict[str, str], dict[str, bool]]:
    """Digests, and what must not change a bit."""
    there = Detector(path, Selection(confidence_min=0.1), device=device, size_px=CAMERA_PX)
    images = pictures(count, 1)
    heads = there.raw(images)
    found = {
        "heads": digest(heads),
        "boxes": digest_of_boxes(there.detect(images).each(count)),
    }
    order = np.random.default_rng(3).permutation(count)
    rows = [int(row) for row in order[:21]]
    placed = on_device(images, device)

    def whole(batch: int) -> str:
        parts = [there.raw(images[first : first + batch]) for first in range(0, count, batch)]
        return digest({name: np.concatenate([p[name] for p in parts]) for name in parts[0]})

    def picked(given: list[int]) -> str:
        return digest({name: array[given] for name, array in heads.items()})

    host = Detector(path, Selection(confidence_min=0.1))
    same = {
        "cpu": digest(host.raw(images)) == found["heads"],
        "cpu_boxes": digest_of_boxes(host.detect(images).each(count)) == found["boxes"],
        **{f"batch_{batch}": whole(batch) == found["heads"] for batch in (1, 3, 64)},
        "permutation": digest(there.raw(images[order])) == picked(order.tolist()),
        "device_memory": digest(there.raw(Images(placed, rows))) == picked(rows),
    }
    return found, same


def speed(path: Path, device: str, seconds: float, runtime: str) -> dict[str, float]:
    """Pictures per second, a batch at a time; with boxes, too."""
    kind: Any = {"runtime": runtime} if runtime else {}
    detector = Detector(path, device=device, size_px=CAMERA_PX, **kind)
    given = Images(on_device(pictures(BATCH, 7), device), range(BATCH))
    return {
        "heads": rate(lambda: detector.raw(given), seconds),
        "boxes": rate(lambda: detector.detect(given), seconds),
    }


def rate(call: Callable[[], object], seconds: float) -> float:
    """Pictures per second."""
    call()
    started, calls = time.perf_counter(), 0
    while time.perf_counter() - started < seconds:
        call()
        calls += 1
    return round(calls * BATCH / (time.perf_counter() - started), 1)


def main() -> None:
    """Run all and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--model", type=Path, action="append", default=[])
    parser.add_argument("--pictures", type=int, default=96)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--against", type=Path, help="integer_check.json of another machine")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    models = {path.stem: path for path in options.model} or shipped_integer_models()
    floats = shipped_models()
    rows: dict[str, Any] = {}
    for name, path in models.items():
        found, same = sameness(path, options.device, options.pictures)
        rates = {"integer": speed(path, options.device, options.seconds, "")}
        beside = floats.get(name.removesuffix("-int8"))
        if beside is not None:
            rates["float"] = speed(beside, options.device, options.seconds, "onnxruntime")
        rows[name] = {"sha256": found, "same_to_the_last_bit": same, "pictures_per_s": rates}
        print(f"{name}: {json.dumps(rows[name])}", file=sys.stderr, flush=True)
    passed = all(all(row["same_to_the_last_bit"].values()) for row in rows.values())
    result: dict[str, Any] = {
        "device": device_class(options.device),
        "pictures": options.pictures,
        "models": rows,
    }
    if options.against:
        other = json.loads(options.against.read_text())
        differs = [
            name
            for name in rows
            if other["pictures"] != options.pictures
            or other["models"].get(name, {}).get("sha256") != rows[name]["sha256"]
        ]
        result["against"] = {"device": other["device"], "differs": differs}
        passed = passed and not differs
    result["passed"] = passed
    text = json.dumps(result, indent=1)
    (options.out / "integer_check.json").write_text(text)
    print(text)
    sys.exit(0 if passed else 1)


if __name__ == "__main__":
    main()
