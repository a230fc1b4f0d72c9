"""Perception: what the stack sees in one camera frame, and how good it is at seeing.

A campaign names perception variants, whose declarations (:mod:`schemas.kinds.perception`) name the
implementation, so every slot may run another one.

Contrast comes from exact integer sums: the same in any order and on any machine. The few
floating-point steps after them are +, -, x, / and square roots, which IEEE 754 rounds correctly
everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from devkit.images import Images
from schemas.kinds.perception import perception_kind
from schemas.kinds.registry import implementation
from schemas.messages import BOX_COLUMNS, OBJECT_CLASSES, Detection
from schemas.sections.perception import GroundTruthPerception

CONFIDENCE_MIN = 0.25
"""Least confidence that is reported [-]; the planner's own threshold lies above."""

LUMA_WEIGHTS = (77, 150, 29)
"""Rec. 601 luma of R, G, B in 1/256; they sum to 256, so luma stays an integer below 2^16."""

LUMA_SCALE = 256.0
"""Luma units per image level."""

DARK_LEVEL = 16.0
"""Added to the brightness that contrast is relative to [image levels of 255].

Without it two nearly black pixels (1 and 3 of 255) would count as 50 % contrast.
"""

NOISE_WEIGHT = 2.0
"""Noise deviations that a signal must match to lose 30 % of its contrast [-]."""

RING_FRACTION = 4
"""The surrounding ring is this fraction of the box's shorter side wide, and at least 2 px."""

PIXELS_MAX = 1 << 14
"""Largest neighbourhood that is looked at whole; of a larger one every k-th row: enough for its
moments, and the cost of a car that fills the image stays bounded [px]."""

MEDIAN_OF_DIFFERENCE = 0.6744897501960817 * math.sqrt(2.0)
"""Median of ``|a - b|`` for two independent normal values of deviation 1."""

_CLASS, _X, _Y, _WIDTH, _HEIGHT, _VISIBLE = (
    BOX_COLUMNS.index(name)
    for name in ("class_id", "x_px", "y_px", "width_px", "height_px", "visible_px")
)


class Perception(Protocol):
    """One perception variant; stateless, so that it may serve every slot of a rig."""

    runtime: str
    """The library and device that run it, for people: ``opencv cpu``."""

    def detect(self, images: Images, boxes: Sequence[np.ndarray]) -> list[list[Detection]]:
        """Objects seen in n frames; a frame's do not depend on the others.

        Args:
            images: frames of n slots, in any order.
            boxes: of each frame float32 [k, 7], rows of the box sensor
                (``schemas.messages.BOX_COLUMNS``); a real detector ignores them.

        Returns:
            Of each frame its objects, in the order that the variant asks for.
        """
        ...


@dataclass(frozen=True, slots=True)
class Setting:
    """Setting in which a variant is used."""

    device: str = "cpu"
    """Device on which the worker computes, ``cpu`` or ``cuda:N``."""
    size_px: tuple[int, int] = (640, 360)
    """Width and height of the frames [px]."""
    files: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 that the files must have which the variant names."""


def build_perception(spec: Any, setting: Setting | None = None) -> Perception:
    """The perception of one variant, ``Episode.perception``.

    Raises:
        ValueError: it is no perception variant, or its implementation cannot be imported.
        UsageError: a file that the variant names cannot be used; one line.
    """
    build = implementation(perception_kind(spec).implementation)
    perception: Perception = build(spec, setting or Setting())
    return perception


def confidence(contrast: float, contrast_min: float) -> float:
    """Confidence of an object of ``contrast`` [0..1]: 0 at 0, exactly 0.5 at ``contrast_min``."""
    return contrast / (contrast + contrast_min)


class ContrastPerception:
    """The box sensor seen through a contrast threshold.

    Where an object is comes from the simulator, whether it is seen from the pixels alone: fog,
    darkness and sensor noise lower the contrast in the image, and the object fades from the
    detections as it would for a person.
    """

    runtime = "numpy cpu"

    def __init__(self, spec: GroundTruthPerception, _setting: Setting) -> None:
        self.contrast_min = spec.contrast_min
        self.pixels_min = spec.pixels_min

    def detect(self, images: Images, boxes: Sequence[np.ndarray]) -> list[list[Detection]]:
        """See :class:`Perception`; reported from :data:`CONFIDENCE_MIN` up, most confident
        first."""
        return [self._see(image, rows) for image, rows in zip(images, boxes, strict=True)]

    def _see(self, image: np.ndarray, boxes: np.ndarray) -> list[Detection]:
        detections = [self._detect_one(image, row) for row in boxes.tolist()]
        # The box sensor's row order is none of the planner's business: sort by content.
        return sorted(
            (detection for detection in detections if detection is not None),
            key=lambda d: (-d.confidence, d.x_px, d.y_px, d.width_px, d.height_px, d.label),
        )

    def _detect_one(self, image: np.ndarray, row: list[float]) -> Detection | None:
        if not math.isfinite(sum(row)):  # of float32 values, which no sum of seven overflows
            # The simulator ends a slot whose state is NaN; raising here would end its neighbours.
            return None
        class_id = int(row[_CLASS])
        if not 0 <= class_id < len(OBJECT_CLASSES):
            raise ValueError(f"box with class id {class_id}, allowed: 0-{len(OBJECT_CLASSES) - 1}")
        if row[_VISIBLE] < self.pixels_min:
            return None
        region = pixels_of(row, image.shape[1], image.shape[0])
        if region is None:
            return None
        certainty = confidence(visible_contrast(image, region), self.contrast_min)
        if certainty < CONFIDENCE_MIN:
            return None
        return Detection(
            label=OBJECT_CLASSES[class_id],
            confidence=certainty,
            x_px=row[_X],
            y_px=row[_Y],
            width_px=row[_WIDTH],
            height_px=row[_HEIGHT],
        )


def pixels_of(row: list[float], width_px: int, height_px: int) -> Region | None:
    """Whole pixels touched by a box row, at least one; None when it lies outside the image."""
    left, top = math.floor(row[_X]), math.floor(row[_Y])
    right = max(math.ceil(row[_X] + row[_WIDTH]), left + 1)
    bottom = max(math.ceil(row[_Y] + row[_HEIGHT]), top + 1)
    region = Region(max(left, 0), max(top, 0), min(right, width_px), min(bottom, height_px))
    return region if region.left < region.right and region.top < region.bottom else None


class Region(NamedTuple):
    """Pixels ``left <= column < right``, ``top <= row < bottom``."""

    left: int
    top: int
    right: int
    bottom: int


class Moments(NamedTuple):
    """Exact sums over some pixels: how many, sum and sum of squares of their luma."""

    pixels: int
    total: int
    squares: int

    def mean(self) -> float:
        """Mean luma."""
        return self.total / self.pixels

    def variance(self) -> float:
        """Variance of luma; the numerator is exact, so it is never negative."""
        return (self.pixels * self.squares - self.total**2) / self.pixels**2


def visible_contrast(image: np.ndarray, box: Region) -> float:
    """Contrast of ``box`` against its surroundings, 0 (invisible) to 1.

    With the means m of box and ring, the deviation t of the box and the noise n of the image:
    signal s = sqrt((m_box - m_ring)^2 + t^2 - n^2), contrast = s / (m_box + m_ring + dark level)
    x s / sqrt(s^2 + (2 n)^2). The first factor is Michelson's contrast, joined by the object's own
    texture so that a grey car on grey asphalt still shows; a veil of fog shrinks s and raises the
    means. The second compares the signal with the noise.

    Args:
        image: uint8 [H, W, 3], RGB.
        box: the object's pixels, inside the image and not empty.
    """
    margin = max(2, min(box.right - box.left, box.bottom - box.top) // RING_FRACTION)
    top, left = max(box.top - margin, 0), max(box.left - margin, 0)
    neighbourhood = image[top : box.bottom + margin, left : box.right + margin]
    stride = -(-neighbourhood.shape[0] * neighbourhood.shape[1] // PIXELS_MAX)
    # The first row of the box is always among the rows, so the box is never empty.
    first, above = (box.top - top) % stride, (box.top - top) // stride
    around = _luma(neighbourhood[first::stride])
    rows = -(-(box.bottom - box.top) // stride)
    inside = around[above : above + rows, box.left - left : box.right - left]
    whole, object_ = _moments(around), _moments(inside)
    ring = Moments(*(w - o for w, o in zip(whole, object_, strict=True)))
    noise = _noise(around)

    # A box that fills the image has no surroundings; only its texture can be seen.
    ring_mean = ring.mean() if ring.pixels else object_.mean()
    difference = object_.mean() - ring_mean
    texture_squared = max(object_.variance() - noise * noise, 0.0)
    signal = math.sqrt(difference * difference + texture_squared)
    if signal == 0.0:
        return 0.0
    brightness = object_.mean() + ring_mean + DARK_LEVEL * LUMA_SCALE
    weighted_noise = NOISE_WEIGHT * noise
    against_noise = signal / math.sqrt(signal * signal + weighted_noise * weighted_noise)
    return min(signal / brightness * against_noise, 1.0)


_RED, _GREEN, _BLUE = (np.uint16(weight) for weight in LUMA_WEIGHTS)


def _luma(image: np.ndarray) -> np.ndarray:
    """uint8 [h, w, 3] -> uint16 [h, w], 256 units per image level: at most 255 x 256."""
    luma: np.ndarray = image[..., 0] * _RED
    luma += image[..., 1] * _GREEN
    luma += image[..., 2] * _BLUE
    return luma


def _moments(luma: np.ndarray) -> Moments:
    # float64 is exact below 2^53; PIXELS_MAX, with the longest row twice, is 1e14 at full luma.
    flat = luma.astype(np.float64).ravel()
    return Moments(flat.size, int(flat.sum()), int(flat.dot(flat)))


def _noise(luma: np.ndarray) -> float:
    """Deviation of the image noise, from the median step between horizontal neighbours.

    Edges and shading make few large or many small steps and hardly move the median.
    """
    if luma.shape[1] < 2:
        return 0.0
    right, left = luma[:, 1:], luma[:, :-1]
    steps = (np.maximum(right, left) - np.minimum(right, left)).ravel()
    middle = steps.size // 2
    steps.partition(middle)
    return float(steps[middle]) / MEDIAN_OF_DIFFERENCE
