"""Commands of ``devkit`` about detectors and the published logs."""

from __future__ import annotations

import dataclasses
import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from schemas.escape import escape
from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_FAILED, EXIT_PASS, UsageError

if TYPE_CHECKING:
    from devkit.replaying.parity import Parity
    from schemas.messages import Detection

LISTED_MAX = 20
"""Most rows that are listed for people; JSON lists all."""


class RuntimeChoice(StrEnum):
    """See :data:`devkit.detector.runtime.RuntimeName`."""

    opencv = "opencv"
    onnxruntime = "onnxruntime"


DescriptionOption = Annotated[
    Path | None, typer.Option(help="JSON about a model whose metadata has none.")
]
Model = Annotated[
    str, typer.Argument(help="Path of a model file, or a name that `devkit models` prints.")
]
RuntimeOption = Annotated[RuntimeChoice, typer.Option(help="What runs the network.")]


WidthOption = Annotated[
    int | None, typer.Option(min=1, max=8192, help="Of the network's input [px].")
]
HeightOption = Annotated[
    int | None, typer.Option(min=1, max=8192, help="Of the network's input [px].")
]


def import_darknet(
    cfg: Annotated[Path, typer.Argument(help="Darknet's description of the network, .cfg.")],
    weights: Annotated[Path, typer.Argument(help="Darknet's .weights.")],
    out: Annotated[Path, typer.Option(help="ONNX file to write, .onnx.")],
    names: Annotated[
        Path | None, typer.Option(help="Labels, one per line; COCO's if there are 80 classes.")
    ] = None,
    width: WidthOption = None,
    height: HeightOption = None,
    half: Annotated[bool, typer.Option("--half", help="Store kernels as float16.")] = False,
    output: OutputOption = Output.human,
) -> None:
    """Write a Darknet detector as ONNX: region and yolo heads of YOLOv2 and YOLOv3."""
    from devkit.darknet.importer import import_darknet as run

    written = run(cfg, weights, out, names, width, height, half=half)
    if output is Output.json:
        print(json.dumps(dataclasses.asdict(written)))
        return
    print(
        f"{written.out}: {written.layers} layers, {written.parameters / 1e6:.2f} M parameters,"
        f" input {written.width}x{written.height}, {len(written.classes)} classes"
    )


def darknet_cfg(
    name: Annotated[
        str, typer.Argument(help="yolov2, yolov2-tiny, yolov3 or yolov3-tiny; -w25: 25 % as wide.")
    ],
    width_multiple: Annotated[float, typer.Option(help="Share of the channels, 0 to 1.")] = 1.0,
    classes: Annotated[int | None, typer.Option(min=1, help="Number of classes.")] = None,
    width: WidthOption = None,
    height: HeightOption = None,
) -> None:
    """Print the .cfg of a published architecture, or of a narrower variant for other classes."""
    from devkit.darknet.build import build_network
    from devkit.darknet.sections import to_text
    from devkit.darknet.variant import architecture

    sections = architecture(
        name, width_multiple=width_multiple, classes=classes, width=width, height=height
    )
    build_network(sections, name)  # a size that does not fit is found here
    print(to_text(sections), end="")


def models(output: OutputOption = Output.human) -> None:
    """List the networks that come with the package: names for `model` in a campaign file."""
    from devkit.detector.model_files import shipped_integer_models, shipped_models

    shipped = dict(sorted({**shipped_models(), **shipped_integer_models()}.items()))
    if output is Output.json:
        print(json.dumps({name: str(path) for name, path in shipped.items()}))
        return
    for name, path in shipped.items():
        card = path.with_name(f"{name.removesuffix('-int8')}.md")
        print(f"{name:20} {path.stat().st_size / 1e6:6.1f} MB  {card if card.is_file() else ''}")
    if not shipped:
        print("none is shipped with this version; `devkit import-darknet --help`", file=sys.stderr)


def check_models(
    device: Annotated[str, typer.Option(help="Where the worker computes: cpu or cuda:N.")] = "cpu",
    width: Annotated[int, typer.Option(min=1, help="Of the pictures [px].")] = 640,
    height: Annotated[int, typer.Option(min=1, help="Of the pictures [px].")] = 360,
) -> None:
    """Load perception variants, as a worker would, and say what is wrong.

    Reads JSON from standard input, name -> variant with absolute paths, and writes JSON, name ->
    {"error": one line, empty: it works; "runtime": what would run it}. The exit code is 0 either
    way; `conductor` asks this before it leases a case.
    """
    from devkit.perception import Setting, build_perception
    from schemas.kinds.perception import perception_kind, perception_kinds
    from schemas.sections.perception import Perception

    try:
        variants = msgspec.json.decode(sys.stdin.buffer.read(), type=dict[str, Perception])
    except msgspec.DecodeError as error:
        raise UsageError(f"standard input: {error}") from None
    answer = {}
    for name, variant in variants.items():
        try:
            perception = build_perception(variant, Setting(device, (width, height)))
            answer[name] = {"error": "", "runtime": perception.runtime}
        except (UsageError, ValueError) as error:
            answer[name] = {"error": str(error), "runtime": ""}
        except Exception as error:
            plugin = perception_kinds().brought.get(perception_kind(variant).name)
            if plugin is None:
                raise
            why = f"{' '.join(plugin)}: {type(error).__name__}: {error}"
            answer[name] = {"error": escape(why), "runtime": ""}
    print(json.dumps(answer))


def detect(
    model: Model,
    images: Annotated[list[Path], typer.Argument(help="Images, e.g. PNG or JPEG.")],
    confidence_min: Annotated[float, typer.Option(min=0.001, max=0.999)] = 0.25,
    overlap_max: Annotated[float, typer.Option(min=0, max=1)] = 0.4,
    description: DescriptionOption = None,
    runtime: RuntimeOption = RuntimeChoice.opencv,
    output: OutputOption = Output.human,
) -> None:
    """Print what a detector sees in images."""
    from devkit.detector.decode import Selection
    from devkit.detector.description import read_description
    from devkit.detector.detector import Detector
    from devkit.detector.model_files import model_file
    from twin.base.picture_file import read_picture
    from twin.base.progress import bars, steps

    detector = Detector(
        model_file(model),
        Selection(confidence_min=confidence_min, overlap_max=overlap_max),
        read_description(description) if description else None,
        runtime.value,
    )
    found: list[tuple[Path, list[Detection]]] = []
    try:
        with bars():
            for path in steps("images", images):
                found.append((path, detector.detect(read_picture(path)[None]).of(0)))
    finally:  # also of those before one that cannot be read
        _print_detections(found, output)


def _print_detections(found: list[tuple[Path, list[Detection]]], output: Output) -> None:
    for path, detections in found:
        if output is Output.json:
            print(json.dumps({"image": str(path), "detections": msgspec.to_builtins(detections)}))
            continue
        print(f"{path}: {counted(len(detections), 'object')}")
        for d in detections:
            size = f"{d.width_px:.0f}x{d.height_px:.0f}"
            print(f"  {d.label} {d.confidence:.2f} at {d.x_px:.0f},{d.y_px:.0f} {size} px")


def parity(
    folder: Annotated[
        Path,
        typer.Argument(
            help="Folder with batch_N/aeb_metrics_sim_inst_M.csv or batch_N.tar.gz of them."
        ),
    ],
    output: OutputOption = Output.human,
) -> None:
    """Feed the published AEB logs to the rules `autodrive`: rows that agree, of all rows."""
    from devkit.replaying.parity import run_parity

    result = run_parity(folder)
    if output is Output.json:
        print(json.dumps(dataclasses.asdict(result)))
    else:
        _print_parity(result)
    raise typer.Exit(EXIT_FAILED if result.disagreements else EXIT_PASS)


def _print_parity(result: Parity) -> None:
    print(f"{result.agreeing} / {result.rows} rows agree, in {result.files} logs")
    for model, (agreeing, rows) in sorted(result.by_model.items()):
        print(f"  {model or 'no model named'}: {agreeing} / {rows}")
    for one in result.disagreements[:LISTED_MAX]:
        box = f"{one.label} {one.confidence_percent:g} % {one.size_px2:g} px^2" if one.label else ""
        print(
            f"{one.file}:{one.line}: {box or 'nothing seen'}:"
            f" logged AEB {one.logged:d}, the rule says {one.rule:d}"
        )
    for row in result.unreadable[:LISTED_MAX]:
        print(f"{row.file}:{row.line}: not judged: {row.reason}")
    for file in result.refused[:LISTED_MAX]:
        print(f"{file.file}: not judged: {file.reason}")
    listed = (result.disagreements, result.unreadable, result.refused)
    hidden = sum(max(len(lines) - LISTED_MAX, 0) for lines in listed)
    if hidden:
        print(f"{hidden} more lines; --output json lists all")
