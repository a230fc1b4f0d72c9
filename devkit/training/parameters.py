"""Everything that decides a trained detector, beside its data, software and device class."""

from __future__ import annotations

import contextlib
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from devkit.detector.labelled_images import DEFAULT_CLASSES, parse_classes
from schemas.validation import convert_all
from twin.base.errors import UsageError

Share = Annotated[float, Meta(ge=0, le=1)]
Scale = Annotated[float, Meta(ge=0, le=1000)]


class TrainingRecipe(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of a training; ``--set KEY=VALUE`` changes a value."""

    learning_rate: Annotated[float, Meta(gt=0, le=10)] = 2e-3
    """Peak of the schedule [-]: linear warm-up, then a cosine down to 1 %."""
    warmup_epochs: Annotated[float, Meta(ge=0, le=1000)] = 2.0
    weight_decay: Annotated[float, Meta(ge=0, le=10)] = 0.05
    """Weight decay of kernels, as AdamW has it: times the learning rate [-]."""
    ema_decay: Annotated[float, Meta(ge=0, lt=1)] = 0.998
    """Decay of the running mean of all weights, which is what is exported; per step [-]."""
    gradient_norm_max: Annotated[float, Meta(gt=0, le=1e9)] = 10.0
    """Longer gradients are shortened to this [-]."""

    jitter: Annotated[float, Meta(ge=0, le=0.9)] = 0.2
    """Share of the picture by which each of its edges moves at most, in or out [-]."""
    flip: Share = 0.5
    """Share of mirrored images [-]."""
    hue: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
    """Largest shift of hue, either way [turns]."""
    saturation: Annotated[float, Meta(ge=1, le=10)] = 1.5
    """Largest factor of saturation, or its inverse [-]."""
    exposure: Annotated[float, Meta(ge=1, le=10)] = 1.5
    """Largest factor of brightness, or its inverse [-]."""
    remaining_min: Share = 0.25
    """An object of which the edge leaves less is ignored [-]."""
    side_px_min: Annotated[float, Meta(ge=0, le=1000)] = 5.0
    """An object whose longer side is shorter after variation is ignored [px]."""

    box_loss: Literal["squared", "ciou"] = "squared"
    """``squared``: of the papers. ``ciou``: 1 - CIoU (Zheng et al., 2020)."""
    box_scale: Scale = 1.0
    object_scale: Scale = 1.0
    """Weight of objectness where there is an object; beside the 5 that YOLOv2's cfg has."""
    background_scale: Scale = 1.0
    class_scale: Scale = 1.0
    overlap_dropped: Share = 0.3
    """Boxes that overlap an ignored object more than this are no background [-]."""
    anchor_choices: Annotated[int, Meta(ge=1, le=9)] = 3
    """Anchors that an object may fall back on if another one has its place; 1: it is lost, as in
    the papers."""


class TrainingParameters(Struct, frozen=True, forbid_unknown_fields=True):
    """What was asked for, as ``training.yaml`` keeps it."""

    model: str
    """Architecture as ``yolov3-tiny-w25``, or a .cfg file."""
    classes: str = DEFAULT_CLASSES
    width: Annotated[int, Meta(ge=32, le=4096)] = 320
    height: Annotated[int, Meta(ge=32, le=4096)] = 192
    epochs: Annotated[int, Meta(ge=1, le=100_000)] = 60
    batch: Annotated[int, Meta(ge=1, le=4096)] = 64
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    anchors: Literal["data", "cfg"] = "data"
    """Fitted to the training images, or the cfg's own."""
    threads: Annotated[int, Meta(ge=1, le=1024)] = 1
    """Threads of the CPU; sums are split by them, so they decide the last bits."""
    validate_every: Annotated[int, Meta(ge=0, le=100_000)] = 10
    """Epochs between two scores on `held_out` in the log; 0: none. Changes no weight."""
    half: bool = False
    """Kernels are stored as float16."""
    recipe: TrainingRecipe = TrainingRecipe()


def parse_parameters(data: dict[str, Any], name: str) -> TrainingParameters:
    """Plain data -> parameters; ``name`` stands before the error.

    Raises:
        UsageError: the first mistake, one line.
    """
    parameters, mistakes = convert_all(data, TrainingParameters)
    if parameters is None:
        raise UsageError(mistakes[0].line(name))
    parse_classes(parameters.classes)
    return parameters


def parse_setting(text: str) -> tuple[str, Any]:
    """``KEY=VALUE`` of ``--set``; numbers are numbers.

    Raises:
        UsageError: no such form.
    """
    key, equals, value = text.partition("=")
    if not (key.strip() and equals and value.strip()):
        raise UsageError(f"--set '{text}': give KEY=VALUE, as in jitter=0.1")
    for number in (int, float):
        with contextlib.suppress(ValueError):
            return key.strip(), number(value)
    return key.strip(), value.strip()


def first_difference(begun: TrainingParameters, given: TrainingParameters) -> str | None:
    """``epochs 60, given 30`` of the first value that differs; None: they are the same."""
    old, new = _flat(begun), _flat(given)
    for key, value in old.items():
        if new[key] != value:
            return f"{key} {value}, given {new[key]}"
    return None


def _flat(parameters: TrainingParameters) -> dict[str, Any]:
    plain = msgspec.to_builtins(parameters)
    recipe = plain.pop("recipe")
    return {**plain, **recipe}
