"""Scores of a network in training, on images that it does not learn from."""

from __future__ import annotations

import torch

from devkit.detector.decode import DetectionBatch, decode
from devkit.detector.description import DetectorDescription
from devkit.detector.evaluate import Evaluation, evaluate
from devkit.detector.labelled_images import LabelledImages
from devkit.detector.scoring import SELECTION, joined, shifted
from devkit.training.network import TorchNetwork

TOGETHER = 64
"""Images that go through the network together."""


def validate(
    model: TorchNetwork,
    images: torch.Tensor,
    data: LabelledImages,
    description: DetectorDescription,
) -> Evaluation:
    """Scores of ``model`` as it is, decoded as the detector does it.

    Args:
        model: in evaluation mode.
        images: uint8 [N, height, width, 3], on the model's device.
        data: their labels.
        description: of the network.
    """
    parts = [
        _detect(model, images[first : first + TOGETHER], first, data, description)
        for first in range(0, len(images), TOGETHER)
    ]
    return evaluate(data.names, len(images), data.truth(), joined(parts))


@torch.no_grad()
def _detect(
    model: TorchNetwork,
    images: torch.Tensor,
    first: int,
    data: LabelledImages,
    description: DetectorDescription,
) -> DetectionBatch:
    values = images.permute(0, 3, 1, 2).float() * description.scale
    raw = model(values.contiguous(memory_format=torch.channels_last))
    outputs = {
        head.output: array.float().cpu().contiguous().numpy()
        for head, array in zip(description.heads, raw, strict=True)
    }
    sizes = [(int(w), int(h)) for w, h in data.size_px[first : first + len(images)]]
    batch = decode(outputs, description, sizes, SELECTION)
    return shifted(batch, first)
