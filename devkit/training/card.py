"""The model card of a trained detector: all that somebody needs to judge it or to make it again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from devkit.darknet.network import DarknetNetwork
from devkit.darknet.weights import float_count
from devkit.detector.labelled_images import DatasetHead, parse_classes
from devkit.detector.score_tables import failures, report
from devkit.detector.scoring import CONFIDENCE_SHOWN, Scorecard
from devkit.training.parameters import TrainingParameters, TrainingRecipe

_SPLIT = {
    "held_out": "Streets, vehicles and people that training did not see (`held_out`)",
    "other_scene": "A scene that training did not see (`other_scene`)",
}


def write_card(
    name: str,
    parameters: TrainingParameters,
    network: DarknetNetwork,
    data: DatasetHead,
    versions: Mapping[str, Any],
    cards: Mapping[str, Scorecard],
) -> str:
    """Text of a model's card, in Markdown.

    Args:
        name: of the model.
        parameters: of the training.
        network: what was trained.
        data: what it was trained on.
        versions: of software and device, as ``training.yaml`` has them.
        cards: scores of the exported file, by split.
    """
    parts = [
        f"# {name}\n",
        _what(parameters, network),
        "## Data\n",
        f"Images rendered by drivetwin, seed {data.recipe['seed']}:"
        f" {data.images['train']} to learn from.\n",
        f"```sh\n{data.command()}\n```\n",
        "## Training\n",
        f"```sh\n{training_command(data, parameters, name)}\n```\n",
        _versions(versions),
        "## Scores\n",
        "Of the exported file: average precision at an overlap of 0.5 in per cent, PASCAL VOC's"
        " way. Boxes that the dataset ignores (too small, hidden, in fog) and those of no class"
        f" count neither way. The last tables are the share of objects reported at confidence"
        f" {CONFIDENCE_SHOWN:g}.\n",
    ]
    for split, card in cards.items():
        parts += [f"### {_SPLIT[split]}\n", report(card)]
    if not cards:
        parts.append("None: the dataset has no images to test with.\n")
    parts.append("## Known failures\n")
    parts.append(
        "From the scores above; no image of a real camera was seen in training or in tests, so"
        " nothing is known about those.\n"
    )
    for split, card in cards.items():
        sentences = failures(card)
        parts.append(f"`{split}`:\n")
        parts.append("".join(f"- {sentence}\n" for sentence in sentences) or "- none stands out\n")
    parts += ["## Licence\n", "Apache-2.0. Trained on images of drivetwin alone.\n"]
    return "\n".join(parts)


def training_command(data: DatasetHead, parameters: TrainingParameters, name: str) -> str:
    """The ``devkit train`` command, with all that differs from the usual."""
    usual = TrainingParameters(model=parameters.model)
    words = [f"devkit train {data.path.resolve().name} --model {parameters.model} --out {name}"]
    words.append(f"--size {parameters.width}x{parameters.height}")
    for key in ("epochs", "batch", "seed", "threads"):
        words.append(f"--{key} {getattr(parameters, key)}")
    for key in ("classes", "anchors", "validate_every"):
        if getattr(parameters, key) != getattr(usual, key):
            words.append(f"--{key.replace('_', '-')} {getattr(parameters, key)}")
    if parameters.half:
        words.append("--half")
    plain = msgspec.to_builtins(TrainingRecipe())
    for key, value in msgspec.to_builtins(parameters.recipe).items():
        if value != plain[key]:
            words.append(f"--set {key}={value}")
    return " ".join(words)


def _what(parameters: TrainingParameters, network: DarknetNetwork) -> str:
    millions = sum(map(float_count, network.convolutions())) / 1e6
    classes = []
    for one in parse_classes(parameters.classes):
        others = one.categories != (one.label,)
        classes.append(f"{one.label} ({', '.join(one.categories)})" if others else one.label)
    anchors = ", ".join(
        f"{width:g}x{height:g}" for head in network.heads() for width, height in head.anchors_px
    )
    stored = "float16, computed in float32" if parameters.half else "float32"
    return (
        f"A detector of {', '.join(classes)} in images of {network.input.width}x"
        f"{network.input.height}, from scratch: {parameters.model}, {millions:.2f} M parameters"
        f" ({stored}), anchors {anchors} px. ONNX with its description in the metadata;"
        " runs with `devkit detect` and in every stack that names it.\n"
    )


def _versions(versions: Mapping[str, Any]) -> str:
    software = ", ".join(f"{name} {version}" for name, version in versions["versions"].items())
    return (
        f"On {versions['device_class']} with torch {versions['torch']}, {software};"
        f" software digest `{versions['software'][:16]}`, dataset digest"
        f" `{versions['data'][:16]}`. The same command gives the same file on such a device.\n"
    )
