"""The camera's picture of a recorded moment, with its boxes; needs no graphics driver."""

from __future__ import annotations

from pathlib import Path

import cv2

from twin.base.errors import UsageError
from viewer.playback.drawing import drawn
from viewer.playback.folder import RecordedMoment
from viewer.playback.frames import RecordedCase
from viewer.playback.outputs import write_whole


def write_still(case: RecordedCase, moment: RecordedMoment, out: Path) -> float:
    """Write the picture that stood at ``moment``; returns its time [s].

    Raises:
        UsageError: the recording ended before, holds no picture, or ``out`` cannot be written.
    """
    last_ns = case.frames[-1].sim_time_ns if case.frames else 0
    if moment.sim_time_ns > last_ns:
        raise UsageError(
            f"--at {moment.sim_time_ns / 1e9:g}: the recording ends at {last_ns / 1e9:g} s"
        )
    frame = case.picture_at(moment.sim_time_ns)
    _, data = cv2.imencode(".png", drawn(frame, frame))
    write_whole(out, bytes(data))
    return frame.sim_time_ns / 1e9
