"""A picture as pixels, and recordings that hold none."""

import cv2
import numpy as np
import pytest
from unit.viewer.playback.test_viewer_folder import attempt

from twin.base.errors import UsageError
from viewer.playback.frames import PlayedTick, RecordedCase
from viewer.playback.pixels import pixels_at


def recorded(folder, data):
    """A recording that was read: one frame, with this for a JPEG."""
    path = attempt(folder) / "recording.rrd"
    return RecordedCase(path, "attempt", [PlayedTick(0, jpeg=data)])


def test_pixels_are_rgb(tmp_path):
    red = np.zeros((16, 32, 3), np.uint8)
    red[..., 2] = 255  # OpenCV's order
    known = recorded(tmp_path, cv2.imencode(".jpg", red)[1].tobytes())
    pixels, time_ns, again = pixels_at(tmp_path, "clear-1", "0.05", known=known)
    assert pixels.shape == (16, 32, 3)
    assert pixels[8, 16, 0] > 240
    assert pixels[8, 16, 2] < 20
    assert time_ns == 0
    assert again is known


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"no picture"])
def test_a_picture_that_is_none_is_one_line(tmp_path, data):
    known = recorded(tmp_path, data)
    with pytest.raises(UsageError, match=r"\.rrd: damaged: a picture that is none") as told:
        pixels_at(tmp_path, "clear-1", "0.05", known=known)
    assert "\n" not in str(told.value)
