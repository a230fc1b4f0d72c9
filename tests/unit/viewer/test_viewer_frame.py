"""A picture of a recording: the right moment, the right boxes, and one line where there is none."""

import cv2
import numpy as np
import pytest
from view_messages import camera, controls, detection, end, start, state

from schemas.messages import Detection
from twin.fabric.errors import InfrastructureError, UsageError
from twin.worker.view_samples import jpeg
from viewer import naming
from viewer.convert import CYAN, ORANGE
from viewer.folder import Moment
from viewer.frame import Frame, Mark, draw, read_frame, write_frame
from viewer.recording import Recording

GREYS = (40, 90, 140)
"""Of the pictures at ticks 0, 2 and 4."""


def record(folder, *, close=True):
    """Pictures at every second tick; the car comes nearer from tick to tick."""
    recording = Recording(start(folder))
    seq = 1
    for tick in range(6):
        if tick % 2 == 0:
            picture = np.full((36, 64, 3), GREYS[tick // 2], np.uint8)
            recording.camera(camera(seq, tick), jpeg(picture))
            seq += 1
        found = [Detection("car", 0.87, 10.0 + tick, 6.0, 20.0, 8.0), detection(width_px=2.0)]
        seen = controls(detections=found if tick % 2 == 0 else ())
        recording.state(state(seq, tick, controls=seen))
        seq += 1
    if close:
        recording.close(end(seq))
    else:
        recording._stream.flush()
    return folder / naming.RECORDING_FILE


@pytest.mark.parametrize("close", [True, False])
@pytest.mark.parametrize(
    ("at_ns", "tick"), [(0, 0), (149_999_999, 2), (150_000_000, 2), (10**12, 4)]
)
def test_the_last_picture_before_the_moment_with_boxes_of_its_own_time(
    tmp_path, close, at_ns, tick
):
    path = record(tmp_path, close=close)
    frame = read_frame(path, Moment(at_ns, "a moment"))
    assert frame.sim_time_ns == tick * 50_000_000
    assert frame.image.shape == (36, 64, 3)
    assert abs(int(frame.image[18, 32, 0]) - GREYS[tick // 2]) <= 2
    assert frame.detections == [
        Mark(10.0 + tick, 6.0, 20.0, 8.0, "car 0.87"),
        Mark(10.0, 10.0, 2.0, 8.0, "car 0.90"),
    ]
    assert frame.truth == [Mark(10.0, 10.0, 20.0, 8.0, "car 21 m")]


def test_boxes_are_drawn_where_they_are_and_only_near_ones_are_labelled():
    image = np.full((90, 160, 3), 60, np.uint8)
    near, far = Mark(40.0, 40.0, 30.0, 20.0, "car 0.87"), Mark(100.0, 50.0, 4.0, 3.0, "car 0.20")
    drawn = draw(Frame(0, image, [near, far], [Mark(5.0, 70.0, 12.0, 10.0, "car 9 m")]))
    assert drawn.shape == (360, 640, 3)
    assert tuple(drawn[4 * 40, 4 * 55][::-1]) == ORANGE
    assert tuple(drawn[4 * 60 - 1, 4 * 55][::-1]) == ORANGE
    assert tuple(drawn[4 * 70, 4 * 10][::-1]) == CYAN
    assert tuple(drawn[4 * 50, 4 * 55]) == (60, 60, 60)
    # Above the near box stands its label; above the far one nothing.
    assert tuple(drawn[4 * 40 - 12, 4 * 40 + 1][::-1]) == ORANGE
    assert (drawn[4 * 50 - 14 : 4 * 50 - 3, 4 * 100 : 4 * 100 + 40] == 60).all()
    assert (image == 60).all()


def test_files_are_pictures(tmp_path):
    frame = Frame(0, np.full((36, 64, 3), 60, np.uint8), [], [])
    for name in ("a.png", "a.jpg"):
        write_frame(frame, tmp_path / name)
        assert cv2.imread(str(tmp_path / name)).shape == (360, 640, 3)
    (tmp_path / "b.png").mkdir()
    with pytest.raises(UsageError, match="Is a directory"):
        write_frame(frame, tmp_path / "b.png")


def test_what_is_not_there_is_one_line(tmp_path):
    recording = Recording(start(tmp_path / "late"))
    recording.camera(camera(1, 3), jpeg(np.zeros((36, 64, 3), np.uint8)))
    recording.close(end(2))
    path = tmp_path / "late" / naming.RECORDING_FILE
    with pytest.raises(UsageError, match=r"before 0\.1 s; the first one is at 0\.15"):
        read_frame(path, Moment(100_000_000, "0.1 s"))
    Recording(start(tmp_path / "none")).close(end(1))
    with pytest.raises(UsageError, match="it holds none"):
        read_frame(tmp_path / "none" / naming.RECORDING_FILE, Moment(0, "0 s"))
    for content in (b"", b"RRF2 not really", b"\0" * 4096):
        bad = tmp_path / "bad.rrd"
        bad.write_bytes(content)
        with pytest.raises(InfrastructureError, match=r"bad\.rrd") as caught:
            read_frame(bad, Moment(0, "0 s"))
        assert "\n" not in str(caught.value)
