"""``devkit import-darknet``: two Darknet files in, one ONNX file out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from devkit.darknet.build import read_network
from devkit.darknet.network import DarknetNetwork
from devkit.darknet.sections import DarknetError
from devkit.darknet.variant import coco_names
from devkit.darknet.weights import Weights, float_count, read_weights
from schemas.files.regular_file import open_regular

NAMES_BYTES_MAX = 1 << 20
"""A larger file is no list of names [bytes]."""


@dataclass(frozen=True, slots=True)
class ImportedDetector:
    """Figures of an import."""

    out: str
    layers: int
    parameters: int
    width: int
    height: int
    classes: list[str]
    seen: int
    """Images seen in training, as the weights file says."""


def import_darknet(
    cfg: Path,
    weights: Path,
    out: Path,
    names: Path | None = None,
    width: int | None = None,
    height: int | None = None,
    *,
    half: bool = False,
) -> ImportedDetector:
    """Read ``cfg`` and ``weights``, write the ONNX file ``out``.

    Args:
        names: one label per line; without it COCO's for 80 classes.
        width: of the network's input instead of the cfg's [px].
        height: of the network's input instead of the cfg's [px].
        half: store the kernels as float16.

    Raises:
        DarknetError: one line naming the file and what is wrong with it.
        OSError: ``out`` cannot be written.
    """
    if out.suffix != ".onnx":
        raise DarknetError(f"--out {out}: expected a name that ends in .onnx")
    network = read_network(cfg, width, height)
    labels = _labels(network, names)
    numbers = read_weights(weights, network)
    model = _written(network, numbers, labels, half=half)
    partial = out.with_name(f".{out.name}.partial")
    try:
        partial.write_bytes(model.SerializeToString(deterministic=True))
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)
    return ImportedDetector(
        out=str(out),
        layers=len(network.layers),
        parameters=sum(map(float_count, network.convolutions())),
        width=network.input.width,
        height=network.input.height,
        classes=list(labels),
        seen=numbers.seen,
    )


def darknet_model(cfg: Path, weights: Path, names: Path | None = None) -> Any:
    """``cfg`` and ``weights`` as an ``onnx.ModelProto``; nothing is written.

    Raises:
        DarknetError: one line naming the file and what is wrong with it.
    """
    network = read_network(cfg)
    return _written(network, read_weights(weights, network), _labels(network, names))


def _written(
    network: DarknetNetwork, numbers: Weights, labels: Sequence[str], *, half: bool = False
) -> Any:
    from devkit.darknet.onnx_writer import write_onnx

    return write_onnx(network, numbers, labels, half=half)


def _labels(network: DarknetNetwork, path: Path | None) -> Sequence[str]:
    """One label per class."""
    classes = {head.classes for head in network.heads()}
    if len(classes) > 1:
        raise DarknetError(f"{network.name}: heads of {sorted(classes)} classes; all need the same")
    needed = classes.pop()
    if path is None:
        if needed == 80:
            return coco_names()
        raise DarknetError(
            f"{network.name}: {needed} classes without names; give --names FILE, one per line"
        )
    try:
        with open_regular(path) as stream:
            text = stream.read(NAMES_BYTES_MAX).decode()
    except OSError as error:
        raise DarknetError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise DarknetError(f"{path}: not a text file of names, one per line") from None
    labels = [line.strip() for line in text.splitlines() if line.strip()]
    if len(labels) != needed:
        raise DarknetError(f"{path}: {len(labels)} names, {network.name} has {needed} classes")
    return labels
