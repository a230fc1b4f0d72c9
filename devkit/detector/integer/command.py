"""``devkit quantize``: a float detector -> an integer network."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from devkit.detector.commands import DescriptionOption, Model
from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_FAILED, UsageError
from twin.base.files import write_atomic

if TYPE_CHECKING:
    import numpy as np

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
"""Endings of pictures in a folder."""

LOSS_MAX_POINTS = 1.0
"""Points of mean average precision that ``--check`` lets an integer network lose [%]."""


ROUNDS = 20
"""Times that a picture is seen by each to find the least time."""


@dataclass(frozen=True, slots=True)
class QuantizeScore:
    """How one of the two networks does on a dataset."""

    map50: float
    """Mean average precision at an overlap of 0.5 [-]."""
    classes: dict[str, float | None]
    """Average precision by class [-]."""
    picture_ms: float
    """Least time of a picture on one core, resize and boxes included [ms]."""


def quantize(
    model: Model,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write, .integer.")],
    calibrate: Annotated[
        Path,
        typer.Option(help="Folder of pictures, or of `twin dataset` (those of its training)."),
    ],
    pictures: Annotated[
        int, typer.Option(min=1, max=10_000, help="Pictures of it that are looked at.")
    ] = 128,
    score: Annotated[
        Path | None,
        typer.Option(help="Dataset on whose held_out and other_scene pictures both are scored."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Exit code 1 if it loses more than a point of mAP.")
    ] = False,
    description: DescriptionOption = None,
    output: OutputOption = Output.human,
) -> None:
    """Write a float detector as an integer network: 8 bits, the same results on CPU and GPU."""
    from devkit.detector.description import read_description
    from devkit.detector.detector import INTEGER_SUFFIX
    from devkit.detector.integer.network_file import encode_network
    from devkit.detector.integer.quantize import quantize as run
    from devkit.detector.model_files import model_file

    if out.suffix != INTEGER_SUFFIX:
        raise UsageError(f"--out {out}: expected a name that ends in {INTEGER_SUFFIX}")
    if check and score is None:
        raise UsageError("--check: nothing to check; give --score DATASET, too")
    source = model_file(model)
    if source.suffix == INTEGER_SUFFIX:
        raise UsageError(f"{source}: is an integer network already; give the float one")
    described = read_description(description) if description else None
    network = run(source, read_pictures(calibrate, pictures), described)
    data = encode_network(network)
    try:
        write_atomic(out, data)
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror or error}") from None
    sides = compare(source, out, score, described) if score else {}
    lost = 100.0 * (sides["float"].map50 - sides["integer"].map50) if sides else 0.0
    if output is Output.json:
        plain = {name: asdict(side) for name, side in sides.items()}
        print(json.dumps({"out": str(out), "bytes": len(data), "origin": network.origin, **plain}))
    else:
        print(f"{out}: {len(network.steps)} steps, {len(data) / 1e6:.2f} MB, of {network.origin}")
        for name, side in sides.items():
            print(f"  {name:8} {_line(side)}")
        if sides:
            ratio = sides["integer"].picture_ms / sides["float"].picture_ms
            print(f"  integer loses {lost:.2f} points of mAP and takes {ratio:.2f} of the time")
    if check and lost > LOSS_MAX_POINTS:
        raise typer.Exit(EXIT_FAILED)


def read_pictures(folder: Path, most: int) -> list[np.ndarray]:
    """Up to ``most`` pictures of a folder, evenly spread over the order of their names.

    Raises:
        UsageError: no such folder, no picture in it, or one that cannot be read; one line.
    """
    from devkit.detector.image_files import read_images
    from devkit.detector.labelled_images import HEAD, read_head

    if (folder / HEAD).exists():
        read_head(folder)  # an unfinished dataset would be another one tomorrow
    training = folder / "images" / "train"
    place = training if training.is_dir() else folder
    try:
        paths = sorted(path for path in place.iterdir() if path.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise UsageError(f"--calibrate {folder}: {error.strerror or error}") from None
    if not paths:
        raise UsageError(
            f"--calibrate {folder}: no picture ({', '.join(SUFFIXES)}); make some with 'twin"
            " dataset', or give another folder"
        )
    count = min(most, len(paths))
    chosen = [paths[number * len(paths) // count] for number in range(count)]
    return [picture for turn in read_images(chosen) for picture in turn]


def compare(source: Path, made: Path, data: Path, described: Any) -> dict[str, QuantizeScore]:
    """Scores and times of both networks on the pictures that training does not see.

    Raises:
        UsageError: no dataset, or one without a picture; one line.
    """
    import cv2

    from devkit.detector.detector import Detector
    from devkit.detector.labelled_images import TESTS, classes_for, read_head, read_labelled
    from devkit.detector.scoring import SELECTION, score_detector
    from twin.base.picture_file import read_picture
    from twin.base.progress import progress

    head = read_head(data)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        paths = {"float": source, "integer": made}
        detectors = {name: Detector(path, SELECTION, described) for name, path in paths.items()}
        names = detectors["float"].description.names
        images = read_labelled(head.path, TESTS, classes_for(names, None, str(source)))
        ms = _least_ms(detectors, read_picture(images.paths[0]))
        sides = {}
        for name, detector in detectors.items():
            with progress("quantize", f"scoring {name}", "images") as advance:
                result = score_detector(detector, images, advance).evaluation.all
            classes = {label: one.ap for label, one in result.classes.items()}
            sides[name] = QuantizeScore(result.mean_ap or 0.0, classes, ms[name])
    finally:
        cv2.setNumThreads(threads)
    return sides


def _least_ms(detectors: Mapping[str, Any], picture: np.ndarray) -> dict[str, float]:
    """Least time of a picture of every detector, in turns: other work on the machine slows all."""
    least = dict.fromkeys(detectors, math.inf)
    for _ in range(ROUNDS):
        for name, detector in detectors.items():
            started = time.perf_counter()
            detector.detect([picture])
            least[name] = min(least[name], 1e3 * (time.perf_counter() - started))
    return least


def _line(side: QuantizeScore) -> str:
    shares = {"mAP@0.5": side.map50, **side.classes}
    words = [f"{k} {'-' if v is None else f'{100 * v:.1f}'}" for k, v in shares.items()]
    return f"{', '.join(words)}; {side.picture_ms:.1f} ms per picture"
