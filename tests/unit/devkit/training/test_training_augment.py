"""Variations of images: what happens to the picture happens to its boxes."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
import torch

from devkit.training.augment import CHANCES, Augmentation, plan_epoch
from devkit.training.examples import IGNORED, LABEL, NOTHING, Boxes
from devkit.training.parameters import TrainingRecipe

WIDTH, HEIGHT = 160, 96
CPU = torch.device("cpu")

STILL = TrainingRecipe(jitter=0.0, flip=0.0, hue=0.0, saturation=1.0, exposure=1.0)


def chances(count: int, seed: int = 1) -> torch.Tensor:
    return torch.from_numpy(plan_epoch(seed, 0, count)[1])


def one_box(x: float, y: float, width: float, height: float, count: int = 1, kind: int = LABEL):
    box = torch.tensor([[x, y, width, height]]).expand(count, 1, 4)
    ones = torch.ones((count, 1), dtype=torch.int64)
    return Boxes(box, ones, kind * ones)


def test_without_variation_the_picture_stays():
    rng = np.random.default_rng(1)
    images = torch.from_numpy(rng.integers(0, 256, (2, HEIGHT, WIDTH, 3), dtype=np.uint8))
    still = Augmentation(STILL, WIDTH, HEIGHT, CPU)
    found = still.images(images, chances(2))
    assert torch.allclose(found, images.permute(0, 3, 1, 2) / 255.0, atol=1e-5)
    given = one_box(0.4, 0.5, 0.2, 0.3, 2)
    boxes = still.boxes(given, chances(2))
    assert torch.allclose(boxes.box, given.box, atol=1e-6)
    assert torch.equal(boxes.kind, given.kind)


def test_boxes_stay_on_their_objects():
    count = 40
    recipe = TrainingRecipe(jitter=0.3, flip=0.5, hue=0.0, saturation=1.0, exposure=1.0)
    images = np.zeros((count, HEIGHT, WIDTH, 3), np.uint8)
    images[:, 30:54, 70:90] = 255
    augmentation = Augmentation(recipe, WIDTH, HEIGHT, CPU)
    chance = chances(count)
    seen = augmentation.images(torch.from_numpy(images), chance)[:, 0]
    boxes = augmentation.boxes(one_box(80 / 160, 42 / 96, 20 / 160, 24 / 96, count), chance)
    mirrored = 0
    for picture, (x, y, width, height) in zip(seen, boxes.box[:, 0].tolist(), strict=True):
        rows, columns = np.nonzero((picture > 0.75).numpy())
        left, right = x - width / 2, x + width / 2
        assert columns.min() == pytest.approx(left * WIDTH, abs=1.5)
        assert columns.max() + 1 == pytest.approx(right * WIDTH, abs=1.5)
        assert rows.min() == pytest.approx((y - height / 2) * HEIGHT, abs=1.5)
        assert rows.max() + 1 == pytest.approx((y + height / 2) * HEIGHT, abs=1.5)
        mirrored += x < 0.45
    assert (boxes.kind == LABEL).all()
    assert 0 < mirrored < count


def test_outside_the_picture_is_grey():
    chance = torch.zeros(1, CHANCES)
    chance[0, :2], chance[0, 2:5] = 0.0, 0.5
    smaller = Augmentation(TrainingRecipe(jitter=0.5, flip=0.0), WIDTH, HEIGHT, CPU)
    white = torch.full((1, HEIGHT, WIDTH, 3), 255, dtype=torch.uint8)
    chance[0, 5:] = 0.5  # no change of colour
    found = smaller.images(white, chance)
    assert torch.allclose(found[0, :, 2, 2], torch.full((3,), 0.5), atol=1e-5)
    assert torch.allclose(found[0, :, -2, -2], torch.ones(3), atol=1e-5)


def test_what_the_edge_leaves_too_little_of_is_ignored_and_what_is_gone_is_gone():
    chance = torch.zeros(1, CHANCES)
    chance[0, :4] = torch.tensor([1.0, 0.5, 0.5, 0.5])  # the left fifth is cut off
    cut = Augmentation(TrainingRecipe(jitter=0.2, flip=0.0, remaining_min=0.5), WIDTH, HEIGHT, CPU)
    kinds = {}
    for x in (0.1, 0.18, 0.22, 0.5):
        boxes = cut.boxes(one_box(x, 0.5, 0.1, 0.2), chance)
        kinds[x] = int(boxes.kind)
        if boxes.kind != NOTHING:
            assert boxes.box[0, 0, 0] - boxes.box[0, 0, 2] / 2 >= 0
    assert kinds == {0.1: NOTHING, 0.18: IGNORED, 0.22: LABEL, 0.5: LABEL}
    small = cut.boxes(one_box(0.5, 0.5, 3 / WIDTH, 3 / HEIGHT), chance)
    assert int(small.kind) == IGNORED
    ignored = cut.boxes(one_box(0.5, 0.5, 0.2, 0.2, kind=IGNORED), chance)
    assert int(ignored.kind) == IGNORED


def test_colours_change_as_named():
    red = torch.zeros((1, HEIGHT, WIDTH, 3), dtype=torch.uint8)
    red[..., 0], red[..., 1:] = 150, 60
    before = colorsys.rgb_to_hsv(150 / 255, 60 / 255, 60 / 255)

    def varied(place: int, value: float, **changes):
        chance = torch.full((1, CHANCES), 0.5)
        chance[0, place] = value
        recipe = TrainingRecipe(jitter=0.0, flip=0.0, **changes)
        found = Augmentation(recipe, WIDTH, HEIGHT, CPU).images(red, chance)
        return colorsys.rgb_to_hsv(*found[0, :, 5, 5].tolist())

    bright = varied(7, 1.0, exposure=1.5)
    assert bright[2] == pytest.approx(1.5 * before[2], rel=1e-3)
    assert bright[:2] == pytest.approx(before[:2], abs=1e-3)
    assert varied(7, 0.0, exposure=1.5)[2] == pytest.approx(before[2] / 1.5, rel=1e-3)
    assert varied(6, 1.0, saturation=1.5)[1] > before[1] + 0.05
    assert varied(6, 0.0, saturation=1.5)[1] < before[1] - 0.05
    turned = varied(5, 1.0, hue=0.1)[0]
    assert 0.03 < min(turned, 1.0 - turned) < 0.2
    assert turned != pytest.approx(varied(5, 0.0, hue=0.1)[0], abs=0.05)


def test_every_epoch_has_its_own_order_and_chances():
    first, again, other = plan_epoch(1, 0, 50), plan_epoch(1, 0, 50), plan_epoch(1, 1, 50)
    assert sorted(first[0].tolist()) == list(range(50))
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])
    assert not np.array_equal(first[1], other[1])
    assert first[1].shape == (50, CHANCES)
    assert first[1].min() >= 0
    assert first[1].max() < 1
