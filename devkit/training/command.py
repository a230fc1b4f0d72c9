"""``devkit train``: a dataset in, a detector with its scores and its card out."""

from __future__ import annotations

import functools
import importlib.metadata
import json
import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from devkit.darknet.onnx_writer import describe, write_onnx
from devkit.darknet.sections import to_text
from devkit.detector.detector import Detector
from devkit.detector.labelled_images import (
    TESTS,
    DatasetHead,
    LabelledImages,
    parse_classes,
    read_head,
    read_labelled,
)
from devkit.detector.scoring import SELECTION, Scorecard, plain, score_detector
from devkit.training.architecture import cfg_digest, model_name, prepare, read_size
from devkit.training.card import write_card
from devkit.training.device import prepare_device
from devkit.training.examples import load_examples
from devkit.training.folder import CARD, SCORES, TrainingFolder
from devkit.training.loop import train
from devkit.training.parameters import TrainingParameters, parse_parameters, parse_setting
from devkit.training.steps import Trainer
from devkit.training.validation import validate
from twin.base.errors import UsageError
from twin.base.folder_lock import only_writer
from twin.base.progress import ProgressReport, progress
from twin.base.software import device_class, software_digest


@dataclass(frozen=True, slots=True)
class Trained:
    """Files and scores of a training."""

    model: str
    """The ONNX file."""
    card: str
    scores: dict[str, Any]
    """Scores by split, see :func:`devkit.detector.scoring.plain`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRequest:
    """A training as it is asked for; None and empty ones are what the folder says, or the usual."""

    data: Path
    out: Path
    plain: dict[str, Any]
    """Keys of :class:`TrainingParameters` with plain values, or None."""
    size: str | None = None
    """``WIDTHxHEIGHT``"""
    settings: tuple[str, ...] = ()
    """``KEY=VALUE`` each, of :class:`devkit.training.parameters.TrainingRecipe`."""
    device: str = "cpu"


def run_training(request: TrainingRequest) -> Trained:
    """Train, or go on with it.

    Raises:
        TwinError: a mistake in the request, or the folder or the data cannot be used; one line.
    """
    data = read_head(request.data)
    folder = TrainingFolder(request.out)
    head = folder.read_head()
    parameters = _parameters(request, head, data)
    device = prepare_device(request.device, parameters.threads)
    maker = {
        "software": software_digest(),
        "torch": str(torch.__version__),
        "device_class": device_class(request.device),
        "data": data.digest,
        "cpu": torch.backends.cpu.get_cpu_capability(),
        "cfg": cfg_digest(parameters.model),
    }
    if head is not None:
        folder.check(head, parameters, maker)
    images = read_labelled(data.path, ["train"], parse_classes(parameters.classes))
    _check_objects(data.path, images)
    sections, network = prepare(parameters, images)
    name = model_name(parameters.model)
    with only_writer(folder.path):
        folder.tidy()
        if not (head is not None and head.get("complete")):
            about = {**maker, **_about(data)}
            folder.write_head(parameters, about, {"complete": False})
            trainer = Trainer(network, parameters, device)
            with progress("train", "training", "steps") as report:
                images_seen = _train(trainer, parameters, folder, data, images, report)
            weights = trainer.mean.weights(images_seen)
            model = write_onnx(network, weights, images.names, half=parameters.half)
            folder.write(f"{name}.onnx", model.SerializeToString(deterministic=True))
            folder.write(f"{name}.cfg", to_text(sections).encode())
            cards = _score(folder.path / f"{name}.onnx", data, parameters)
            scores = {split: plain(card) for split, card in cards.items()}
            folder.write(SCORES, json.dumps(scores, indent=1).encode())
            card = write_card(name, parameters, network, data, about, cards)
            folder.write(CARD, card.encode())
            folder.write_head(parameters, about, {"complete": True})
        folder.remove_checkpoint()
    scores = json.loads((folder.path / SCORES).read_text())
    return Trained(str(folder.path / f"{name}.onnx"), str(folder.path / CARD), scores)


def _parameters(
    request: TrainingRequest, head: dict[str, Any] | None, data: DatasetHead
) -> TrainingParameters:
    values: dict[str, Any] = dict(head["parameters"]) if head else {}
    values |= {key: value for key, value in request.plain.items() if value is not None}
    if "model" not in values:
        raise UsageError("give --model, an architecture as yolov3-tiny-w25 or a .cfg file")
    if request.size is not None:
        values["width"], values["height"] = _size(request.size)
    elif head is None:
        size = read_size(values["model"]) or (data.recipe["width"], data.recipe["height"])
        values["width"], values["height"] = size
    if head is None and values.get("threads") is None:
        values["threads"] = len(os.sched_getaffinity(0))
    if request.settings:
        settings = dict(parse_setting(text) for text in request.settings)
        values["recipe"] = {**values.get("recipe", {}), **settings}
    return parse_parameters(values, "train")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if width.isdigit() and height.isdigit():
        return int(width), int(height)
    raise UsageError(f"--size '{text}': give WIDTHxHEIGHT, as in 320x192")


def _check_objects(folder: Path, images: LabelledImages) -> None:
    for index, name in enumerate(images.names):
        if not (~images.ignored & (images.class_id == index)).any():
            raise UsageError(
                f"{folder}: no '{name}' to learn from in its training images; make more images, or"
                " leave it out of --classes"
            )


def _train(
    trainer: Trainer,
    parameters: TrainingParameters,
    folder: TrainingFolder,
    data: DatasetHead,
    images: LabelledImages,
    report: ProgressReport,
) -> int:
    device = next(trainer.model.parameters()).device
    width, height = parameters.width, parameters.height
    examples = load_examples(images, width, height, device)
    check = None
    if data.images["held_out"] and parameters.validate_every:
        held_out = read_labelled(data.path, ["held_out"], parse_classes(parameters.classes))
        tests = load_examples(held_out, width, height, device).images
        description = describe(trainer.model.network, images.names)
        check = functools.partial(validate, trainer.mean, tests, held_out, description)
    return train(trainer, examples, parameters, folder, check, report)


def _score(model: Path, data: DatasetHead, parameters: TrainingParameters) -> dict[str, Scorecard]:
    """Scores of the exported file, by split."""
    detector = Detector(model, SELECTION)
    classes = parse_classes(parameters.classes)
    cards = {}
    for split in TESTS:
        if data.images[split]:
            images = read_labelled(data.path, [split], classes)
            with progress("train", f"scoring {split}", "images") as report:
                cards[split] = score_detector(detector, images, report)
    return cards


def _about(data: DatasetHead) -> dict[str, Any]:
    """Lines for people: what the data was, and other versions."""
    names = ("drivetwin", "numpy", "opencv-python-headless", "onnx")
    versions = {name: importlib.metadata.version(name) for name in names}
    return {
        "versions": {"python": platform.python_version(), **versions},
        "dataset": {
            "name": data.path.resolve().name,
            "seed": data.recipe["seed"],
            "images": data.images["train"],
            "command": data.command(),
        },
    }
