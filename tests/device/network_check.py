"""Checks and measures the detectors on one device in one call; needs no test runner.

    PYTHONPATH=tests python tests/device/network_check.py --device cuda:0 --out FOLDER

For every model (the shipped ones, or the four architectures at a quarter of their width with random
weights, and those given with ``--model``): whether an image's raw heads are the same to the last
bit at another place, beside other neighbours, in a batch that is filled up, in another process's
session and from device memory; how far the boxes are from OpenCV's on the CPU; images per second.
Writes ``FOLDER/network_check.json``. Exit code 1: something differs that must not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from darknet_oracle import random_weights
from foreign_memory import Elsewhere

from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import ARCHITECTURES, architecture_network
from devkit.detector.decode import DetectionBatch, Selection
from devkit.detector.detector import Detector
from devkit.detector.frames import MICRO_BATCH
from devkit.detector.model_files import shipped_models
from devkit.images import Images

LABELS = ["car", "truck", "pedestrian", "traffic_sign"]
INPUT_PX = (320, 192)
CAMERA_PX = (640, 360)

CONFIDENCE_TOLERANCE = 1e-3
BOX_TOLERANCE_PX = 0.5
"""Boxes of the CPU and of the device agree within these [-, px]..."""
AGREEING_MIN = 0.99
"""...at least this share of them; the rest stands at the edge of a threshold [-]."""


def models(folder: Path, given: list[Path]) -> dict[str, Path]:
    """Name -> ONNX file."""
    found = {**shipped_models(), **{path.stem: path for path in given}}
    if found:
        return found
    for name in ARCHITECTURES:
        width, height = INPUT_PX
        network = architecture_network(f"{name}-w25", classes=4, width=width, height=height)
        path = folder / f"{name}-w25-random.onnx"
        onnx.save(write_onnx(network, random_weights(network, 1), LABELS), path)
        found[path.stem] = path
    return found


def pictures(count: int, size_px: tuple[int, int], seed: int) -> np.ndarray:
    """Smooth random images, uint8 [count, H, W, 3]."""
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 256, (count, 9, 16, 3), dtype=np.uint8)
    return np.stack([cv2.resize(image, size_px) for image in small])


def on_device(array: np.ndarray, device: str) -> Any:
    """The array in the device's memory; on the CPU an object of which only the address is known."""
    if device == "cpu":
        return Elsewhere(array)
    import warp as wp

    there = wp.array(array, dtype=wp.uint8, device=device)
    wp.synchronize_device(device)
    return there


def bytes_equal(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    """Whether all heads are the same to the last bit."""
    return all(one[name].tobytes() == other[name].tobytes() for name in one)


def rows_of(heads: dict[str, np.ndarray], rows: Any) -> dict[str, np.ndarray]:
    """Heads of some of the images."""
    return {name: array[rows] for name, array in heads.items()}


def sameness(path: Path, device: str) -> dict[str, bool]:
    """What must not change an image's heads."""
    first = Detector(path, runtime="onnxruntime", device=device, size_px=CAMERA_PX)
    images, others = (pictures(MICRO_BATCH, CAMERA_PX, seed) for seed in (1, 2))
    expected = first.raw(images)
    order = np.random.default_rng(3).permutation(MICRO_BATCH)
    mixed = others.copy()
    mixed[::5] = images[::5]
    there = on_device(images, device)
    rows = [int(row) for row in order[:21]]
    again = Detector(path, runtime="onnxruntime", device=device, size_px=CAMERA_PX)
    larger = np.concatenate([others, images, others])[: 2 * MICRO_BATCH + 9]
    return {
        "run_again": bytes_equal(first.raw(images), expected),
        "another_session": bytes_equal(again.raw(images), expected),
        "permutation": bytes_equal(first.raw(images[order]), rows_of(expected, order)),
        "neighbours": bytes_equal(
            rows_of(first.raw(mixed), slice(None, None, 5)),
            rows_of(expected, slice(None, None, 5)),
        ),
        "filled_up": all(
            bytes_equal(first.raw(images[:n]), rows_of(expected, slice(n))) for n in (1, 3, 33)
        ),
        "several_batches": bytes_equal(
            rows_of(first.raw(larger), slice(MICRO_BATCH, 2 * MICRO_BATCH)), expected
        ),
        "device_memory": bytes_equal(first.raw(Images(there, rows)), rows_of(expected, rows)),
    }


def agreement(path: Path, device: str) -> dict[str, float]:
    """How far the device's boxes are from those of OpenCV on the CPU."""
    images = pictures(MICRO_BATCH, CAMERA_PX, 5)
    selection = Selection(confidence_min=0.1)
    there = Detector(path, selection, runtime="onnxruntime", device=device, size_px=CAMERA_PX)
    here = Detector(path, selection)
    raw = [detector.raw(images) for detector in (here, there)]
    worst = max(
        float(np.abs(raw[0][name] - raw[1][name]).max() / raw[0][name].std()) for name in raw[0]
    )
    one, other = _boxes(here.detect(images)), _boxes(there.detect(images))
    both = one.keys() & other.keys()
    confidence = [abs(one[key][0] - other[key][0]) for key in both]
    box = [float(np.abs(one[key][1] - other[key][1]).max()) for key in both]
    near = [
        c <= CONFIDENCE_TOLERANCE and b <= BOX_TOLERANCE_PX
        for c, b in zip(confidence, box, strict=True)
    ]
    union = len(one.keys() | other.keys())
    return {
        "boxes": len(one),
        "head_difference_max_std": worst,
        "confidence_difference_max": max(confidence, default=0.0),
        "box_difference_max_px": max(box, default=0.0),
        "agreeing": sum(near) / union if union else 1.0,
    }


def _boxes(found: DetectionBatch) -> dict[tuple[int, int, int], tuple[float, np.ndarray]]:
    """(image, place, class) -> confidence and box."""
    keys = zip(found.image.tolist(), found.place.tolist(), found.class_id.tolist(), strict=True)
    values = zip(found.confidence.tolist(), found.box_px, strict=True)
    return dict(zip(keys, values, strict=True))


def speed(path: Path, device: str, seconds: float) -> dict[str, float]:
    """Images per second, a full batch at a time."""
    found = {}
    for size_px in (INPUT_PX, CAMERA_PX):
        detector = Detector(path, runtime="onnxruntime", device=device, size_px=size_px)
        images = pictures(MICRO_BATCH, size_px, 7)
        here, there = (Images(a, range(MICRO_BATCH)) for a in (images, on_device(images, device)))
        size = f"{size_px[0]}x{size_px[1]}"
        found[f"{size}_from_host"] = rate(lambda d=detector, i=here: d.raw(i), seconds)
        found[f"{size}_on_device"] = rate(lambda d=detector, i=there: d.raw(i), seconds)
        found[f"{size}_on_device_with_boxes"] = rate(
            lambda d=detector, i=there: d.detect(i), seconds
        )
    return found


def rate(call: Callable[[], object], seconds: float) -> float:
    """Images per second."""
    call()
    started, calls = time.perf_counter(), 0
    while time.perf_counter() - started < seconds:
        call()
        calls += 1
    return round(calls * MICRO_BATCH / (time.perf_counter() - started), 1)


def main() -> None:
    """Run all and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--model", type=Path, action="append", default=[], help="an ONNX file")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    import onnxruntime

    found: dict[str, Any] = {
        "device": options.device,
        "onnxruntime": onnxruntime.__version__,
        "micro_batch": MICRO_BATCH,
        "tolerance": {
            "confidence": CONFIDENCE_TOLERANCE,
            "box_px": BOX_TOLERANCE_PX,
            "agreeing": AGREEING_MIN,
        },
        "models": {},
    }
    passed = True
    for name, path in models(options.out, options.model).items():
        row = {
            "same_to_the_last_bit": (same := sameness(path, options.device)),
            "opencv_cpu_and_device": (near := agreement(path, options.device)),
            "images_per_s": speed(path, options.device, options.seconds),
        }
        passed = passed and all(same.values()) and near["agreeing"] >= AGREEING_MIN
        found["models"][name] = row
        print(f"{name}: {json.dumps(row)}", file=sys.stderr, flush=True)
    found["passed"] = passed
    text = json.dumps(found, indent=1)
    (options.out / "network_check.json").write_text(text)
    print(text)
    sys.exit(0 if passed else 1)


if __name__ == "__main__":
    main()
