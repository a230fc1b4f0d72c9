"""Scores of a detector: average precision by class, and by any label of the images.

Two published ways to count, both at one overlap (0.5 gives mAP@0.5):

``voc``
    Everingham et al., The PASCAL VOC Challenge: A Retrospective, 2015, section 2.2 and its
    development kit. A detection belongs to the truth of its class that it overlaps most; the first
    one is right, further ones are false. The area under the whole precision-recall curve, precision
    made monotone ("all-point interpolation", VOC 2010 and later).
``coco``
    Lin et al., Microsoft COCO, 2014, and pycocotools. A detection takes the truth that it overlaps
    most among those not yet taken. The mean of the monotone precision at the 101 recalls 0, 0.01,
    ... 1.

Both go through the detections by falling confidence, count an overlap of exactly the limit as
enough, and leave out truths that are to be ignored (too small, too hidden) with the detections that
match them. Boxes are continuous; VOC's kit adds a pixel to width and height. No class or group
without a truth has a score: it is None and never 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from devkit.detector.decode import DetectionBatch

Method = Literal["voc", "coco"]

RECALLS = np.linspace(0.0, 1.0, 101)
"""Recalls at which ``coco`` reads the precision."""

_FALSE, _RIGHT, _IGNORED = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """M labelled boxes of N images."""

    image: np.ndarray
    """int [M]: index of the image."""
    class_id: np.ndarray
    """int [M]: index into the names of the classes."""
    box_px: np.ndarray
    """float64 [M, 4]: x and y of the upper left corner, width, height."""
    ignored: np.ndarray
    """bool [M]: neither asked for nor held against a detector that finds it."""


@dataclass(frozen=True, slots=True)
class Score:
    """Score of one class in some images."""

    ap: float | None
    """Average precision, 0 to 1; None without a truth."""
    truths: int
    """Truths that are not ignored."""
    detections: int
    """Detections that are not ignored."""


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of all classes in some images."""

    mean_ap: float | None
    """Over the classes that have a score."""
    images: int
    classes: dict[str, Score]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """All scores of a detector."""

    method: str
    overlap_min: float
    all: Scores
    groups: dict[str, dict[str, Scores]]
    """Name of a label, say ``weather`` -> its value -> scores of the images that have it."""


def evaluate(
    names: Sequence[str],
    images: int,
    truth: Truth,
    found: DetectionBatch,
    labels: Mapping[str, Sequence[str]] | None = None,
    *,
    method: Method = "voc",
    overlap_min: float = 0.5,
) -> Evaluation:
    """Score detections.

    Args:
        names: of the classes, for truth and detections.
        images: number of images, also those without any box.
        truth: what is there.
        found: what the detector says; with a low ``confidence_min``, or the curve is cut short.
        labels: name -> one value per image, for the groups.
        method: ``voc`` or ``coco``.
        overlap_min: least intersection over union of a detection that is right, above 0 to 1.

    Raises:
        ValueError: names differ, an index or a label list does not fit; one line.
    """
    labels = labels or {}
    _check(names, images, truth, found, labels, overlap_min)
    # Detections with equal confidence go by image and place: no order depends on the batch.
    order = np.lexsort((found.place, found.image, -found.confidence))
    image, class_id, box = found.image[order], found.class_id[order], found.box_px[order]
    state = np.full(len(order), _FALSE)
    for index in range(len(names)):
        mine, theirs = class_id == index, truth.class_id == index
        state[mine] = _match(
            image[mine],
            box[mine],
            truth.image[theirs],
            truth.box_px[theirs],
            truth.ignored[theirs],
            overlap_min,
            method,
        )

    def scores(chosen: np.ndarray) -> Scores:
        classes = {}
        for index, name in enumerate(names):
            counted = (truth.class_id == index) & ~truth.ignored & chosen[truth.image]
            rows = (class_id == index) & (state != _IGNORED) & chosen[image]
            total, right = int(counted.sum()), state[rows] == _RIGHT
            ap = average_precision(right, total, method) if total else None
            classes[name] = Score(ap, total, len(right))
        known = [score.ap for score in classes.values() if score.ap is not None]
        mean = float(np.mean(known)) if known else None
        return Scores(mean, int(chosen.sum()), classes)

    groups = {}
    for label, values in labels.items():
        by_image = np.array([str(value) for value in values], dtype=object)
        groups[label] = {v: scores(by_image == v) for v in sorted(set(by_image.tolist()))}
    return Evaluation(method, overlap_min, scores(np.ones(images, bool)), groups)


def average_precision(right: np.ndarray, truths: int, method: Method = "voc") -> float:
    """Average precision of one class.

    Args:
        right: bool [K]: whether each detection is right, by falling confidence.
        truths: number of objects that were to be found, 1 or more.
        method: how the curve becomes a number, see the module.
    """
    hits = np.cumsum(right)
    recall = hits / truths
    precision = hits / np.arange(1, len(right) + 1)
    # The best precision at this recall or any larger one.
    monotone = np.maximum.accumulate(precision[::-1])[::-1]
    if method == "voc":
        return float(np.sum(np.diff(recall, prepend=0.0) * monotone))
    at = np.searchsorted(recall, RECALLS, side="left")
    return float(np.mean(np.append(monotone, 0.0)[np.minimum(at, len(monotone))]))


def overlaps(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Intersection over union of K pairs of boxes [K, 4]: x, y, width, height -> [K]."""
    low = np.maximum(left[:, :2], right[:, :2])
    high = np.minimum(left[:, :2] + left[:, 2:], right[:, :2] + right[:, 2:])
    shared = np.prod(np.maximum(high - low, 0.0), axis=1)
    union = np.prod(left[:, 2:], axis=1) + np.prod(right[:, 2:], axis=1) - shared
    overlap: np.ndarray = np.divide(shared, union, out=np.zeros(len(union)), where=union > 0.0)
    return overlap


def _match(
    image: np.ndarray,
    box: np.ndarray,
    truth_image: np.ndarray,
    truth_box: np.ndarray,
    ignored: np.ndarray,
    overlap_min: float,
    method: Method,
) -> np.ndarray:
    """Right, false or ignored, for each detection of one class, by falling confidence."""
    one, other = pairs(image, truth_image)
    overlap = overlaps(box[one], truth_box[other])
    enough = overlap >= overlap_min
    one, other, overlap = one[enough], other[enough], overlap[enough]
    if method == "voc":
        return _match_voc(len(image), one, other, overlap, ignored)
    return _match_coco(len(image), one, other, overlap, ignored)


def pairs(image: np.ndarray, truth_image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of all (detection, truth) in the same image, by detection, then by truth."""
    by_image = np.argsort(truth_image, kind="stable")
    ordered = truth_image[by_image]
    first = np.searchsorted(ordered, image, side="left")
    count = np.searchsorted(ordered, image, side="right") - first
    one = np.repeat(np.arange(len(image)), count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, by_image[np.repeat(first, count) + within]


def _match_voc(
    count: int, one: np.ndarray, other: np.ndarray, overlap: np.ndarray, ignored: np.ndarray
) -> np.ndarray:
    state = np.full(count, _FALSE)
    # Of every detection the pair with the largest overlap, of equals the first truth.
    order = np.lexsort((other, -overlap, one))
    detection, index = np.unique(one[order], return_index=True)
    target = other[order][index]
    state[detection[ignored[target]]] = _IGNORED
    asked = ~ignored[target]
    # Detections come by falling confidence, so the first of every truth is the right one.
    _, winner = np.unique(target[asked], return_index=True)
    state[detection[asked][winner]] = _RIGHT
    return state


def _match_coco(
    count: int, one: np.ndarray, other: np.ndarray, overlap: np.ndarray, ignored: np.ndarray
) -> np.ndarray:
    state = np.full(count, _FALSE)
    taken = np.zeros(len(ignored), bool)
    # By detection; its truths that count first, of those the largest overlap first.
    order = np.lexsort((other, -overlap, ignored[other], one))
    for detection, target in zip(one[order].tolist(), other[order].tolist(), strict=True):
        if state[detection] != _FALSE or taken[target]:
            continue
        state[detection] = _IGNORED if ignored[target] else _RIGHT
        # What is ignored may stand for many objects: it takes in any number of detections.
        taken[target] = not ignored[target]
    return state


def _check(
    names: Sequence[str],
    images: int,
    truth: Truth,
    detections: DetectionBatch,
    labels: Mapping[str, Sequence[str]],
    overlap_min: float,
) -> None:
    if tuple(names) != detections.names:
        raise ValueError(
            f"classes: truth has {', '.join(names)}; found {', '.join(detections.names)}"
        )
    if not 0.0 < overlap_min <= 1.0:
        raise ValueError(f"overlap_min: given {overlap_min:g}, allowed: above 0 to 1")
    for what, values, limit in (
        ("truth image", truth.image, images),
        ("found image", detections.image, images),
        ("truth class", truth.class_id, len(names)),
        ("found class", detections.class_id, len(names)),
    ):
        if len(values) and not (values.min() >= 0 and values.max() < limit):
            raise ValueError(
                f"{what}: given {values.min()} to {values.max()}, allowed: below {limit}"
            )
    for label, column in labels.items():
        if len(column) != images:
            raise ValueError(f"label {label}: {len(column)} values for {images} images")


def table(evaluation: Evaluation) -> str:
    """The scores as a Markdown table: one row per group, one column per class, AP in percent."""
    names = list(evaluation.all.classes)
    title = f"mAP@{evaluation.overlap_min:g} ({evaluation.method})"
    lines = [
        f"| images | n | {title} | {' | '.join(names)} |",
        f"|---|--:|--:|{'--:|' * len(names)}",
        _row("all", evaluation.all),
    ]
    for label, values in evaluation.groups.items():
        lines += [_row(f"{label} {value}", scores) for value, scores in values.items()]
    return "\n".join(lines) + "\n"


def _row(name: str, scores: Scores) -> str:
    cells = [scores.mean_ap, *(score.ap for score in scores.classes.values())]
    shown = ["-" if value is None else f"{100.0 * value:.1f}" for value in cells]
    return f"| {name} | {scores.images} | {' | '.join(shown)} |"
