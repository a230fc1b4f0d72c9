"""A recorded tick as a picture: the camera's own pixels, boxes where they belong, figures below."""

import cv2
import numpy as np
import pytest
from unit.viewer.recorded_case import write

from twin.base.errors import UsageError
from twin.view.samples import jpeg
from viewer.playback.drawing import LINE_PX, drawn, figures
from viewer.playback.folder import RecordedMoment
from viewer.playback.frames import Mark, PlayedTick, read_case
from viewer.playback.still import write_still
from viewer.playback.strip import write_strip
from viewer.recording.scenery import CYAN, ORANGE, RED, YELLOW


def frame(width=64, height=36, shade=100, **values):
    """A tick with an even grey picture."""
    return PlayedTick(1_500_000_000, jpeg(np.full((height, width, 3), shade, np.uint8)), **values)


def colored(picture, color):
    """Rows and columns of a colour (RGB) in a BGR picture."""
    return np.argwhere((picture == np.array(color[::-1], np.uint8)).all(axis=2))


def test_pixels_stay_the_camera_s_own_enlarged_by_a_whole_number():
    picture = drawn(frame(), frame())
    assert picture.shape == (360 + LINE_PX, 640, 3)
    assert (np.abs(picture[:360].astype(int) - 100) <= 1).all()
    assert drawn(frame(801, 451), frame(801, 451)).shape == (480, 802, 3), "even for encoders"


def test_boxes_stand_where_they_were_seen():
    car = Mark(10.0, 12.0, 20.0, 8.0, "")
    picture = drawn(frame(), frame(detections=[car]))
    where = colored(picture, ORANGE)
    top, left = where.min(axis=0)
    bottom, right = where.max(axis=0)
    assert (top, left, bottom, right) == pytest.approx((120, 100, 200, 300), abs=2)
    assert len(colored(drawn(frame(), frame(detections=[car], aeb=True)), RED)) == len(where)
    thin = colored(drawn(frame(), frame(truth=[car])), CYAN)
    assert 0 < len(thin) < len(where) * 0.75


def test_the_box_that_triggered_is_told_from_the_others():
    cause, other = Mark(10.0, 12.0, 20.0, 8.0, "car 0.90"), Mark(40.0, 12.0, 20.0, 8.0, "bus 0.80")
    seen = {"detections": [other, cause], "aeb": True}
    plain = drawn(frame(), frame(**seen))
    assert len(colored(plain, YELLOW)) == 0, "nobody said which it was"
    marked = drawn(frame(), frame(**seen, trigger=cause))
    where = colored(marked, YELLOW)
    assert len(where) > 500
    assert where[:, 1].max() <= 310, "the other box is not marked"
    assert len(colored(marked[:118], YELLOW)) > 300, "a label above it"
    assert (marked[:, 380:] == plain[:, 380:]).all()


def test_a_label_never_hides_that_of_a_larger_box():
    large, small = Mark(10.0, 12.0, 20.0, 8.0, "car 0.90"), Mark(11.0, 12.5, 4.0, 4.0, "bus 0.10")
    alone = drawn(frame(), frame(detections=[large]))[:118]
    both = drawn(frame(), frame(detections=[large, small]))[:118]
    assert (both == alone).all()
    assert len(colored(alone, ORANGE)) > 300
    edge = Mark(60.0, 0.0, 4.0, 4.0, "traffic_sign 0.90")
    assert drawn(frame(), frame(detections=[edge])).shape == (388, 640, 3)


def test_the_line_below_says_what_was_recorded_and_dashes_what_was_not():
    known = PlayedTick(1_500_000_000, speed_mps=9.04, dtc_m=21.96, brake=0.5, aeb=True)
    assert " ".join(figures(known).split()) == "1.50 s speed 9.0 m/s DTC 22.0 m brake 50 %"
    assert " ".join(figures(PlayedTick(0)).split()) == "0.00 s speed - m/s DTC - m brake -"
    braking = drawn(known, frame())
    assert len(colored(braking[360:], RED)) > 200
    assert len(colored(drawn(frame(aeb=False), frame())[360:], RED)) == 0


def test_a_damaged_picture_is_one_line():
    with pytest.raises(UsageError, match=r"at 1\.5 s is damaged"):
        drawn(PlayedTick(0), PlayedTick(1_500_000_000, b"no jpeg"))


def test_a_still_is_of_the_picture_that_stood_then(tmp_path):
    case = read_case(write(tmp_path))
    out = tmp_path / "a.png"
    assert write_still(case, RecordedMoment(190_000_000, "x"), out) == 0.1
    picture = cv2.imread(str(out))
    assert abs(int(picture[350, 600, 0]) - 120) <= 1
    with pytest.raises(UsageError, match=r"the recording ends at 0\.25 s"):
        write_still(case, RecordedMoment(260_000_000, "x"), out)
    with pytest.raises(UsageError, match="Is a directory"):
        write_still(case, RecordedMoment(0, "x"), tmp_path)


def test_a_strip_holds_the_pictures_around_a_moment(tmp_path):
    case = read_case(write(tmp_path))
    out = tmp_path / "a.jpg"
    assert write_strip(case, RecordedMoment(100_000_000, "x"), 0.1, 3, out) == [-0.1, 0.0, 0.1]
    three = cv2.imread(str(out)).shape
    assert write_strip(case, RecordedMoment(100_000_000, "x"), 60.0, 3, out) == [0.0], (
        "the rest is outside"
    )
    assert write_strip(case, RecordedMoment(100_000_000, "x"), 60.0, 4, out) == [0.0], (
        "also of an even one"
    )
    one = cv2.imread(str(out)).shape
    assert one[0] == three[0]
    assert three[1] == 3 * one[1] + 2 * 4
    with pytest.raises(UsageError, match="Is a directory"):
        write_strip(case, RecordedMoment(0, "x"), 0.1, 1, tmp_path)
