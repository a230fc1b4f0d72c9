"""Pictures of a case keep to their budget of bytes."""

import cv2
import numpy as np
import pytest

from twin.view.quality import (
    BYTES_PER_PIXEL,
    HEAD_BYTES,
    QUALITY_MAX,
    QUALITY_MIN,
    QUALITY_STEP,
    ROOM,
    Quality,
)

PIXELS = 640 * 360
BUDGET = HEAD_BYTES + BYTES_PER_PIXEL * PIXELS


@pytest.mark.parametrize(
    ("nbytes", "step"),
    [
        (BUDGET, 0),
        (BUDGET + 1, -QUALITY_STEP),
        (ROOM * BUDGET, 0),
        (ROOM * BUDGET - 1, QUALITY_STEP),
    ],
)
def test_exactly_at_its_limits(nbytes, step):
    quality = Quality(60)
    quality.took(nbytes, PIXELS)
    assert quality.value == 60 + step


def test_it_ends_where_it_ends():
    quality = Quality()
    for _ in range(20):
        quality.took(10 * BUDGET, PIXELS)
    assert quality.value == QUALITY_MIN
    for _ in range(20):
        quality.took(0, PIXELS)
    assert quality.value == QUALITY_MAX


def test_noise_is_compressed_until_it_fits_and_stays_there():
    rng = np.random.default_rng(0)
    smooth = cv2.resize(rng.integers(0, 255, (24, 40, 3)).astype(np.uint8), (640, 360))
    quality, sizes, values = Quality(), [], []
    for _ in range(30):
        noisy = cv2.add(smooth, rng.integers(0, 22, smooth.shape).astype(np.uint8))
        _, data = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, quality.value])
        values.append(quality.value)
        sizes.append(len(data))
        quality.took(len(data), PIXELS)
    assert sizes[0] > BUDGET, "or there is nothing to see here"
    assert max(sizes[10:]) <= BUDGET
    assert len(set(values[10:])) == 1
