"""devkit.detector.decode: against plain loops over the papers' formulas, and at its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from devkit.detector import decode as detector_decode
from devkit.detector.decode import Selection, decode, suppress
from devkit.detector.description import BoxHead, DetectorDescription, GridHead

NAMES = ["car", "truck", "sign"]
REGION = GridHead("a", [(20.0, 30.0), (50.0, 24.0)], "softmax")
YOLO = GridHead("b", [(8.0, 9.0), (16.0, 30.0), (33.0, 23.0)], "logistic")
STRETCHED = GridHead("c", [(12.0, 12.0)], "logistic", 1.2)
DESCRIPTION = DetectorDescription(96, 64, NAMES, [REGION, YOLO, STRETCHED])
SIZES = [(640, 360), (320, 192)]


def outputs(seed: int, scale: float = 2.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    shapes = {"a": (2, 16, 2, 3), "b": (2, 24, 4, 6), "c": (2, 8, 8, 12)}
    return {k: (scale * rng.standard_normal(s)).astype(np.float32) for k, s in shapes.items()}


def logistic(t: float) -> float:
    return 1.0 / (1.0 + math.exp(-t))


def by_loops(raw, image, selection) -> list[tuple]:
    """(place, class, confidence, box) of every candidate, in the network's order."""
    found, place = [], 0
    width_px, height_px = SIZES[image]
    for head in DESCRIPTION.heads:
        _, _, rows, columns = raw[head.output].shape
        for j in range(rows):
            for i in range(columns):
                for n, (anchor_w, anchor_h) in enumerate(head.anchors_px):
                    t = [float(v) for v in raw[head.output][image, 8 * n : 8 * n + 8, j, i]]
                    scores = t[5:]
                    best = scores.index(max(scores))
                    if head.scores == "softmax":
                        share = math.exp(scores[best]) / sum(math.exp(s) for s in scores)
                    else:
                        share = logistic(scores[best])
                    s = head.scale_xy
                    x = (i + logistic(t[0]) * s - (s - 1) / 2) / columns * width_px
                    y = (j + logistic(t[1]) * s - (s - 1) / 2) / rows * height_px
                    w = anchor_w * math.exp(t[2]) / 96 * width_px
                    h = anchor_h * math.exp(t[3]) / 64 * height_px
                    left, right = max(x - w / 2, 0), min(x + w / 2, width_px)
                    top, bottom = max(y - h / 2, 0), min(y + h / 2, height_px)
                    confidence = logistic(t[4]) * share
                    if confidence >= selection.confidence_min and right > left and bottom > top:
                        found.append((place, best, confidence, (left, top, right, bottom)))
                    place += 1
    return found


def overlap(a, b) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    shared = max(width, 0) * max(height, 0)
    area = [(c[2] - c[0]) * (c[3] - c[1]) for c in (a, b)]
    return shared / (sum(area) - shared)


def suppressed(candidates, selection):
    kept = []
    for one in sorted(candidates, key=lambda c: (-c[2], c[0])):
        rivals = [k for k in kept if selection.across_classes or k[1] == one[1]]
        if all(overlap(k[3], one[3]) <= selection.overlap_max for k in rivals):
            kept.append(one)
    return kept


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("across_classes", [False, True])
def test_decode_and_suppression_against_loops(seed, across_classes):
    selection = Selection(confidence_min=0.2, overlap_max=0.3, across_classes=across_classes)
    raw = outputs(seed)
    found = decode(raw, DESCRIPTION, SIZES, selection)
    assert len(found.image) > 20
    for image in (0, 1):
        expected = suppressed(by_loops(raw, image, selection), selection)
        rows = found.image == image
        assert found.place[rows].tolist() == [c[0] for c in expected]
        assert found.class_id[rows].tolist() == [c[1] for c in expected]
        assert found.confidence[rows] == pytest.approx([c[2] for c in expected], rel=1e-6)
        corners = np.array([c[3] for c in expected])
        low, size = found.box_px[rows, :2], found.box_px[rows, 2:]
        assert np.allclose(np.concatenate([low, low + size], axis=1), corners, rtol=1e-6, atol=1e-3)


def empty(head: GridHead) -> dict[str, np.ndarray]:
    """No object anywhere; centres in the middle of their cells, sizes those of the anchors."""
    raw = {k: np.zeros_like(v) for k, v in outputs(0).items()}
    for name, array in raw.items():
        anchors = len(next(h for h in DESCRIPTION.heads if h.output == name).anchors_px)
        array.reshape(2, anchors, 8, *array.shape[2:])[:, :, 4] = -100.0
    return raw


def test_one_box_by_hand():
    raw = empty(YOLO)
    raw["b"][1, 8 + 4, 1, 2] = 100.0  # anchor 1, cell row 1 column 2
    raw["b"][1, 8 + 6, 1, 2] = 100.0  # truck
    found = decode(raw, DESCRIPTION, SIZES, Selection())
    (one,) = found.of(1)
    assert found.of(0) == []
    # Centre (2.5/6, 1.5/4) of 320x192; size (16/96, 30/64) of it.
    expected = (320 * 2.5 / 6 - 80 / 3, 192 * 1.5 / 4 - 45, 160 / 3, 90)
    assert (one.label, one.confidence) == ("truck", 1.0)
    assert (one.x_px, one.y_px, one.width_px, one.height_px) == pytest.approx(expected)


def test_confidence_limit_is_inclusive():
    raw = empty(REGION)
    raw["a"][0, 4, 0, 0] = 0.0  # objectness 1/2, three equal classes: 1/6
    for limit, count in ((1 / 6, 1), (math.nextafter(1 / 6, 1.0), 0)):
        found = decode(raw, DESCRIPTION, SIZES, Selection(confidence_min=limit))
        assert len(found.image) == count


def test_equal_confidence_is_decided_by_place():
    raw = empty(YOLO)
    for anchor in (0, 1, 2):
        raw["b"][0, 8 * anchor + 4, 0, 0] = 100.0
        raw["b"][0, 8 * anchor + 2, 0, 0] = math.log(30 / YOLO.anchors_px[anchor][0])
        raw["b"][0, 8 * anchor + 3, 0, 0] = math.log(30 / YOLO.anchors_px[anchor][1])
    found = decode(raw, DESCRIPTION, SIZES, Selection())
    assert found.place.tolist() == [12]  # behind the 2 x 3 cells x 2 anchors of the first head
    assert found.names[found.class_id[0]] == "car"


def test_the_networks_own_order():
    raw = empty(YOLO)
    for column, value in ((1, 1.0), (3, 3.0), (5, 2.0)):
        raw["b"][0, 4, 0, column] = value
        raw["b"][0, 5, 0, column] = 9.0
    found = decode(raw, DESCRIPTION, SIZES, Selection())
    confidence = [d.confidence for d in found.of(0)]
    assert confidence == sorted(confidence, reverse=True)
    in_place = [d.x_px for d in found.of(0, by_place=True)]
    assert in_place == sorted(in_place)
    assert len(in_place) == 3


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_no_box(value):
    raw = outputs(1)
    raw["b"][0] = value
    found = decode(raw, DESCRIPTION, SIZES, Selection(confidence_min=0.2))
    first = 2 * 3 * 2
    second = first + 4 * 6 * 3
    in_b = (found.image == 0) & (found.place >= first) & (found.place < second)
    assert not in_b.any()
    assert (found.image == 0).any()
    assert np.isfinite(found.box_px).all()


def test_huge_values_stay_inside_the_image():
    raw = {name: 1000.0 * array for name, array in outputs(2).items()}
    found = decode(raw, DESCRIPTION, SIZES, Selection())
    assert len(found.image) > 0
    size = np.array(SIZES)[found.image]
    assert (found.box_px[:, :2] >= 0).all()
    assert (found.box_px[:, :2] + found.box_px[:, 2:] <= size + 1e-9).all()


def test_most_confident_candidates_are_looked_at():
    raw = outputs(3)
    everything = decode(raw, DESCRIPTION, SIZES, Selection(overlap_max=1.0))
    few = decode(raw, DESCRIPTION, SIZES, Selection(overlap_max=1.0, candidates_max=5))
    for image in (0, 1):
        assert few.of(image) == everything.of(image)[:5]


def test_overlap_limit_keeps_a_box_that_just_meets_it():
    box = np.array([[0.0, 0.0, 10.0, 10.0], [0.0, 5.0, 10.0, 10.0]])  # 50 / 150
    group = np.zeros(2, int)
    assert suppress(box, group, 50 / 150).tolist() == [0, 1]
    assert suppress(box, group, math.nextafter(50 / 150, 0.0)).tolist() == [0]
    assert suppress(box, np.array([0, 1]), 0.0).tolist() == [0, 1]
    assert suppress(np.zeros((0, 4)), np.zeros(0, int), 0.5).tolist() == []


def test_a_suppressed_box_suppresses_nothing():
    box = np.array([[0.0, 0.0, 10.0, 10.0], [4.0, 0.0, 10.0, 10.0], [8.0, 0.0, 10.0, 10.0]])
    assert suppress(box, np.zeros(3, int), 0.3).tolist() == [0, 2]


@pytest.mark.parametrize("pairs_max", [1 << 18, 900, 30])
@pytest.mark.parametrize("across", [False, True])
def test_images_of_a_batch_are_suppressed_each_for_itself(monkeypatch, pairs_max, across):
    """Together, in turns, or one by one, as their number of boxes allows."""
    monkeypatch.setattr(detector_decode, "PAIRS_MAX", pairs_max)
    rng = np.random.default_rng(7)
    counts = [0, 1, 9, 0, 30, 2, 17, 1, 25, 3]
    image = np.repeat(np.arange(len(counts)), counts)
    box = np.concatenate(
        [rng.uniform(0, 40, (len(image), 2)), rng.uniform(5, 30, (len(image), 2))], 1
    )
    group = np.zeros(len(image), int) if across else rng.integers(0, 3, len(image))
    found = detector_decode._suppressed(box, group, image, len(counts), 0.3)
    expected = []
    for index in range(len(counts)):
        rows = np.flatnonzero(image == index)
        expected += rows[suppress(box[rows], group[rows], 0.3)].tolist()
    assert found.tolist() == expected
    assert 10 < len(expected) < len(image) - 10


def test_messages_of_all_images_are_those_of_each():
    found = decode(outputs(6), DESCRIPTION, SIZES, Selection())
    for by_place in (False, True):
        together = found.each(len(SIZES), by_place=by_place)
        assert together == [found.of(i, by_place=by_place) for i in range(len(SIZES))]
        assert all(together)
    assert found.each(len(SIZES) + 1)[-1] == []


def test_an_image_is_decoded_the_same_alone_and_beside_others():
    raw = outputs(5)
    together = decode(raw, DESCRIPTION, SIZES, Selection())
    alone = decode({k: v[1:] for k, v in raw.items()}, DESCRIPTION, SIZES[1:], Selection())
    assert alone.of(0) == together.of(1)
    assert len(alone.of(0)) > 0


def test_finished_boxes_by_hand():
    raw = np.zeros((2, 4, 8), np.float32)
    raw[1, 2] = (48, 32, 24, 16, 0.5, 0.25, 0.75, 0.125)
    raw[1, 3] = (48, 32, 24, 16, 0.5, 0.25, 0.25, 0.875)
    raw[0, 0] = (48, 32, np.nan, 16, 1, 1, 0, 0)
    raw[0, 1] = (48, 32, -5, 16, 1, 1, 0, 0)
    heads = [YOLO, BoxHead("d")]
    description = DetectorDescription(96, 64, NAMES, heads)
    outputs = {**empty(YOLO), "d": raw}
    found = decode(outputs, description, SIZES, Selection(confidence_min=0.375))
    assert found.of(0) == []
    assert [(d.label, d.confidence) for d in found.of(1)] == [("sign", 0.4375), ("truck", 0.375)]
    assert found.box_px.tolist() == [[120, 72, 80, 48]] * 2  # of 320x192
    assert found.place.tolist() == [4 * 6 * 3 + 3, 4 * 6 * 3 + 2]
    strict = Selection(confidence_min=0.375, across_classes=True)
    assert [d.label for d in decode(outputs, description, SIZES, strict).of(1)] == ["sign"]


def test_finished_boxes_in_columns_without_objectness():
    rng = np.random.default_rng(0)
    rows = rng.random((2, 50, 7), dtype=np.float32) * np.array(
        [96, 64, 40, 30, 1, 1, 1], np.float32
    )
    with_one = np.insert(rows, 4, 1.0, axis=2)
    selection = Selection(confidence_min=0.5)
    plain = DetectorDescription(96, 64, NAMES, [BoxHead("d", "columns", objectness=False)])
    usual = DetectorDescription(96, 64, NAMES, [BoxHead("d", "rows")])
    left = decode({"d": rows.transpose(0, 2, 1)}, plain, SIZES, selection)
    right = decode({"d": with_one}, usual, SIZES, selection)
    assert len(left.image) > 10
    for image in (0, 1):
        assert left.of(image) == right.of(image)


@pytest.mark.parametrize("pairs_max", [1, 7, 40, 1 << 18])
def test_suppression_in_blocks_is_that_of_one_box_after_the_other(monkeypatch, pairs_max):
    monkeypatch.setattr(detector_decode, "PAIRS_MAX", pairs_max)
    rng = np.random.default_rng(5)
    for count in (0, 1, 2, 20):
        box = np.concatenate([rng.uniform(0, 20, (count, 2)), rng.uniform(0, 12, (count, 2))], 1)
        corners = np.concatenate([box[:, :2], box[:, :2] + box[:, 2:]], 1)
        group = rng.integers(0, 2, count)
        kept: list[int] = []
        for index in range(count):
            if all(
                group[other] != group[index] or overlap(corners[other], corners[index]) <= 0.3
                for other in kept
            ):
                kept.append(index)
        assert detector_decode.suppress(box, group, 0.3).tolist() == kept
