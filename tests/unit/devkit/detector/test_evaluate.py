"""devkit.detector.evaluate: cases computed by hand, and both methods against plain loops."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from detection_rows import detections_of

from devkit.detector.decode import DetectionBatch
from devkit.detector.evaluate import Truth, average_precision, evaluate, overlaps, table

NAMES = ("car", "truck")

found = partial(detections_of, NAMES)


def truth(*rows) -> Truth:
    """Rows (image, class, x, y, width, height, ignored)."""
    data = np.array(rows, np.float64).reshape(-1, 7)
    return Truth(
        data[:, 0].astype(int), data[:, 1].astype(int), data[:, 2:6], data[:, 6].astype(bool)
    )


def score(truths, detections, images=2, **how):
    return evaluate(NAMES, images, truth(*truths), found(*detections), **how).all


BOX = (0, 0, 10, 10)
FAR = (50, 50, 10, 10)


# --- the curve ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("right", "truths", "voc", "coco"),
    [
        ([1], 1, 1.0, 1.0),
        ([0], 1, 0.0, 0.0),
        ([], 1, 0.0, 0.0),
        ([1], 2, 0.5, 51 / 101),  # recalls 0 to 0.50
        ([0, 1], 1, 0.5, 0.5),
        # precision 1, 1/2, 2/3 at recall 1/2, 1/2, 1: monotone 1, 2/3, 2/3
        ([1, 0, 1], 2, 0.5 + 0.5 * 2 / 3, (51 + 50 * 2 / 3) / 101),
        # precision 0, 1/2, 2/3, 1/2: monotone 2/3 up to recall 2/3, nothing beyond
        ([0, 1, 1, 0], 3, 2 / 3 * 2 / 3, 67 * 2 / 3 / 101),
    ],
)
def test_average_precision_by_hand(right, truths, voc, coco):
    flags = np.array(right, bool)
    assert average_precision(flags, truths, "voc") == pytest.approx(voc)
    assert average_precision(flags, truths, "coco") == pytest.approx(coco)


def test_overlap_by_hand():
    left = np.array([BOX, BOX, BOX, BOX, (0, 0, 0, 0)], float)
    right = np.array([BOX, (5, 0, 10, 10), (5, 5, 10, 10), FAR, (0, 0, 0, 0)], float)
    assert overlaps(left, right).tolist() == pytest.approx([1, 1 / 3, 25 / 175, 0, 0])


# --- matching -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["voc", "coco"])
def test_perfect_detections(method):
    truths = [(0, 0, *BOX, 0), (1, 0, *FAR, 0), (1, 1, *BOX, 0)]
    detections = [(0, 0, 0.9, *BOX), (1, 0, 0.2, *FAR), (1, 1, 0.5, *BOX)]
    result = score(truths, detections, method=method)
    assert result.mean_ap == pytest.approx(1.0)
    assert [result.classes[name].truths for name in NAMES] == [2, 1]


@pytest.mark.parametrize("method", ["voc", "coco"])
def test_a_second_box_on_one_object_is_false(method):
    detections = [(0, 0, 0.9, *BOX), (0, 0, 0.8, *BOX), (1, 0, 0.7, *BOX)]
    result = score([(0, 0, *BOX, 0), (1, 0, *BOX, 0)], detections, method=method)
    expected = average_precision(np.array([1, 0, 1], bool), 2, method)
    assert result.classes["car"].ap == pytest.approx(expected)


@pytest.mark.parametrize("method", ["voc", "coco"])
def test_image_and_class_must_agree(method):
    result = score([(0, 0, *BOX, 0)], [(1, 0, 0.9, *BOX), (0, 1, 0.8, *BOX)], method=method)
    assert (result.classes["car"].ap, result.classes["car"].detections) == (0.0, 1)
    assert (result.classes["truck"].ap, result.classes["truck"].detections) == (None, 1)
    assert result.mean_ap == 0.0


@pytest.mark.parametrize("method", ["voc", "coco"])
def test_overlap_of_exactly_the_limit_is_enough(method):
    half = (0, 0, 10, 5)
    assert score([(0, 0, *BOX, 0)], [(0, 0, 0.9, *half)], method=method).mean_ap == 1.0
    less = (0, 0, 10, 4.99)
    assert score([(0, 0, *BOX, 0)], [(0, 0, 0.9, *less)], method=method).mean_ap == 0.0
    strict = score([(0, 0, *BOX, 0)], [(0, 0, 0.9, *half)], method=method, overlap_min=0.51)
    assert strict.mean_ap == 0.0


@pytest.mark.parametrize("method", ["voc", "coco"])
def test_ignored_truths_take_their_detections_with_them(method):
    truths = [(0, 0, *BOX, 1), (0, 0, *FAR, 0)]
    detections = [(0, 0, 0.9, *BOX), (0, 0, 0.8, *BOX), (0, 0, 0.7, *FAR)]
    car = score(truths, detections, method=method).classes["car"]
    assert (car.ap, car.truths, car.detections) == (1.0, 1, 1)


def test_where_the_two_methods_differ():
    # Both detections overlap the left truth most; the second also has enough of the right one.
    truths = [(0, 0, 0, 0, 10, 10, 0), (0, 0, 3, 0, 10, 10, 0)]
    detections = [(0, 0, 0.9, 0, 0, 10, 10), (0, 0, 0.8, 1, 0, 10, 10)]
    assert score(truths, detections, method="voc").mean_ap == pytest.approx(0.5)
    assert score(truths, detections, method="coco").mean_ap == pytest.approx(1.0)


def by_loops(truths: Truth, detections: DetectionBatch, class_id: int, method: str, limit: float):
    """(right or false per detection that counts, number of truths), box by box."""
    order = sorted(
        (k for k in range(len(detections.image)) if detections.class_id[k] == class_id),
        key=lambda k: (-detections.confidence[k], detections.image[k], detections.place[k]),
    )
    taken, flags = set(), []
    for k in order:
        candidates = []
        for m in range(len(truths.image)):
            if truths.class_id[m] != class_id or truths.image[m] != detections.image[k]:
                continue
            overlap = overlaps(detections.box_px[k : k + 1], truths.box_px[m : m + 1])[0]
            if overlap >= limit:
                candidates.append((bool(truths.ignored[m]), -overlap, m))
        if method == "voc":
            candidates = sorted(candidates, key=lambda c: (c[1], c[2]))[:1]
        else:
            candidates = sorted(c for c in candidates if c[2] not in taken)
        if candidates and candidates[0][0]:
            continue
        right = bool(candidates) and candidates[0][2] not in taken
        if right:
            taken.add(candidates[0][2])
        flags.append(right)
    total = sum((truths.class_id == class_id) & ~truths.ignored)
    return np.array(flags, bool), int(total)


@pytest.mark.parametrize("method", ["voc", "coco"])
@pytest.mark.parametrize("seed", range(5))
def test_against_loops(method, seed):
    rng = np.random.default_rng(seed)
    images, objects = 8, 60

    def boxes(count):
        # Few places and sizes: many overlaps, and many that are equal.
        return np.concatenate(
            [rng.integers(0, 5, (count, 2)) * 3.0, rng.integers(2, 4, (count, 2)) * 5.0], axis=1
        )

    truths = Truth(
        rng.integers(0, images, objects),
        rng.integers(0, 2, objects),
        boxes(objects),
        rng.random(objects) < 0.2,
    )
    count = 150
    detections = DetectionBatch(
        NAMES,
        rng.integers(0, images, count),
        rng.integers(0, 2, count),
        rng.integers(1, 20, count) / 20,
        boxes(count),
        rng.permutation(count),
    )
    labels = {"weather": [("fog", "rain")[i % 2] for i in range(images)]}
    result = evaluate(NAMES, images, truths, detections, labels, method=method)
    kinds = set()
    for group, chosen in (
        (result.all, range(images)),
        (result.groups["weather"]["fog"], (0, 2, 4, 6)),
    ):
        kept = np.isin(truths.image, list(chosen))
        part = Truth(
            *(getattr(truths, n)[kept] for n in ("image", "class_id", "box_px", "ignored"))
        )
        mine = np.isin(detections.image, list(chosen))
        some = DetectionBatch(
            NAMES,
            *(getattr(detections, n)[mine] for n in ("image", "class_id", "confidence", "box_px")),
            detections.place[mine],
        )
        for class_id, name in enumerate(NAMES):
            flags, total = by_loops(part, some, class_id, method, 0.5)
            found_score = group.classes[name]
            assert (found_score.truths, found_score.detections) == (total, len(flags))
            assert found_score.ap == average_precision(flags, total, method)
            kinds |= set(flags.tolist())
    assert kinds == {True, False}


# --- groups -------------------------------------------------------------------------------------


def test_groups_see_their_own_images_only():
    truths = [(0, 0, *BOX, 0), (1, 0, *BOX, 0), (2, 1, *BOX, 0)]
    detections = [(0, 0, 0.9, *BOX), (1, 0, 0.8, *FAR)]
    result = evaluate(
        NAMES,
        4,
        truth(*truths),
        found(*detections),
        {"weather": ["clear", "fog", "fog", "rain"], "hour": [12, 12, 0, 0]},
    )
    weather = result.groups["weather"]
    assert list(weather) == ["clear", "fog", "rain"]
    assert weather["clear"].classes["car"].ap == 1.0
    assert weather["fog"].classes["car"].ap == 0.0
    assert weather["fog"].classes["truck"].ap == 0.0
    assert (weather["rain"].mean_ap, weather["rain"].images) == (None, 1)
    assert result.groups["hour"]["12"].classes["car"].ap == pytest.approx(0.5)
    assert result.all.mean_ap == pytest.approx(0.25)
    assert table(result).splitlines() == [
        "| images | n | mAP@0.5 (voc) | car | truck |",
        "|---|--:|--:|--:|--:|",
        "| all | 4 | 25.0 | 50.0 | 0.0 |",
        "| weather clear | 1 | 100.0 | 100.0 | - |",
        "| weather fog | 2 | 0.0 | 0.0 | 0.0 |",
        "| weather rain | 1 | - | - | - |",
        "| hour 0 | 2 | 0.0 | - | 0.0 |",
        "| hour 12 | 2 | 50.0 | 50.0 | - |",
    ]


def test_nothing_at_all():
    result = score([], [])
    assert result.mean_ap is None
    assert result.classes["car"].ap is None
    assert score([(0, 0, *BOX, 0)], []).mean_ap == 0.0


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"images": 1}, "found image: given 1 to 1, allowed: below 1"),
        ({"names": ("car",)}, "classes: truth has car; found car, truck"),
        ({"labels": {"hour": ["1"]}}, "label hour: 1 values for 2 images"),
        ({"overlap_min": 0.0}, "overlap_min: given 0, allowed: above 0 to 1"),
    ],
)
def test_what_does_not_fit(change, line):
    arguments = {
        "names": NAMES,
        "images": 2,
        "truth": truth((0, 0, *BOX, 0)),
        "found": found((1, 0, 0.5, *BOX)),
        **change,
    }
    with pytest.raises(ValueError, match=line):
        evaluate(**arguments)


def test_boxes_that_are_apart_both_ways_share_nothing():
    """Two negative sides make a positive area."""
    left, right = np.array([[0.0, 0, 10, 10]]), np.array([[15.0, 15, 10, 10]])
    assert overlaps(left, right).tolist() == [0.0]
