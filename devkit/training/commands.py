"""Commands of ``devkit`` that train detectors and say how well they see."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from devkit.detector.commands import DescriptionOption, Model, RuntimeChoice, RuntimeOption
from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError


class SplitChoice(StrEnum):
    """Images of a dataset; ``all`` are those that no training sees."""

    held_out = "held_out"
    other_scene = "other_scene"
    all = "all"
    train = "train"


class AnchorChoice(StrEnum):
    """See :class:`devkit.training.parameters.TrainingParameters`."""

    data = "data"
    cfg = "cfg"


ClassesOption = Annotated[
    str | None,
    typer.Option(
        help="Classes, with the dataset's categories that belong to them; others are ignored. "
        "Default car,truck=truck+bus,pedestrian,traffic_sign."
    ),
]


def train(
    data: Annotated[Path, typer.Argument(help="Folder that 'twin dataset' has written.")],
    out: Annotated[Path, typer.Option(help="Folder to write; one that is there goes on.")],
    model: Annotated[
        str | None,
        typer.Option(
            help="yolov2, yolov2-tiny, yolov3, yolov3-tiny, with -w25 behind it for 25 %"
            " of the width; or a .cfg file."
        ),
    ] = None,
    classes: ClassesOption = None,
    size: Annotated[
        str | None, typer.Option(help="Of the input; default: the cfg's, or the images'.")
    ] = None,
    epochs: Annotated[int | None, typer.Option(help="Default 60.")] = None,
    batch: Annotated[int | None, typer.Option(help="Images per step; default 64.")] = None,
    seed: Annotated[int | None, typer.Option(help="Decides everything; default 1.")] = None,
    anchors: Annotated[
        AnchorChoice | None, typer.Option(help="Fitted to the data (default), or the cfg's.")
    ] = None,
    half: Annotated[
        bool | None, typer.Option("--half", help="Store kernels as float16: half the file.")
    ] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", help="KEY=VALUE of the recipe, repeatable; docs/training.md."),
    ] = None,
    validate_every: Annotated[
        int | None, typer.Option(help="Epochs between scores on held_out; default 10, 0: none.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="Of the CPU; default: all. They decide the last bits.")
    ] = None,
    device: Annotated[str, typer.Option(help="Where to train: cpu or cuda:N.")] = "cpu",
    output: OutputOption = Output.human,
) -> None:
    """Train a detector from scratch on a dataset and write it as ONNX, with scores and a card.

    On a folder that is there, options left away are what it was begun with.
    """
    _check_torch()
    from devkit.training.command import TrainingRequest, run_training
    from devkit.training.device import memory_errors

    plain: dict[str, Any] = {
        "model": model,
        "classes": classes,
        "epochs": epochs,
        "batch": batch,
        "seed": seed,
        "anchors": anchors.value if anchors else None,
        "half": half,
        "validate_every": validate_every,
        "threads": threads,
    }
    request = TrainingRequest(
        data=data, out=out, plain=plain, size=size, settings=tuple(setting or ()), device=device
    )
    with memory_errors():
        trained = run_training(request)
    if output is Output.json:
        print(json.dumps(dataclasses.asdict(trained)))
        return
    print(f"{trained.model}: scores in {trained.card}")
    for split, scores in trained.scores.items():
        print(f"  {split}: {_summary(scores)}")


def evaluate(
    model: Model,
    data: Annotated[Path, typer.Argument(help="Folder that 'twin dataset' has written.")],
    split: Annotated[
        SplitChoice, typer.Option(help="Which images; all: held_out and other_scene.")
    ] = SplitChoice.held_out,
    classes: Annotated[
        str | None,
        typer.Option(
            help="The detector's classes and the dataset's categories that belong to them, e.g. "
            "car,truck=truck+bus,person=pedestrian; default: those of the same name, and buses "
            "are trucks."
        ),
    ] = None,
    description: DescriptionOption = None,
    runtime: RuntimeOption = RuntimeChoice.opencv,
    output: OutputOption = Output.human,
) -> None:
    """Score a detector on a dataset: average precision by class, hour and weather, and what it
    misses."""
    from devkit.detector.description import read_description
    from devkit.detector.detector import Detector
    from devkit.detector.labelled_images import TESTS, classes_for, read_head, read_labelled
    from devkit.detector.model_files import model_file
    from devkit.detector.score_tables import report
    from devkit.detector.scoring import SELECTION, plain, score_detector
    from twin.base.progress import progress

    described = read_description(description) if description else None
    detector = Detector(model_file(model), SELECTION, described, runtime.value)
    head = read_head(data)
    chosen = classes_for(detector.description.names, classes, model)
    splits = TESTS if split is SplitChoice.all else (split.value,)
    images = read_labelled(head.path, splits, chosen)
    with progress("evaluate", "scoring", "images") as advance:
        card = score_detector(detector, images, advance)
    if output is Output.json:
        ran = detector.runtime.removesuffix(" cpu")
        about = {"model": model, "data": str(data), "split": split.value, "runtime": ran}
        print(json.dumps({**about, **plain(card)}))
    else:
        print(report(card), end="")


def _summary(scores: dict[str, Any]) -> str:
    noon = scores["car_clear_noon"]
    classes = [f"{name} {_percent(one['ap'])}" for name, one in scores["classes"].items()]
    return (
        f"mAP@0.5 {_percent(scores['map50'])} ({', '.join(classes)});"
        f" car at clear noon {_percent(noon['ap'])},"
        f" large and visible ones {_percent(scores['moderate']['car_clear_noon']['ap'])}"
    )


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f}"


def _check_torch() -> None:
    if importlib.util.find_spec("torch") is None:
        raise UsageError("training needs torch; install it with: pip install 'drivetwin[train]'")
