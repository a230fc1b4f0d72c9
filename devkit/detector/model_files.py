"""Detectors of perception variants of type ``network``: which files, which runtime."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from devkit.darknet.importer import darknet_model
from devkit.darknet.variant import ARCHITECTURES, published_cfg
from devkit.detector.description import read_description
from devkit.detector.detector import INTEGER_SUFFIX, Detector
from devkit.detector.runtime import ModelError, RuntimeName
from schemas.files.assets import file_digest
from schemas.sections.perception import NetworkPerception, file_fields, is_integer, is_model_path
from schemas.validation import suggest
from twin.base.errors import RefusedError

_SHIPPED = Path(__file__).parents[1] / "models"


def shipped_models() -> dict[str, Path]:
    """Name -> ONNX file of the models that come with the package, by name."""
    return {path.stem: path for path in sorted(_SHIPPED.glob("*.onnx"))}


def shipped_integer_models() -> dict[str, Path]:
    """Name -> file of the integer networks that come with the package, by name."""
    return {path.stem: path for path in sorted(_SHIPPED.glob(f"*{INTEGER_SUFFIX}"))}


def open_detector(
    variant: NetworkPerception,
    files: Mapping[str, str],
    device: str,
    size_px: tuple[int, int] | None = None,
) -> Detector:
    """Load and check the network of ``variant``.

    Args:
        variant: paths in it are absolute, or relative to the working folder.
        files: path -> SHA-256 that the file must have; files that are not in it may be any.
        device: where the worker computes, ``cpu`` or ``cuda:N``.
        size_px: width and height of the pictures that will come [px].

    Raises:
        UsageError: something is missing, damaged, another file than it should be, or cannot be run
            here; one line naming the file.
    """
    for path in file_fields(variant).values():
        _check_content(Path(path), files.get(path))
    runtime, place = runtime_of(variant, device)
    model_path = Path(variant.model)
    if variant.weights:
        cfg = model_path if is_model_path(variant.model) else _published(variant.model)
        names = Path(variant.names) if variant.names else None
        model = darknet_model(cfg, Path(variant.weights), names)
        return Detector(cfg, runtime=runtime, device=place, size_px=size_px, model=model)
    if not is_model_path(variant.model):
        model_path = _shipped(variant.model)
    description = read_description(Path(variant.description)) if variant.description else None
    return Detector(
        model_path, description=description, runtime=runtime, device=place, size_px=size_px
    )


def runtime_of(variant: NetworkPerception, device: str) -> tuple[RuntimeName, str]:
    """Runtime on a worker that computes on ``device``, and where: the device of
    :class:`devkit.detector.detector.Detector`."""
    on_gpu = device.startswith("cuda")
    if is_integer(variant.model):
        return "opencv", device if on_gpu else ""  # it is run by neither of the two
    if variant.runtime == "opencv" or (variant.runtime == "auto" and not on_gpu):
        return "opencv", ""
    return "onnxruntime", device if on_gpu else ""


def _check_content(path: Path, expected: str | None) -> None:
    try:
        other = expected is not None and file_digest(path) != expected
    except OSError as error:
        # It was there when the campaign was submitted.
        kind = ModelError if expected is None else RefusedError
        raise kind(f"{path}: {error.strerror or error}") from None
    if other:
        raise RefusedError(
            f"{path}: not the file that the campaign was submitted with; put it back, or run"
            " the campaign anew with another --out"
        )


def model_file(name_or_path: str) -> Path:
    """The file of a shipped model's name, or of a path.

    Raises:
        ModelError: neither.
    """
    if is_model_path(name_or_path) or Path(name_or_path).is_file():
        return Path(name_or_path)
    return _shipped(name_or_path)


def _shipped(name: str) -> Path:
    known = {**shipped_models(), **shipped_integer_models()}
    if name in known:
        return known[name]
    if name in ARCHITECTURES:
        raise ModelError(
            f"{name}: the published weights are not shipped; give 'weights: {name}.weights' beside"
            f" it, or import them (devkit import-darknet {published_cfg(name)} {name}.weights --out"
            f" {name}.onnx) and give 'model: {name}.onnx'"
        )
    there = suggest(name, list(known)) if known else "none is"
    raise ModelError(f"{name}: no such model is shipped; {there}; or give the path of a file")


def _published(name: str) -> Path:
    if name not in ARCHITECTURES:
        raise ModelError(
            f"{name}: no architecture that weights could belong to;"
            f" {suggest(name, list(ARCHITECTURES))}, or the path of a .cfg"
        )
    return published_cfg(name)
