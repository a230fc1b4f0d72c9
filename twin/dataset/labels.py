"""What an image's annotations say, and which of them a detector must find."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from schemas.messages import OBJECT_CLASSES
from twin.dataset.recipe import Rules

_RING = 0.2
"""Surroundings of an object: its box, larger by this share on every side, at least 2 px [-]."""


@dataclass(frozen=True, slots=True)
class SeenObject:
    """One object as a camera has seen it."""

    class_index: int
    look: str
    instance: int
    box: tuple[int, int, int, int]
    """Box around the visible pixels: x, y, width, height [px]."""
    full_box: tuple[int, int, int, int]
    """Box around all pixels that it would have in the image if nothing hid it."""
    visible_px: int
    unoccluded_px: int
    truncation: float
    distance_m: float
    contrast: float
    """Against its surroundings or in itself [1/255]."""
    behind: bool = False
    """A traffic sign of which the camera sees the back."""


def annotation(seen: SeenObject, rules: Rules, extinction_per_m: float) -> dict[str, Any]:
    """The COCO annotation, without ids."""
    reasons = ignored_for(seen, rules, extinction_per_m)
    return {
        "category_id": seen.class_index + 1,
        "bbox": list(seen.box),
        "area": seen.visible_px,
        "iscrowd": int(bool(reasons)),
        "ignore": int(bool(reasons)),
        "ignored_for": reasons,
        "visible_px": seen.visible_px,
        "unoccluded_px": seen.unoccluded_px,
        "visibility": visibility(seen),
        "truncation": seen.truncation,
        "distance_m": round(seen.distance_m, 2),
        "contrast": seen.contrast,
        "full_bbox": list(seen.full_box),
        "look": seen.look,
    }


def visibility(seen: SeenObject) -> float:
    """Visible over unoccluded pixels inside the image [-]."""
    return round(seen.visible_px / seen.unoccluded_px, 3)


def ignored_for(seen: SeenObject, rules: Rules, extinction_per_m: float) -> list[str]:
    """Why an object is no label; empty: it is one."""
    long_px, short_px = max(seen.box[2:]), min(seen.box[2:])
    small = (
        seen.visible_px < rules.visible_px_min
        or long_px < rules.long_side_px_min
        or short_px < rules.short_side_px_min
    )
    found = {
        "small": small,
        "hidden": visibility(seen) < rules.visibility_min,
        "truncated": seen.truncation > rules.truncation_max,
        "air": math.exp(-extinction_per_m * seen.distance_m) < rules.transmission_min,
        "contrast": seen.contrast < rules.contrast_min,
        "behind": seen.behind,
    }
    return [reason for reason, holds in found.items() if holds]


def contrast(
    image: np.ndarray, instances: np.ndarray, instance: int, box: tuple[int, int, int, int]
) -> float:
    """Contrast of an object with what is around it [1/255].

    The larger of the difference of its mean from that of its surroundings, in the channel where it
    is largest, and the standard deviation of its own brightness after a 3 x 3 mean, which takes
    noise away. Sums are of integers.

    Args:
        image: uint8 [H, W, 3].
        instances: int32 [H, W].
        box: x, y, width, height.
    """
    x, y, width, height = box
    dx, dy = max(2, round(_RING * width)), max(2, round(_RING * height))
    rows = slice(max(0, y - dy), y + height + dy)
    columns = slice(max(0, x - dx), x + width + dx)
    own = instances[rows, columns] == instance
    part = image[rows, columns]
    inside, outside = part[own].astype(np.int64), part[~own].astype(np.int64)
    difference = 0.0
    if len(outside):
        means = inside.sum(axis=0) / len(inside), outside.sum(axis=0) / len(outside)
        difference = float(np.abs(means[0] - means[1]).max())
    grey = cv2.blur(cv2.cvtColor(part, cv2.COLOR_RGB2GRAY), (3, 3))[own].astype(np.int64)
    variance = (grey * grey).sum() / len(grey) - (grey.sum() / len(grey)) ** 2
    return round(max(difference, math.sqrt(max(variance, 0.0))), 2)


CATEGORIES = [
    {"id": index + 1, "name": name, "supercategory": "object"}
    for index, name in enumerate(OBJECT_CLASSES)
]
"""COCO categories: the classes of the box sensor, counted from 1."""
