"""Training images and their boxes as tensors on the device, all of them, once."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from devkit.detector.image_files import read_images
from devkit.detector.labelled_images import LabelledImages

NOTHING, LABEL, IGNORED = 0, 1, 2
"""Kinds of a box's place: empty, an object, neither object nor background."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Up to M boxes of each of N images; shares of the image."""

    box: Tensor
    """float32 [N, M, 4]: x and y of the centre, width, height."""
    class_id: Tensor
    """int64 [N, M]; 0 where there is none."""
    kind: Tensor
    """int64 [N, M]: :data:`NOTHING`, :data:`LABEL` or :data:`IGNORED`."""


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """N images and their boxes."""

    images: Tensor
    """uint8 [N, height, width, 3], RGB, at the network's size."""
    boxes: Boxes


def load_examples(data: LabelledImages, width: int, height: int, device: torch.device) -> Examples:
    """Decode every image and put it on the device.

    Raises:
        UsageError: a file is missing or no image.
    """
    images = torch.empty((len(data.paths), height, width, 3), dtype=torch.uint8, device=device)
    done = 0
    for turn in read_images(data.paths):
        # As the detector resizes (devkit.detector.detector).
        same = [
            cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR_EXACT)
            for image in turn
        ]
        images[done : done + len(turn)] = torch.from_numpy(np.stack(same)).to(device)
        done += len(turn)
    return Examples(images, _boxes(data, device))


def _boxes(data: LabelledImages, device: torch.device) -> Boxes:
    # Of two objects that claim the same cell the later one gets it: the larger, nearer one.
    order = np.lexsort((data.box_px[:, 2] * data.box_px[:, 3], data.image))
    image = data.image[order]
    first = np.searchsorted(image, image, side="left")
    place = np.arange(len(image)) - first
    shape = (len(data.paths), int(place.max(initial=0)) + 1)
    box = np.zeros((*shape, 4), np.float32)
    class_id, kind = np.zeros(shape, np.int64), np.full(shape, NOTHING, np.int64)
    size = np.concatenate([data.size_px, data.size_px], axis=1)[image]
    corner = data.box_px[order] / size
    box[image, place, :2] = corner[:, :2] + 0.5 * corner[:, 2:]
    box[image, place, 2:] = corner[:, 2:]
    class_id[image, place] = np.maximum(data.class_id[order], 0)
    kind[image, place] = np.where(data.ignored[order], IGNORED, LABEL)
    return Boxes(*(torch.from_numpy(array).to(device) for array in (box, class_id, kind)))
