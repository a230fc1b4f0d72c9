"""Outputs of a network -> boxes, for all kinds of heads, and the suppression.

YOLOv2's region and YOLOv3's yolo share one formula. For a cell (i, j) of a grid of W_g x H_g cells
and an anchor (p_w, p_h) of an input of W x H pixels, with t the network's values, as shares of the
image (Redmon, Farhadi: YOLO9000, 2016, section 2; YOLOv3, 2018, section 2.1)::

    x = (i + s(t_x)) / W_g      width  = p_w e^(t_w) / W
    y = (j + s(t_y)) / H_g      height = p_h e^(t_h) / H      confidence = s(t_o) P(class)

with the logistic s, and P the softmax or the logistic of the class channels. All arithmetic is in
float64 and of one box alone, so a box is the same to the last bit whatever lies beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from devkit.detector.description import BoxHead, DetectorDescription, GridHead
from devkit.detector.exponential import exponential
from schemas.messages import Detection
from schemas.steady import steady

EXPONENT_MAX = 30.0
"""Larger exponents of a box's size are cut: such a box is larger than any image."""

EXPONENT_LARGE = 700.0
"""e to this is still a number."""

LOGIT_MARGIN = 1e-6
"""Objectness may miss its limit by this before the exact comparison of the confidence [-]."""


PAIRS_MAX = 1 << 18
"""Pairs of boxes that suppression looks at together: bounds its memory."""


class Selection(Struct, frozen=True, forbid_unknown_fields=True):
    """Which boxes are reported."""

    confidence_min: Annotated[float, Meta(gt=0, lt=1)] = 0.25
    """Least confidence [-], above 0 and below 1, inclusive."""
    overlap_max: Annotated[float, Meta(ge=0, le=1)] = 0.4
    """Intersection over union above which the less confident box goes [-], 0 to 1."""
    across_classes: bool = False
    """Boxes of different classes suppress each other, too, as in the AutoDRIVE script."""
    candidates_max: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    """Most boxes per image that the suppression looks at, the most confident ones; 1 to 100000."""


@dataclass(frozen=True, slots=True, eq=False)
class DetectionBatch:
    """K boxes of N images, by image, the most confident first."""

    names: tuple[str, ...]
    image: np.ndarray
    """int64 [K]: index of the image."""
    class_id: np.ndarray
    """int64 [K]: index into ``names``."""
    confidence: np.ndarray
    """float64 [K]: 0 to 1."""
    box_px: np.ndarray
    """float64 [K, 4]: x and y of the upper left corner, width, height; inside the image."""
    place: np.ndarray
    """int64 [K]: which of the network's boxes it is, counted head by head, row by row, cell by
    cell, anchor by anchor. Scripts that take "the last box" mean this order."""

    def of(self, image: int, *, by_place: bool = False) -> list[Detection]:
        """Detections of one image as messages, the most confident first or ``by_place``."""
        return self._messages(np.flatnonzero(self.image == image), by_place)

    def each(self, images: int, *, by_place: bool = False) -> list[list[Detection]]:
        """Detections as :meth:`of` gives them, for every one of ``images``."""
        messages = self._messages(np.arange(len(self.image)), by_place)
        ends = np.searchsorted(self.image, np.arange(images + 1)).tolist()
        return [messages[first:end] for first, end in pairwise(ends)]

    def _messages(self, rows: np.ndarray, by_place: bool) -> list[Detection]:
        """Detections by image; ``rows`` ascend."""
        if by_place:
            rows = rows[np.lexsort((self.place[rows], self.image[rows]))]
        return [
            Detection(self.names[class_id], confidence, *box)
            for class_id, confidence, box in zip(
                self.class_id[rows].tolist(),
                self.confidence[rows].tolist(),
                self.box_px[rows].tolist(),
                strict=True,
            )
        ]


def decode(
    outputs: Mapping[str, np.ndarray],
    description: DetectorDescription,
    sizes_px: Sequence[tuple[int, int]],
    selection: Selection,
) -> DetectionBatch:
    """Boxes of N images.

    Args:
        outputs: name -> float32 [N, ...], for every head as its type describes.
        description: of the network.
        sizes_px: (width, height) of each image as it was before the resize [px].
        selection: which boxes are reported.
    """
    parts = []
    first = 0
    for head in description.heads:
        raw, limit = outputs[head.output], selection.confidence_min
        if isinstance(head, GridHead):
            part = _from_grid(raw, head, description, limit)
            count = raw.shape[2] * raw.shape[3] * len(head.anchors_px)
        else:
            part = _from_boxes(raw, head, description, limit)
            count = raw.shape[1 if head.layout == "rows" else 2]
        parts.append((part[0], first + part[1], *part[2:]))
        first += count
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    image, place, class_id, confidence, box = columns
    size_px = np.array(sizes_px, np.float64).reshape(-1, 2)[image]
    box = _clipped(box, size_px)
    inside = (box[:, 2] > 0.0) & (box[:, 3] > 0.0)
    # The place breaks ties of confidence: no two boxes of an image share it.
    order = np.lexsort((place, -confidence, image))
    order = order[inside[order]]
    order = order[_within(image[order], selection.candidates_max)]
    groups = np.zeros_like(class_id) if selection.across_classes else class_id
    rows = order[
        _suppressed(box[order], groups[order], image[order], len(sizes_px), selection.overlap_max)
    ]
    return DetectionBatch(
        names=tuple(description.names),
        image=image[rows],
        class_id=class_id[rows],
        confidence=confidence[rows],
        box_px=box[rows],
        place=place[rows],
    )


def suppress(box: np.ndarray, group: np.ndarray, overlap_max: float) -> np.ndarray:
    """Greedy non-maximum suppression within groups.

    Args:
        box: float64 [K, 4], x, y, width, height; in the order in which boxes win.
        group: int [K]: boxes of different groups never meet.
        overlap_max: intersection over union above which the later box goes.

    Returns:
        Indices of the boxes that stay, ascending.
    """
    alive = np.ones(len(box), bool)
    block = max(1, PAIRS_MAX // max(1, len(box)))
    for first in range(0, len(box), block):
        rows = slice(first, first + block)
        (kills,) = _kills(box[None], group[None], rows, overlap_max)
        for index in np.flatnonzero(kills.any(axis=1)).tolist():
            if alive[first + index]:
                alive &= ~kills[index]
    return np.flatnonzero(alive)


def _suppressed(
    box: np.ndarray, group: np.ndarray, image: np.ndarray, images: int, overlap_max: float
) -> np.ndarray:
    """Rows of the boxes [K], sorted by image, that stay, as :func:`suppress` within each image; all
    images of a batch at once, because each holds but a few."""
    ends = np.searchsorted(image, np.arange(images + 1))
    counts = np.diff(ends)
    alive = np.ones(len(box), bool)
    width = int(counts.max(initial=0))
    if width < 2:
        return np.flatnonzero(alive)
    together = max(1, PAIRS_MAX // width**2)
    for first in range(0, images, together):
        begins, sizes = ends[first : first + together + 1], counts[first : first + together]
        if len(sizes) == 1:
            rows = np.arange(begins[0], begins[1])
            stay = suppress(box[rows], group[rows], overlap_max)
            alive[np.delete(rows, stay)] = False
            continue
        # One row per image; what fills the rows up belongs to groups that nothing meets.
        members = np.arange(begins[0], begins[-1])
        line = np.repeat(np.arange(len(sizes)), sizes)
        column = members - np.repeat(begins[:-1], sizes)
        boxes = np.zeros((len(sizes), width, 4))
        groups = np.tile(-1 - np.arange(width), (len(sizes), 1))
        boxes[line, column], groups[line, column] = box[members], group[members]
        kills = _kills(boxes, groups, slice(0, width), overlap_max)
        staying = np.ones((len(sizes), width), bool)
        for index in np.flatnonzero(kills.any(axis=(0, 2))).tolist():
            staying &= ~(kills[:, index] & staying[:, index, None])
        alive[members] = staying[line, column]
    return np.flatnonzero(alive)


def _kills(box: np.ndarray, group: np.ndarray, rows: slice, overlap_max: float) -> np.ndarray:
    """Later boxes that go if an earlier one of ``rows`` stays, [N, R, K] of boxes [N, K, 4]."""
    low, high = box[..., :2], box[..., :2] + box[..., 2:]
    area = box[..., 2] * box[..., 3]
    extent = np.minimum(high[:, rows, None], high[:, None])
    extent -= np.maximum(low[:, rows, None], low[:, None])
    shared = np.maximum(extent[..., 0], 0.0) * np.maximum(extent[..., 1], 0.0)
    union = area[:, rows, None] + area[:, None] - shared
    with np.errstate(invalid="ignore"):  # what fills a row up has no area
        overlap = shared / union
    meets = ~(overlap <= overlap_max) & (group[:, rows, None] == group[:, None])
    return np.triu(meets, rows.start + 1)


def _within(image: np.ndarray, most: int) -> np.ndarray:
    """The first ``most`` of every image, of boxes sorted by image; indices."""
    starts = np.searchsorted(image, image)
    return np.flatnonzero(np.arange(len(image)) - starts < most)


def _from_grid(
    raw: np.ndarray, head: GridHead, description: DetectorDescription, limit: float
) -> tuple[np.ndarray, ...]:
    """Image, place in this head, class, confidence and box (centre and size in shares of the
    image) of its confident boxes."""
    images, channels, rows, columns = raw.shape
    anchors = len(head.anchors_px)
    grid = raw.reshape(images, anchors, channels // anchors, rows, columns)
    # Most cells are empty: only those that may reach the limit are looked at any further.
    least = np.log(limit / (1.0 - limit)) - LOGIT_MARGIN
    likely = grid[:, :, 4] >= least
    image, anchor, row, column = np.unravel_index(np.flatnonzero(likely), likely.shape)
    values = grid[image, anchor, :, row, column].astype(np.float64)
    sound = np.isfinite(values).all(axis=1)
    values, image, anchor = values[sound], image[sound], anchor[sound]
    row, column = row[sound], column[sound]
    best = np.argmax(values[:, 5:], axis=1)
    confidence = _logistic(values[:, 4]) * _class_probability(values[:, 5:], best, head.scores)
    centre = _logistic(values[:, :2]) * head.scale_xy - 0.5 * (head.scale_xy - 1.0)
    centre = (np.stack([column, row], axis=1) + centre) / np.array([columns, rows], np.float64)
    anchor_share = np.array(head.anchors_px) / np.array([description.width, description.height])
    size = _exp(np.minimum(values[:, 2:4], EXPONENT_MAX)) * anchor_share[anchor]
    place = (row * columns + column) * anchors + anchor
    keep = confidence >= limit
    box = np.concatenate([centre, size], axis=1)
    return image[keep], place[keep], best[keep], confidence[keep], box[keep]


def _from_boxes(
    raw: np.ndarray, head: BoxHead, description: DetectorDescription, limit: float
) -> tuple[np.ndarray, ...]:
    """Boxes as :func:`_from_grid` gives them, of a head of finished boxes."""
    rows = raw if head.layout == "rows" else raw.transpose(0, 2, 1)
    scores = rows[..., 4 + head.objectness :]
    best = np.argmax(scores, axis=2)
    confidence = np.take_along_axis(scores, best[..., None], axis=2)[..., 0].astype(np.float64)
    if head.objectness:
        confidence = confidence * rows[..., 4]
    sound = np.isfinite(rows).all(axis=2)
    image, place = np.nonzero((confidence >= limit) & sound)
    box = rows[image, place, :4].astype(np.float64)
    box /= np.array([description.width, description.height] * 2, np.float64)
    # Probabilities are the network's; a message's confidence is 0 to 1 whatever it says.
    certain = np.minimum(confidence[image, place], 1.0)
    return image, place, best[image, place], certain, box


def _class_probability(scores: np.ndarray, best: np.ndarray, how: str) -> np.ndarray:
    """Probability of the best class, [K]."""
    top = np.take_along_axis(scores, best[:, None], axis=1)
    if how == "logistic":
        return _logistic(top[:, 0])
    # Summed column by column: a sum along rows may be split as the array's layout suggests.
    total = np.zeros(len(scores))
    for column in range(scores.shape[1]):
        total += _exp(scores[:, column] - top[:, 0])
    return 1.0 / total


def _logistic(values: np.ndarray) -> np.ndarray:
    odds = _exp(np.minimum(-values, EXPONENT_LARGE))
    return 1.0 / (1.0 + odds)


def _exp(values: np.ndarray) -> np.ndarray:
    """The exponential to 24 bits, the same on every processor."""
    return steady(exponential(values), 24)


def _clipped(box: np.ndarray, size_px: np.ndarray) -> np.ndarray:
    """Centre and size in shares of the image -> corner and size inside the image [px]."""
    half = 0.5 * box[:, 2:]
    low = np.clip((box[:, :2] - half) * size_px, 0.0, size_px)
    high = np.clip((box[:, :2] + half) * size_px, 0.0, size_px)
    return np.concatenate([low, high - low], axis=1)
