"""Perception by a neural network: a detector as a perception variant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from devkit.images import Images
from devkit.perception import Setting
from schemas.messages import Detection
from schemas.sections import perception

if TYPE_CHECKING:
    from devkit.detector.detector import Detector

LABELS: Mapping[str, str] = {"person": "pedestrian", "stop sign": "traffic_sign"}
"""Labels of COCO, of which published weights know 80, that are called otherwise here."""

REPORTED_MAX = 100
"""Most objects of one frame: commands of all slots travel in one message of limited size."""


class DetectorPerception:
    """Sees the pictures and nothing else; boxes of the box sensor are ignored."""

    def __init__(self, variant: perception.NetworkPerception, setting: Setting) -> None:
        """Load the network, unless another variant of this process has.

        Raises:
            UsageError: it cannot be used; one line naming the file.
        """
        # What loads the network takes a while to import, and other variants do not need it.
        from devkit.detector.decode import Selection

        self._detector = _network(
            # Without what is selected from its boxes: that does not change the network.
            perception.NetworkPerception(
                model=variant.model,
                weights=variant.weights,
                names=variant.names,
                description=variant.description,
                runtime=variant.runtime,
            ),
            tuple(sorted(setting.files.items())),
            setting.device,
            setting.size_px,
        )
        self._selection = Selection(
            confidence_min=variant.confidence_min,
            overlap_max=variant.overlap_max,
            across_classes=variant.across_classes,
        )
        self._by_place = variant.order == "place"
        self.runtime = self._detector.runtime

    def detect(self, images: Images, boxes: Sequence[np.ndarray]) -> list[list[Detection]]:
        """See :class:`devkit.perception.Perception`."""
        batch = self._detector.detect(images, self._selection)
        by_image = batch.each(len(boxes), by_place=self._by_place)
        return [[_renamed(detection) for detection in _most_confident(one)] for one in by_image]


def _most_confident(detections: list[Detection]) -> list[Detection]:
    """Most confident detections, at most :data:`REPORTED_MAX`, in the order they have."""
    if len(detections) <= REPORTED_MAX:
        return detections
    by_confidence = sorted(range(len(detections)), key=lambda i: (-detections[i].confidence, i))
    return [detections[i] for i in sorted(by_confidence[:REPORTED_MAX])]


@cache
def _network(
    variant: perception.NetworkPerception,
    files: tuple[tuple[str, str], ...],
    device: str,
    size_px: tuple[int, int],
) -> Detector:
    """One network for all variants that differ in what they select only; a process is a rig."""
    from devkit.detector.model_files import open_detector

    return open_detector(variant, dict(files), device, size_px)


def _renamed(detection: Detection) -> Detection:
    label = LABELS.get(detection.label)
    return msgspec.structs.replace(detection, label=label) if label else detection
