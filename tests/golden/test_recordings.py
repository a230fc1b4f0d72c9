"""Recordings of every schema version there was still open, and say what they said.

`recording_N.rrd.gz` is a recording that the recorder of schema version N made of a case of chaos-16
by the simulator; it is never made anew. A new version adds a file and a line to `MADE`.
"""

import gzip
from pathlib import Path

import cv2
import numpy as np
import pytest

from schemas import SCHEMA_VERSION
from twin.base.gpu.vulkan import has_vulkan
from viewer.live.mosaic import decoded
from viewer.playback.drawing import drawn
from viewer.playback.folder import find_moment, find_recording
from viewer.playback.frames import read_case
from viewer.recording.scenery import RED

MADE = [1]
HERE = Path(__file__).parent

needs_vulkan = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)


@pytest.fixture(params=MADE)
def folder(request, tmp_path):
    """A campaign folder with the old recording, and without anything else."""
    attempt = tmp_path / "cases" / "old" / "attempt-1"
    attempt.mkdir(parents=True)
    packed = (HERE / f"recording_{request.param}.rrd.gz").read_bytes()
    assert len(packed) < 200_000
    (attempt / "recording.rrd").write_bytes(gzip.decompress(packed))
    return tmp_path


def test_the_present_version_is_kept():
    assert max(MADE) == SCHEMA_VERSION, "keep a recording of this version for its successors"


def test_an_old_recording_says_what_it_said(folder):
    found = find_recording(folder, "old")
    case = read_case(found.path)
    assert len(case.frames) == 36
    assert len(case.pictures) == 35
    assert case.properties["case"]["weather"] == "heavy_snow"
    assert case.properties["verdict"]["verdict"] == "collision"
    assert [event.level for event in case.events] == ["INFO", "WARN", "ERROR"]
    moment = find_moment(found, "aeb")
    assert moment.sim_time_ns == 900_000_000
    frame = case.picture_at(moment.sim_time_ns)
    assert (frame.speed_mps, frame.dtc_m) == pytest.approx((11.912, 9.240), abs=1e-3)
    assert (frame.aeb, frame.brake) == (True, 1.0)
    assert [mark.label for mark in frame.detections] == ["car 0.72", "car 0.76"]
    assert len(frame.truth) == 11
    assert decoded(frame.jpeg).shape == (36, 64, 3)
    assert (drawn(frame, frame) == np.array(RED[::-1], np.uint8)).all(axis=2).sum() > 500


@needs_vulkan
def test_an_old_recording_opens_in_the_viewer_without_warnings(folder, tmp_path):
    from viewer.playback.window import window

    found = find_recording(folder, "old")
    with window(["--window-size", "640x360", str(found.path)], headless=True) as shown:
        shown.show(find_moment(found, "aeb"))
        state = shown.client.get_state()
        assert len(state.views) == 7
        assert [report for view in state.views for report in view.reports] == []
        (recording,) = state.recordings
        assert recording.current_time == 900_000_000
        (tmp_path / "old.png").write_bytes(shown.client.take_screenshot())
    picture = cv2.imread(str(tmp_path / "old.png"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200
