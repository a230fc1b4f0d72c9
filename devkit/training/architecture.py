"""The network that is trained: a shipped architecture or a cfg, with classes, size and anchors of
the data."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from devkit.darknet.build import build_network
from devkit.darknet.network import DarknetNetwork
from devkit.darknet.sections import CfgSection, DarknetError, read_sections, to_text
from devkit.darknet.variant import architecture, vary
from devkit.detector.labelled_images import LabelledImages
from devkit.training.anchors import fit_anchors
from devkit.training.parameters import TrainingParameters
from schemas.digest import digest


def model_name(model: str) -> str:
    """Name of the model's files without a suffix."""
    return Path(model).stem if _is_file(model) else model


def cfg_digest(model: str) -> str | None:
    """SHA-256 of what a cfg file says; None for a shipped architecture.

    Raises:
        DarknetError: the file is no cfg.
    """
    return digest([to_text(read_sections(Path(model))).encode()]) if _is_file(model) else None


def read_size(model: str) -> tuple[int, int] | None:
    """Width and height that a cfg file asks for [px]; None for a shipped architecture.

    Raises:
        DarknetError: the file is no cfg, or no such architecture.
    """
    if not _is_file(model):
        architecture(model)
        return None
    network = build_network(read_sections(Path(model)), model)
    return network.input.width, network.input.height


def prepare(
    parameters: TrainingParameters, data: LabelledImages
) -> tuple[list[CfgSection], DarknetNetwork]:
    """Sections and network for the classes and boxes of ``data``.

    Raises:
        DarknetError: the cfg cannot be used, or not with this size or anchors of the data.
    """
    model = parameters.model
    sections = read_sections(Path(model)) if _is_file(model) else architecture(model)
    sections = vary(
        sections, classes=len(data.names), width=parameters.width, height=parameters.height
    )
    network = build_network(sections, model)
    if parameters.anchors == "data":
        anchors = _anchors(sections, network, data, parameters)
        sections = vary(sections, anchors=anchors.ravel().tolist())
        network = build_network(sections, model)
    return sections, network


def _is_file(model: str) -> bool:
    return model.endswith(".cfg")


def _anchors(
    sections: list[CfgSection],
    network: DarknetNetwork,
    data: LabelledImages,
    parameters: TrainingParameters,
) -> np.ndarray:
    """Anchors in the unit of the cfg's heads, [K, 2]."""
    heads = [section for section in sections if section.name in ("region", "yolo")]
    counts = {int(section.options["num"].text) for section in heads}
    regions = [section for section in heads if section.name == "region"]
    if len(counts) > 1 or (regions and len(heads) > 1):
        raise DarknetError(
            f"{parameters.model}: its heads do not share one list of anchors, so none can be"
            " fitted; give --anchors cfg"
        )
    size = np.array([parameters.width, parameters.height])
    objects = ~data.ignored
    share = data.box_px[objects, 2:] / data.size_px[data.image[objects]]
    anchors = fit_anchors(share * size, counts.pop(), parameters.seed)
    if not regions:
        return anchors
    # Anchors of a region are in cells.
    grid = network.heads()[0].shape
    cells: np.ndarray = anchors * np.array([grid.width, grid.height]) / size
    return cells
