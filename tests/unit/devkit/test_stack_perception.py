"""devkit.perception: contrast from pixels, confidence, thresholds."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import pytest

from devkit.images import Images
from devkit.perception import (
    CONFIDENCE_MIN,
    LUMA_WEIGHTS,
    PIXELS_MAX,
    ContrastPerception,
    Perception,
    Region,
    _luma,
    build_perception,
    confidence,
    pixels_of,
    visible_contrast,
)
from schemas.messages import Detection
from schemas.sections import perception as variants

WIDTH, HEIGHT = 160, 90
BOX = Region(60, 40, 100, 70)
VEIL = np.array([200.0, 205.0, 210.0])


def street(noise_levels: float = 0.0, seed: int = 0, gain: float = 1.0) -> np.ndarray:
    """A dark car with bright windows on a shaded grey street."""
    rows = np.linspace(90.0, 140.0, HEIGHT)[:, None, None]
    image = np.broadcast_to(rows, (HEIGHT, WIDTH, 3)).copy()
    image[BOX.top : BOX.bottom, BOX.left : BOX.right] = (70.0, 40.0, 40.0)
    image[BOX.top + 4 : BOX.top + 12, BOX.left + 6 : BOX.right - 6] = (180.0, 190.0, 200.0)
    image = image * gain
    image += noise_levels * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def veiled(image: np.ndarray, share: float) -> np.ndarray:
    return np.rint((1.0 - share) * image + share * VEIL).astype(np.uint8)


def row(box: Region = BOX, class_id: int = 0, visible_px: float = 1e4) -> np.ndarray:
    width, height = box.right - box.left, box.bottom - box.top
    return np.array([[class_id, box.left, box.top, width, height, visible_px, 20.0]], np.float32)


def perception(contrast_min: float = 0.05, pixels_min: int = 24) -> Perception:
    return build_perception(
        variants.GroundTruthPerception(contrast_min=contrast_min, pixels_min=pixels_min)
    )


def see(eyes: Perception, image: np.ndarray, boxes: np.ndarray) -> list[Detection]:
    """Of one frame."""
    (seen,) = eyes.detect(Images(image[None], [0]), [boxes])
    return seen


def test_frames_seen_together_are_seen_alone():
    frames = np.stack([street(2.0, seed) for seed in range(4)])
    boxes = [row(), row(class_id=3), row()[:0], row(Region(5, 5, 30, 40))]
    order = [2, 0, 3, 1]
    together = perception().detect(Images(frames, order), [boxes[i] for i in order])
    assert together == [see(perception(), frames[i], boxes[i]) for i in order]


def test_the_variant_type_chooses_the_implementation():
    assert isinstance(perception(), ContrastPerception)
    with pytest.raises(ValueError, match="perception Region: not known; allowed: ground_tr"):
        build_perception(BOX)


def test_confidence_is_exactly_one_half_at_the_threshold():
    for contrast_min in (0.05, 0.1, 0.3, 1.0, 1e-3):
        assert confidence(contrast_min, contrast_min) == 0.5
        assert confidence(math.nextafter(contrast_min, 0.0), contrast_min) <= 0.5
        assert confidence(contrast_min * 0.999, contrast_min) < 0.5
    assert confidence(0.0, 0.05) == 0.0


def test_detection_at_the_threshold_of_its_own_image():
    image = street()
    contrast = visible_contrast(image, BOX)
    (seen,) = see(perception(contrast_min=contrast), image, row())
    assert seen.confidence == 0.5
    assert (seen.label, seen.x_px, seen.y_px, seen.width_px, seen.height_px) == (
        "car",
        60.0,
        40.0,
        40.0,
        30.0,
    )


def test_too_faint_to_report():
    image = veiled(street(), 0.9)
    contrast = visible_contrast(image, BOX)
    just_seen = min(contrast * (1 / CONFIDENCE_MIN - 1), 1.0)
    assert len(see(perception(contrast_min=just_seen * 0.999), image, row())) == 1
    assert see(perception(contrast_min=just_seen * 1.001), image, row()) == []


def test_visible_pixels_limit_is_inclusive():
    image = street()
    assert len(see(perception(pixels_min=24), image, row(visible_px=24))) == 1
    assert see(perception(pixels_min=24), image, row(visible_px=23)) == []


@pytest.mark.parametrize("noise_levels", [0.0, 4.0])
def test_contrast_falls_monotonically_under_a_veil(noise_levels):
    clear = street(noise_levels)
    contrasts = [visible_contrast(veiled(clear, share), BOX) for share in np.arange(0.0, 1.01, 0.1)]
    assert contrasts[0] > 0.2
    assert contrasts[-1] == 0.0
    assert all(a > b for a, b in itertools.pairwise(contrasts))


def test_contrast_falls_with_noise_and_with_darkness():
    by_noise = [visible_contrast(street(noise), BOX) for noise in (0.0, 10.0, 25.0, 50.0)]
    assert all(a > b for a, b in itertools.pairwise(by_noise))
    by_gain = [visible_contrast(street(2.0, gain=gain), BOX) for gain in (1.0, 0.3, 0.1, 0.03)]
    assert all(a > b for a, b in itertools.pairwise(by_gain))


def test_another_noise_seed_changes_confidence_a_little():
    one, two = (see(perception(), street(2.0, seed), row())[0].confidence for seed in (1, 2))
    assert one != two
    assert one == pytest.approx(two, abs=0.02)


def test_an_object_of_the_backgrounds_brightness_shows_by_its_texture():
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    assert visible_contrast(image, BOX) == 0.0
    image[BOX.top : BOX.bottom : 2, BOX.left : BOX.right] = 70
    image[BOX.top + 1 : BOX.bottom : 2, BOX.left : BOX.right] = 130
    assert visible_contrast(image, BOX) == pytest.approx(30.0 / 216.0)


@pytest.mark.parametrize("noise_levels", [2.0, 8.0])
def test_noise_alone_is_not_taken_for_texture(noise_levels):
    noise = noise_levels * np.random.default_rng(3).standard_normal((HEIGHT, WIDTH, 3))
    image = np.rint(120 + noise).astype(np.uint8)
    assert visible_contrast(image, BOX) < 0.005
    assert see(perception(), image, row()) == []


def test_large_boxes_are_sampled_by_rows_without_a_change_of_scale():
    scale = 6
    image = street()
    large = np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)
    box = Region(*(scale * edge for edge in BOX))
    assert (box.right - box.left) * (box.bottom - box.top) > PIXELS_MAX
    expected = visible_contrast(image, BOX)
    assert visible_contrast(large, box) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("top", [0, 1, 2, 3])
def test_one_row_across_the_widest_image_is_still_seen(top):
    image = np.full((20, 3840, 3), 120, np.uint8)
    image[top] = 20
    assert visible_contrast(image, Region(0, top, 3840, top + 1)) > 0.5


def test_black_on_white_and_white_on_black_stay_in_range():
    for inside, outside in ((255, 0), (0, 255)):
        image = np.full((HEIGHT, WIDTH, 3), outside, np.uint8)
        image[BOX.top : BOX.bottom, BOX.left : BOX.right] = inside
        assert 0.9 < visible_contrast(image, BOX) <= 1.0


def test_mirrored_and_reversed_pixels_give_the_same_bits():
    image = street(3.0)
    mirrored_box = Region(WIDTH - BOX.right, BOX.top, WIDTH - BOX.left, BOX.bottom)
    mirrored = np.ascontiguousarray(image[:, ::-1])
    assert visible_contrast(mirrored, mirrored_box) == visible_contrast(image, BOX)
    assert visible_contrast(image[:, ::-1], mirrored_box) == visible_contrast(image, BOX)


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 2), (2, 2), (3, 1)])
@pytest.mark.parametrize("corner", [(0, 0), (79, 44), (WIDTH - 1, HEIGHT - 1)])
def test_tiny_boxes(size, corner):
    image = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    box = np.array([[0, *corner, *size, 1.0, 90.0]], np.float32)
    assert see(perception(pixels_min=1), image, box) == []
    region = pixels_of(box[0].tolist(), WIDTH, HEIGHT)
    image[region.top : region.bottom, region.left : region.right] = 20
    (seen,) = see(perception(pixels_min=1), image, box)
    assert seen.confidence > 0.8


def test_a_box_that_fills_the_image_is_judged_by_its_texture():
    whole = Region(0, 0, WIDTH, HEIGHT)
    assert visible_contrast(np.full((HEIGHT, WIDTH, 3), 90, np.uint8), whole) == 0.0
    assert visible_contrast(street(), whole) > 0.05


def test_pixels_of_a_box():
    def of(x: float, y: float, width: float, height: float) -> Region | None:
        return pixels_of([0, x, y, width, height, 99, 9], WIDTH, HEIGHT)

    assert of(10.0, 20.0, 5.0, 6.0) == Region(10, 20, 15, 26)
    assert of(10.4, 20.6, 5.0, 6.0) == Region(10, 20, 16, 27)
    assert of(10.0, 20.0, 0.0, 0.0) == Region(10, 20, 11, 21)
    assert of(-5.0, -5.0, 500.0, 500.0) == Region(0, 0, WIDTH, HEIGHT)
    assert of(WIDTH, 10.0, 5.0, 5.0) is None
    assert of(-5.0, 10.0, 5.0, 5.0) is None


def test_order_is_by_content_not_by_row():
    image = street(2.0)
    boxes = np.concatenate([row(), row(Region(58, 40, 100, 70)), row(Region(60, 38, 100, 74), 1)])
    detections = see(perception(), image, boxes)
    assert len(detections) == 3
    assert detections == see(perception(), image, boxes[::-1])
    confidences = [detection.confidence for detection in detections]
    assert confidences == sorted(confidences, reverse=True)
    assert see(perception(), image, boxes[:0]) == []


def test_unknown_class_id():
    with pytest.raises(ValueError, match="class id 6, allowed: 0-5"):
        see(perception(), street(), row(class_id=6))


@pytest.mark.parametrize("column", range(7))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_box_that_is_not_finite_is_not_seen_and_does_not_raise(column, value):
    boxes = np.concatenate([row(), row()])
    boxes[0, column] = value
    assert len(see(perception(), street(), boxes)) == 1


def test_luma_is_exact():
    """For every share of the three colours, and their most."""
    levels = np.array([0, 1, 2, 127, 128, 254, 255], np.uint8)
    image = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, 49, 3)
    wanted = cv2.transform(image.astype(np.float64), np.array([LUMA_WEIGHTS], np.float64))
    luma = _luma(image)
    assert luma.dtype == np.uint16
    assert np.array_equal(luma, wanted)
    assert luma.max() == 255 * 256
    assert np.array_equal(_luma(image[::2, ::3]), wanted[::2, ::3])
