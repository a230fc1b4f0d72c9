"""What a detector is worth on a dataset: average precision where it counts, and what it misses.

Images are grouped by what a campaign varies: the hour, the weather, and both together. The figure
of merit of the project is the average precision of cars at clear noon.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from devkit.detector.decode import DetectionBatch, Selection
from devkit.detector.detector import Detector
from devkit.detector.evaluate import Evaluation, Score, Scores, Truth, evaluate, overlaps, pairs
from devkit.detector.image_files import read_images
from devkit.detector.labelled_images import LabelledImages

SELECTION = Selection(confidence_min=0.005, overlap_max=0.45, candidates_max=300)
"""Boxes that are scored: Darknet's own limits for average precision (``detector map``)."""

CONFIDENCE_SHOWN = 0.25
"""What a detector reports by default; recalls are of these boxes."""

OVERLAP_MIN = 0.5

MERIT = "car"
"""Class of the joint table and of the figure of merit."""

NOON = ("clear", 11.0, 14.0)
"""Weather and hours, the last one exclusive, of the figure of merit."""

NIGHT = "night"

_HOURS = range(5, 20, 2)
"""Middles of the blocks of two hours; the hours of the campaign aeb-256."""

SIZES_PX = (0, 8, 12, 16, 24, 32, 48, 96)
"""Lower ends of the groups of the longer side [px]."""

DISTANCES_M = (0, 10, 20, 30, 40, 60, 80)

VISIBILITIES = (0.0, 0.5, 0.75, 0.95)


@dataclass(frozen=True, slots=True)
class RecallShare:
    """Objects that a detector reports by default, of all there are."""

    found: int
    objects: int


@dataclass(frozen=True, slots=True)
class Scorecard:
    """All scores of a detector on some images."""

    evaluation: Evaluation
    """Evaluation with groups ``hour`` (nearest full hour), ``weather``, ``block`` (hours) and
    ``joint``."""
    noon: Score | None
    """Score of :data:`MERIT` in :data:`NOON`; None without this class or such an image."""
    noon_images: int
    moderate: Scores
    """Scores over objects that are large and visible enough, see
    :attr:`devkit.detector.labelled_images.LabelledImages.moderate`; all others are ignored."""
    noon_moderate: Score | None
    """The figure of merit of those."""
    recalls: dict[str, dict[str, dict[str, RecallShare]]]
    """``size_px``, ``distance_m``, ``visibility`` -> group -> class."""


def score_detector(
    detector: Detector, data: LabelledImages, report: Callable[[int, int], None]
) -> Scorecard:
    """Run a detector over images and score it.

    Args:
        detector: with :data:`SELECTION`, or the curve is cut short.
        data: images and boxes; its classes must be among the detector's.
        report: told the images that are done and all of them.

    Raises:
        UsageError: an image cannot be read.
    """
    done, parts = 0, []
    for turn in read_images(data.paths):
        parts.append(shifted(detector.detect(turn), done))
        done += len(turn)
        report(done, len(data.paths))
    return score(data, renamed(joined(parts), data.names))


def score(data: LabelledImages, found: DetectionBatch) -> Scorecard:
    """Scores of detections of all images in ``data``."""
    hours = [f"{int(hour + 0.5) % 24:02d}" for hour in data.hour]
    blocks = [block_of(hour) for hour in data.hour]
    clear_noon = [
        str(weather == NOON[0] and NOON[1] <= hour < NOON[2])
        for weather, hour in zip(data.weather, data.hour, strict=True)
    ]
    joint = [f"{block} {weather}" for block, weather in zip(blocks, data.weather, strict=True)]
    labels = {
        "hour": hours,
        "weather": data.weather,
        "block": blocks,
        "joint": joint,
        "noon": clear_noon,
    }
    truth = data.truth()
    result = evaluate(data.names, len(data.paths), truth, found, labels, overlap_min=OVERLAP_MIN)
    noon = result.groups.pop("noon").get("True")
    large = evaluate(
        data.names,
        len(data.paths),
        data.truth(~data.moderate),
        found,
        {"noon": clear_noon},
        overlap_min=OVERLAP_MIN,
    )
    noon_large = large.groups["noon"].get("True")
    return Scorecard(
        evaluation=result,
        noon=noon.classes.get(MERIT) if noon else None,
        noon_images=noon.images if noon else 0,
        moderate=large.all,
        noon_moderate=noon_large.classes.get(MERIT) if noon_large else None,
        recalls=_recalls(data, truth, found),
    )


def block_of(hour: float) -> str:
    """``13`` for 12:00 to 13:59, and so on from 4:00 to 19:59; otherwise :data:`NIGHT`."""
    middle = 2 * int(hour / 2.0) + 1
    return f"{middle:02d}" if middle in _HOURS else NIGHT


def renamed(found: DetectionBatch, names: Sequence[str]) -> DetectionBatch:
    """Detections of these classes alone, in their order."""
    index_of = np.array([names.index(n) if n in names else -1 for n in found.names], np.int64)
    class_id = index_of[found.class_id]
    rows = class_id >= 0
    return DetectionBatch(
        names=tuple(names),
        image=found.image[rows],
        class_id=class_id[rows],
        confidence=found.confidence[rows],
        box_px=found.box_px[rows],
        place=found.place[rows],
    )


def shifted(found: DetectionBatch, first: int) -> DetectionBatch:
    """Detections whose image numbers begin at ``first``."""
    return DetectionBatch(
        names=found.names,
        image=found.image + first,
        class_id=found.class_id,
        confidence=found.confidence,
        box_px=found.box_px,
        place=found.place,
    )


def joined(parts: Sequence[DetectionBatch]) -> DetectionBatch:
    """Detections of several batches as one."""
    columns = {
        key: np.concatenate([getattr(part, key) for part in parts])
        for key in ("image", "class_id", "confidence", "box_px", "place")
    }
    return DetectionBatch(names=parts[0].names, **columns)


def _recalls(
    data: LabelledImages, truth: Truth, detections: DetectionBatch
) -> dict[str, dict[str, dict[str, RecallShare]]]:
    """Recalls by looks of an object; of boxes of at least :data:`CONFIDENCE_SHOWN`."""
    is_found = _seen(truth, detections)
    rows = np.flatnonzero(~truth.ignored)
    # The truth's rows that are not ignored are those of the data, in the same order.
    data_rows = np.flatnonzero(~data.ignored)
    hit, class_id = is_found[rows], truth.class_id[rows]
    measures = {
        "size_px": (data.box_px[data_rows, 2:].max(axis=1, initial=0.0), SIZES_PX),
        "distance_m": (data.distance_m[data_rows], DISTANCES_M),
        "visibility": (data.visibility[data_rows], VISIBILITIES),
    }
    result = {}
    for name, (values, edges) in measures.items():
        group = np.searchsorted(np.array(edges, float), values, side="right") - 1
        result[name] = {
            _range(edges, index): {
                label: RecallShare(int((hit & chosen).sum()), int(chosen.sum()))
                for label, chosen in (
                    (label, (group == index) & (class_id == number))
                    for number, label in enumerate(data.names)
                )
            }
            for index in range(len(edges))
        }
    return result


def _seen(truth: Truth, detections: DetectionBatch) -> np.ndarray:
    """bool [M]: whether a reported box of its class overlaps a truth enough."""
    is_found = np.zeros(len(truth.image), bool)
    shown = np.flatnonzero(detections.confidence >= CONFIDENCE_SHOWN)
    one, other = pairs(detections.image[shown], truth.image)
    one = shown[one]
    same = detections.class_id[one] == truth.class_id[other]
    one, other = one[same], other[same]
    enough = overlaps(detections.box_px[one], truth.box_px[other]) >= OVERLAP_MIN
    is_found[other[enough]] = True
    return is_found


def _range(edges: Sequence[float], index: int) -> str:
    low = f"{edges[index]:g}"
    return f"{low} to {edges[index + 1]:g}" if index + 1 < len(edges) else f"from {low}"


def plain(card: Scorecard) -> dict[str, Any]:
    """Scorecard as JSON has it."""
    result = card.evaluation

    def of_class(score: Score | None) -> dict[str, Any]:
        score = score or Score(None, 0, 0)
        return {"ap": score.ap, "objects": score.truths, "detections": score.detections}

    return {
        "map50": result.all.mean_ap,
        "images": result.all.images,
        "classes": {name: of_class(one) for name, one in result.all.classes.items()},
        "car_clear_noon": {**of_class(card.noon), "images": card.noon_images},
        "moderate": {
            "map50": card.moderate.mean_ap,
            "classes": {name: of_class(one) for name, one in card.moderate.classes.items()},
            "car_clear_noon": {**of_class(card.noon_moderate), "images": card.noon_images},
        },
        "groups": {
            label: {
                value: {
                    "map50": scores.mean_ap,
                    "images": scores.images,
                    "classes": {name: of_class(one) for name, one in scores.classes.items()},
                }
                for value, scores in values.items()
            }
            for label, values in result.groups.items()
        },
        "recall": {
            measure: {
                group: {
                    name: {"found": one.found, "objects": one.objects}
                    for name, one in classes.items()
                }
                for group, classes in groups.items()
            }
            for measure, groups in card.recalls.items()
        },
    }
