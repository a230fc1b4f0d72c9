"""The losses against a plain NumPy reading of the papers, one object and one cell at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from devkit.darknet.build import build_network
from devkit.darknet.network import DarknetNetwork
from devkit.darknet.sections import parse_sections
from devkit.training.examples import IGNORED, LABEL, NOTHING, Boxes
from devkit.training.loss import GridLoss, complete_overlap
from devkit.training.parameters import TrainingRecipe

CLASSES = 3
WIDTH, HEIGHT = 96, 64

NET = f"[net]\nwidth={WIDTH}\nheight={HEIGHT}\n"
REGION = NET + (
    "[convolutional]\nfilters=16\nsize=16\nstride=16\nactivation=linear\n"
    "[region]\nanchors=0.6,0.5,2,1.5\nclasses=3\nnum=2\nsoftmax=1\n"
)
YOLO = NET + (
    "[convolutional]\nfilters=16\nsize=16\nstride=16\nactivation=linear\n"
    "[yolo]\nmask=2,3\nanchors=6,8,12,10,24,20,50,40\nclasses=3\nnum=4\n"
    "[route]\nlayers=-2\n"
    "[upsample]\nstride=2\n"
    "[convolutional]\nfilters=16\nsize=1\nstride=1\nactivation=linear\n"
    "[yolo]\nmask=0,1\nanchors=6,8,12,10,24,20,50,40\nclasses=3\nnum=4\nscale_x_y=1.1\n"
)


def network(text: str) -> DarknetNetwork:
    return build_network(parse_sections(text, "a.cfg"), "a.cfg")


def boxes(*rows: tuple[float, ...]) -> Boxes:
    """One image; rows (x, y, width, height, class, kind)."""
    data = np.array(rows, np.float64).reshape(1, -1, 6)
    return Boxes(
        torch.tensor(data[..., :4], dtype=torch.float32),
        torch.tensor(data[..., 4], dtype=torch.int64),
        torch.tensor(data[..., 5], dtype=torch.int64),
    )


def random_boxes(seed: int, images: int = 3, places: int = 7) -> Boxes:
    rng = np.random.default_rng(seed)
    size = np.exp(rng.uniform(np.log(0.04), np.log(0.6), (images, places, 2)))
    centre = 0.5 * size + rng.random((images, places, 2)) * (1.0 - size)
    return Boxes(
        torch.tensor(np.concatenate([centre, size], axis=2), dtype=torch.float32),
        torch.tensor(rng.integers(0, CLASSES, (images, places))),
        torch.tensor(rng.choice([NOTHING, LABEL, LABEL, LABEL, IGNORED], (images, places))),
    )


def random_raw(net: DarknetNetwork, seed: int, images: int = 3) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [
        torch.randn(images, *net.layers[h.inputs[0]].shape, generator=generator)
        for h in net.heads()
    ]


# --- the papers, slowly ---------------------------------------------------------------------------


def logistic(value: float) -> float:
    return 1.0 / (1.0 + math.exp(-value))


def cross_entropy(value: float, wanted: float) -> float:
    p = logistic(value)
    return -wanted * math.log(p) - (1.0 - wanted) * math.log(1.0 - p)


def iou(a, b) -> float:
    width = min(a[0] + a[2] / 2, b[0] + b[2] / 2) - max(a[0] - a[2] / 2, b[0] - b[2] / 2)
    height = min(a[1] + a[3] / 2, b[1] + b[3] / 2) - max(a[1] - a[3] / 2, b[1] - b[3] / 2)
    shared = max(width, 0.0) * max(height, 0.0)
    return shared / (a[2] * a[3] + b[2] * b[3] - shared)


def slow(
    net: DarknetNetwork, raw: list[torch.Tensor], truth: Boxes, recipe: TrainingRecipe
) -> np.ndarray:
    """box, objectness, background, class; per image."""
    total = np.zeros(4)
    images = len(truth.box)
    for image in range(images):
        rows = [
            (truth.box[image, m].tolist(), int(truth.class_id[image, m]), int(kind))
            for m, kind in enumerate(truth.kind[image].tolist())
        ]
        total += slow_image(net, [values[image].tolist() for values in raw], rows, recipe)
    return total / images


def slow_image(net: DarknetNetwork, raw, rows, recipe: TrainingRecipe) -> np.ndarray:
    heads = net.heads()
    owners, dropped = responsible(net, rows)
    parts = np.zeros(4)
    for number, head in enumerate(heads):
        columns, lines = head.shape.width, head.shape.height
        v2 = head.scores == "softmax"
        for anchor, (p_w, p_h) in enumerate(head.anchors_px):
            for j in range(lines):
                for i in range(columns):
                    t = [raw[number][anchor * (5 + CLASSES) + k][j][i] for k in range(5 + CLASSES)]
                    centre = [logistic(v) * head.scale_xy - (head.scale_xy - 1) / 2 for v in t[:2]]
                    box = (
                        (i + centre[0]) / columns,
                        (j + centre[1]) / lines,
                        p_w / WIDTH * math.exp(t[2]),
                        p_h / HEIGHT * math.exp(t[3]),
                    )
                    place = (number, anchor, j, i)
                    if place in owners:
                        parts += of_object(owners[place], t, box, head, (p_w, p_h), (i, j), recipe)
                    elif place not in dropped and not near(box, rows, v2, recipe):
                        parts[2] += logistic(t[4]) ** 2 / 2 if v2 else cross_entropy(t[4], 0.0)
    return parts


def responsible(net: DarknetNetwork, rows):
    """(head, anchor, row, column) -> object, and the places of ignored ones."""
    owners, dropped = {}, set()
    for box, class_id, kind in rows:
        if kind == NOTHING:
            continue
        shapes = [
            (number, anchor, iou((0, 0, *box[2:]), (0, 0, w / WIDTH, h / HEIGHT)))
            for number, head in enumerate(net.heads())
            for anchor, (w, h) in enumerate(head.anchors_px)
        ]
        number, anchor, _ = max(shapes, key=lambda shape: shape[2])
        shape = net.heads()[number].shape
        place = (number, anchor, int(box[1] * shape.height), int(box[0] * shape.width))
        if kind == LABEL:
            owners[place] = (box, class_id)
        else:
            dropped.add(place)
    return owners, dropped


def near(box, rows, v2: bool, recipe: TrainingRecipe) -> bool:
    limit = 0.6 if v2 else 0.7
    return any(
        (kind == LABEL and iou(box, b) > limit)
        or (kind == IGNORED and iou(box, b) > recipe.overlap_dropped)
        for b, _, kind in rows
    )


def of_object(owner, t, box, head, anchor, cell, recipe) -> np.ndarray:
    own, class_id = owner
    v2 = head.scores == "softmax"
    weight = 2.0 - own[2] * own[3]
    within = (own[0] * head.shape.width - cell[0], own[1] * head.shape.height - cell[1])
    offset = 0.0
    for value, wanted in zip(t[:2], within, strict=True):
        wanted = (wanted - 0.5) / head.scale_xy + 0.5
        offset += (logistic(value) - wanted) ** 2 / 2 if v2 else cross_entropy(value, wanted)
    for value, extent, size, p in zip(t[2:4], own[2:], (WIDTH, HEIGHT), anchor, strict=True):
        offset += (value - math.log(extent * size / p)) ** 2 / 2
    if v2:
        found = 5.0 * (logistic(t[4]) - iou(box, own)) ** 2 / 2
        scores = np.array(t[5:])
        kind = math.log(np.exp(scores).sum()) - scores[class_id]
    else:
        found = cross_entropy(t[4], 1.0)
        kind = sum(cross_entropy(v, float(k == class_id)) for k, v in enumerate(t[5:]))
    return np.array([weight * offset, found, 0.0, kind])


def fast(
    net: DarknetNetwork, raw: list[torch.Tensor], truth: Boxes, recipe: TrainingRecipe
) -> np.ndarray:
    return np.array([v.item() for v in GridLoss(net, recipe, torch.device("cpu"))(raw, truth)])


@pytest.mark.parametrize("text", [REGION, YOLO], ids=["yolov2", "yolov3"])
@pytest.mark.parametrize("seed", range(6))
def test_as_the_papers_say(text, seed):
    net = network(text)
    truth, raw = random_boxes(seed), random_raw(net, seed)
    recipe = TrainingRecipe(anchor_choices=1)
    expected = slow(net, raw, truth, recipe)
    assert (expected > 0).all()
    assert fast(net, raw, truth, recipe) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("text", [REGION, YOLO], ids=["yolov2", "yolov3"])
def test_scales_multiply_the_parts(text):
    net = network(text)
    truth, raw = random_boxes(1), random_raw(net, 1)
    plain = fast(net, raw, truth, TrainingRecipe())
    recipe = TrainingRecipe(box_scale=2.0, object_scale=3.0, background_scale=0.5, class_scale=0.0)
    assert fast(net, raw, truth, recipe) == pytest.approx(plain * [2.0, 3.0, 0.5, 0.0])


# --- who is responsible ---------------------------------------------------------------------------

CAR = (0.51, 0.52, 0.3, 0.4, 0, LABEL)


def test_without_objects_everything_is_background():
    net = network(YOLO)
    raw = random_raw(net, 1, images=1)
    nothing = fast(net, raw, boxes((0, 0, 0, 0, 0, NOTHING)), TrainingRecipe())
    assert nothing[[0, 1, 3]].tolist() == [0, 0, 0]
    every = sum(float(torch.nn.functional.softplus(v.view(1, 2, 8, *v.shape[2:])[:, :, 4]).sum())
                for v in raw)  # fmt: skip
    assert nothing[2] == pytest.approx(every, rel=1e-5)


def test_an_ignored_object_is_neither_object_nor_background():
    net = network(YOLO)
    raw = [torch.zeros_like(v) for v in random_raw(net, 1, images=1)]
    nothing = fast(net, raw, boxes((0, 0, 0, 0, 0, NOTHING)), TrainingRecipe())
    ignored = fast(net, raw, boxes((*CAR[:5], IGNORED)), TrainingRecipe())
    assert ignored[[0, 1, 3]].tolist() == [0, 0, 0]
    # At least its own place has no loss, ln 2 with an objectness of one half.
    assert ignored[2] <= nothing[2] - math.log(2.0) + 1e-5


def test_of_two_objects_in_one_place_the_later_one_counts():
    net = network(YOLO)
    raw = random_raw(net, 2, images=1)
    other = (0.52, 0.51, 0.31, 0.41, 2, LABEL)
    recipe = TrainingRecipe(anchor_choices=1)
    both = fast(net, raw, boxes(CAR, other), recipe)
    later = fast(net, raw, boxes(other), recipe)
    assert both[[0, 1, 3]] == pytest.approx(later[[0, 1, 3]])


def owners(truth: Boxes, choices: int) -> dict[int, int]:
    """Place -> object."""
    loss = GridLoss(network(YOLO), TrainingRecipe(anchor_choices=choices), torch.device("cpu"))
    owner = loss.claim(truth).owner[0]
    return {place: int(owner[place]) for place in owner.nonzero()[:, 0].tolist()}


def test_an_object_whose_place_is_taken_takes_its_next_anchor():
    other = (0.52, 0.51, 0.31, 0.41, 2, LABEL)
    alone, second = owners(boxes(CAR), 1), owners(boxes(other), 1)
    assert list(alone) == list(second)
    both = owners(boxes(CAR, other), 2)
    assert sorted(both.values()) == [1, 2]
    assert both[next(iter(alone))] == 2
    # In the same cell of the same head, or of another one.
    third = owners(boxes(CAR, other, (0.51, 0.51, 0.32, 0.39, 1, LABEL)), 3)
    assert sorted(third.values()) == [1, 2, 3]
    assert set(both) < set(third)
    lost = owners(boxes(CAR, other, (0.51, 0.51, 0.32, 0.39, 1, LABEL)), 2)
    assert sorted(lost.values()) == [2, 3]


def test_a_first_choice_goes_before_a_second_one():
    other = (0.52, 0.51, 0.31, 0.41, 2, LABEL)
    places = owners(boxes(CAR, other), 2)
    fallback = next(place for place, owner in places.items() if owner == 1)
    # An earlier object whose best place that is keeps it.
    number = {0: 2, 1: 3, 2: 0, 3: 1}  # of the cfg's anchors, in the order of the heads
    width, height = [(6, 8), (12, 10), (24, 20), (50, 40)][number[_anchor(fallback)]]
    fitting = (0.51, 0.52, width / WIDTH, height / HEIGHT, 0, LABEL)
    assert owners(boxes(fitting, CAR, other), 2)[fallback] == 1


def _anchor(place: int) -> int:
    """Of YOLO: two anchors with 4 x 6 cells, then two with 8 x 12."""
    return place // 24 if place < 48 else 2 + (place - 48) // 96


def test_boxes_at_the_very_edge_have_a_cell():
    net = network(REGION)
    raw = random_raw(net, 2, images=1)
    edge = fast(net, raw, boxes((1.0, 1.0, 0.1, 0.1, 0, LABEL)), TrainingRecipe())
    assert np.isfinite(edge).all()
    assert edge[1] > 0


# --- gradients ------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [REGION, YOLO], ids=["yolov2", "yolov3"])
@pytest.mark.parametrize("box_loss", ["squared", "ciou"])
def test_going_down_the_gradient_finds_the_objects(text, box_loss):
    net = network(text)
    truth = boxes(CAR, (0.2, 0.25, 0.06, 0.12, 2, LABEL), (0.8, 0.2, 0.2, 0.2, 1, IGNORED))
    recipe = TrainingRecipe(box_loss=box_loss)
    loss = GridLoss(net, recipe, torch.device("cpu"))
    raw = [v.requires_grad_(True) for v in random_raw(net, 4, images=1)]
    optimizer = torch.optim.Adam(raw, lr=0.1)
    values = []
    for _ in range(150):
        optimizer.zero_grad()
        total = torch.stack(loss(raw, truth)).sum()
        total.backward()
        assert all(torch.isfinite(v.grad).all() for v in raw)
        optimizer.step()
        values.append(total.item())
    assert values[-1] < 0.3 * values[0]
    certain = torch.cat([torch.sigmoid(v.view(2, 8, *v.shape[2:])[:, 4]).flatten() for v in raw])
    assert int((certain > 0.7).sum()) == 2


def test_complete_overlap_by_hand():
    one = torch.tensor([0.5, 0.5, 0.2, 0.2])
    assert float(complete_overlap(one, one)) == pytest.approx(1.0, abs=1e-6)
    # Side by side: IoU 0, centres 0.2 apart, diagonal of both sqrt(0.4^2 + 0.2^2).
    other = torch.tensor([0.7, 0.5, 0.2, 0.2])
    assert float(complete_overlap(one, other)) == pytest.approx(-0.04 / 0.2, abs=1e-5)
    # The same centre, another shape: v = 4/pi^2 (atan 1 - atan 2)^2, alpha = v / (1 - IoU + v).
    wide = torch.tensor([0.5, 0.5, 0.4, 0.2])
    v = 4 / math.pi**2 * (math.atan(1.0) - math.atan(2.0)) ** 2
    assert float(complete_overlap(one, wide)) == pytest.approx(0.5 - v * v / (0.5 + v), abs=1e-5)
