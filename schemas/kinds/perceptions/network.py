"""A neural network that sees pictures."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.perception import PerceptionKind

MODEL_SUFFIXES = (".onnx", ".cfg", ".integer")
"""Endings of a model's name that make it the path of a file."""

INTEGER_ENDINGS = (".integer", "-int8")
"""Endings of the files and of the shipped names of integer networks."""

_PATHS = ("weights", "names", "description")


class NetworkPerception(
    Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="network"
):
    """A neural network that sees the pictures of the main camera and nothing else."""

    model: Annotated[str, Meta(min_length=1)]
    """Name of a shipped model (`devkit models`), path of an ONNX file or of an integer network, or
    path of a Darknet .cfg (or a published architecture's name) with `weights`."""
    weights: str = ""
    """Path of a Darknet network's .weights."""
    names: str = ""
    """Path of its labels, one per line; COCO's if there are 80 classes."""
    description: str = ""
    """Path of the JSON that describes an ONNX file whose metadata do not."""
    confidence_min: Annotated[float, Meta(gt=0, lt=1)] = 0.25
    """Least confidence that is reported [-]; the planner's own threshold lies above."""
    overlap_max: Annotated[float, Meta(ge=0, le=1)] = 0.4
    """Intersection over union above which the less confident box goes [-]."""
    across_classes: bool = False
    """Boxes of different classes suppress each other, too, as in the AutoDRIVE script."""
    order: Literal["confidence", "place"] = "confidence"
    """Order of the boxes in a frame: the most confident first, or by their place in the network's
    output, which `rules: autodrive` looks at."""
    runtime: Literal["auto", "opencv", "onnxruntime"] = "auto"
    """What runs it. `auto`: OpenCV on workers that simulate on the CPU, ONNX Runtime on those with
    a GPU; an integer network runs in kernels of its own, with the same bits on both."""

    def __post_init__(self) -> None:
        """Refuse keys that the kind of model would not look at."""
        if self.model.endswith(".cfg") and not self.weights:
            raise ValueError("weights: missing; a Darknet .cfg needs its .weights")
        if is_integer(self.model):
            self._check_integer()
        if self.model.endswith(".onnx") and (self.weights or self.names):
            raise ValueError("weights and names belong to a Darknet .cfg, not to an ONNX file")
        if self.names and not self.weights:
            raise ValueError("names belong to a Darknet network, which needs its weights")
        if self.weights and self.description:
            raise ValueError("description belongs to an ONNX file, not to a Darknet .cfg")

    def _check_integer(self) -> None:
        given = [name for name in _PATHS if getattr(self, name)]
        if given:
            raise ValueError(f"{given[0]}: not for an integer network, whose file has everything")
        if self.runtime != "auto":
            raise ValueError(
                f"runtime: given {self.runtime}; an integer network runs in kernels of its own,"
                " leave the key out"
            )


def is_integer(model: str) -> bool:
    """Whether a network's ``model`` is an integer network."""
    return model.endswith(INTEGER_ENDINGS)


def is_model_path(model: str) -> bool:
    """Whether a network's ``model`` is the path of a file."""
    return "/" in model or model.endswith(MODEL_SUFFIXES)


def _files(variant: NetworkPerception) -> dict[str, str]:
    files = {"model": variant.model} if is_model_path(variant.model) else {}
    files.update((name, getattr(variant, name)) for name in _PATHS if getattr(variant, name))
    return files


def _shipped(variant: NetworkPerception) -> dict[str, str]:
    if variant.weights or is_model_path(variant.model):
        return {}
    suffix = ".integer" if is_integer(variant.model) else ".onnx"
    return {f"model {variant.model}": f"devkit/models/{variant.model}{suffix}"}


KIND = PerceptionKind(
    name="network",
    config=NetworkPerception,
    implementation="devkit.detector.network_perception:DetectorPerception",
    files=_files,
    loaded="model",
    chosen=("confidence_min", "overlap_max", "across_classes", "order"),
    shipped=_shipped,
    portable=lambda variant: is_integer(variant.model),
    packages=("cv2",),
    installed_by="drivetwin-worker[networks]",
)
