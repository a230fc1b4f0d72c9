"""Pictures of a recorded case around a moment, side by side; needs no graphics driver."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.base.errors import UsageError
from twin.base.progress import steps
from viewer.playback.drawing import drawn
from viewer.playback.folder import RecordedMoment, find_moment, find_recording
from viewer.playback.frames import RecordedCase, read_case
from viewer.playback.outputs import write_whole

WIDTH_PX = 320
"""Width of one picture; smaller ones are not enlarged beyond it."""
_QUALITY = 80
_CAPTION_PX = 22
_GAP_PX = 4
_INK, _MARK, _PAPER = (230, 230, 230), (90, 190, 255), (24, 24, 24)
"""Colours of the strip, BGR."""

Picture = NDArray[np.uint8]


def write_strip(
    case: RecordedCase, moment: RecordedMoment, around_s: float, frames: int, out: Path
) -> list[float]:
    """Write ``frames`` pictures from ``around_s`` before ``moment`` to as long after it.

    Returns:
        Times of the pictures since the moment [s]; those outside the recording are left out, and
        without any other the one nearest to the moment is taken.

    Raises:
        UsageError: the recording holds no picture, or ``out`` cannot be written.
    """
    times_ns = [frame.sim_time_ns for frame in case.pictures]
    if not times_ns:
        raise UsageError(f"{case.path}: the recording holds no camera picture")
    offsets_s = np.linspace(-around_s, around_s, frames) if frames > 1 else np.zeros(1)

    def at(step: float) -> int:
        return moment.sim_time_ns + round(step * 1e9)

    inside = [s for s in offsets_s if abs(s) < 1e-9 or times_ns[0] <= at(float(s)) <= times_ns[-1]]
    tiles, taken = [], []
    for step in steps(
        "pictures", inside or [0.0]
    ):  # an even number has no picture of the moment itself
        at_ns = at(float(step))
        frame = case.picture_at(at_ns)
        tiles.append(_tile(drawn(frame, frame), frame.sim_time_ns, step))
        taken.append(float(step))
    gap = np.full((tiles[0].shape[0], _GAP_PX, 3), _PAPER, np.uint8)
    parts = [part for tile in tiles for part in (tile, gap)][:-1]
    _, data = cv2.imencode(".jpg", np.hstack(parts), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    write_whole(out, bytes(data))
    return taken


def answer_strips(
    folder: Path, asked: Iterable[str], around_s: float, frames: int
) -> Iterator[str]:
    """A line of JSON per line of JSON, see ``viewer strips``: loading what reads recordings takes
    five times as long as reading one."""
    for line in asked:
        request = json.loads(line)
        error = ""
        try:
            recording = find_recording(folder, request["case"])
            moment = find_moment(recording, request["at"])
            write_strip(read_case(recording.path), moment, around_s, frames, Path(request["out"]))
        except UsageError as refused:
            error = str(refused)
        yield json.dumps({"case": request["case"], "error": error})


def _tile(picture: Picture, sim_time_ns: int, step_s: float) -> Picture:
    """A picture with its time below; the moment itself is marked."""
    high, wide = picture.shape[:2]
    size = (WIDTH_PX, max(1, round(high * WIDTH_PX / wide)))
    way = cv2.INTER_AREA if wide > WIDTH_PX else cv2.INTER_LINEAR
    tile = np.full((size[1] + _CAPTION_PX, WIDTH_PX, 3), _PAPER, np.uint8)
    tile[: size[1]] = cv2.resize(picture, size, interpolation=way)
    here = abs(step_s) < 1e-9
    text = f"{sim_time_ns / 1e9:.2f} s" + ("" if here else f"  ({step_s:+.2g} s)")
    place = (6, size[1] + _CAPTION_PX - 7)
    ink = _MARK if here else _INK
    cv2.putText(tile, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, ink, 1, cv2.LINE_AA)
    if here:
        cv2.rectangle(tile, (0, 0), (WIDTH_PX - 1, size[1] - 1), _MARK, 2)
    return tile
