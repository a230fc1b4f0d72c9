"""The camera's picture of a moment out of a recording, with the boxes of the stack and the truth.

The pixels are those that the stack was given, but for the recording's JPEG. Neither a GPU nor a
Vulkan driver is needed.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from twin.fabric.errors import InfrastructureError, UsageError
from viewer import naming
from viewer.convert import CYAN, LABEL_SHARE, ORANGE, Color
from viewer.folder import Moment

WIDTH_MIN_PX = 640
"""Smaller pictures are enlarged by a whole number, so that labels have room [px]."""

_LABEL_PX = 14
_INK = (20, 22, 26)


@dataclass(frozen=True, slots=True)
class Mark:
    """A box in pixels of the camera."""

    x_px: float
    y_px: float
    width_px: float
    height_px: float
    label: str
    """``car 0.87`` of a detection, ``car 31 m`` of the truth."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture of the camera and what belongs to it."""

    sim_time_ns: int
    image: np.ndarray
    """BGR uint8 [H, W, 3]."""
    detections: list[Mark]
    truth: list[Mark]


@dataclass(slots=True)
class _Track:
    """Rows of one entity: where each time is to be found."""

    rows: dict[int, tuple[Any, int]] = field(default_factory=dict)


def read_frame(recording: Path, moment: Moment) -> Frame:
    """The last picture at or before ``moment``, with the boxes of its own time.

    Raises:
        UsageError: the recording has no picture so early; one line.
        InfrastructureError: it cannot be read.
    """
    wanted = {f"/{name}": _Track() for name in (naming.CAMERA, naming.TRUTH, *_DETECTIONS)}
    try:
        with warnings.catch_warnings():
            # The file of a recorder that was killed has no footer; what is there is read.
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(recording)
            for chunk in reader.stream(store=reader.recordings()[0]):
                track = wanted.get(str(chunk.entity_path))
                if track is not None and not chunk.is_static:
                    _collect(track, chunk.to_record_batch())
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InfrastructureError(f"{recording}: cannot be read as a recording: {line}") from None
    pictures = wanted[f"/{naming.CAMERA}"].rows
    early = [time for time in pictures if time <= moment.sim_time_ns]
    if not early:
        first = f"the first one is at {min(pictures) / 1e9:.2f} s" if pictures else "it holds none"
        raise UsageError(f"{recording}: no picture at or before {moment.label}; {first}")
    time = max(early)
    detections = [mark for name in _DETECTIONS for mark in _marks(wanted[f"/{name}"], time)]
    truth = _marks(wanted[f"/{naming.TRUTH}"], time)
    return Frame(time, _decoded(*pictures[time], recording), detections, truth)


_DETECTIONS = (naming.DETECTIONS, naming.DETECTIONS_FAR)


def _collect(track: _Track, batch: Any) -> None:
    times = batch.column(naming.SIM_TIME).cast("int64").to_pylist()
    for row, time in enumerate(times):
        track.rows[time] = batch, row


def _decoded(batch: Any, row: int, recording: Path) -> np.ndarray:
    blob = batch.column("EncodedImage:blob")[row].values[0].values.to_numpy(zero_copy_only=False)
    image = cv2.imdecode(blob.astype(np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InfrastructureError(f"{recording}: a picture in it is damaged")
    return image


def _marks(track: _Track, time: int) -> list[Mark]:
    """Boxes of the row at ``time``; none: nothing was logged then."""
    if time not in track.rows:
        return []
    batch, row = track.rows[time]
    names = ("Boxes2D:centers", "Boxes2D:half_sizes", "Boxes2D:labels")
    columns = [batch.column(name)[row].as_py() or [] for name in names]
    return [
        Mark(x - half_x, y - half_y, 2 * half_x, 2 * half_y, label)
        for (x, y), (half_x, half_y), label in zip(*columns, strict=True)
    ]


def draw(frame: Frame) -> np.ndarray:
    """The picture with the truth in thin cyan and detections in orange, BGR uint8.

    The stack's boxes carry label and confidence, those of the truth nothing.
    """
    scale = max(1, -(-WIDTH_MIN_PX // frame.image.shape[1]))
    picture = cv2.resize(
        frame.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST
    ).copy()
    for mark in frame.truth:
        _box(picture, mark, scale, CYAN, 1)
    # The largest last: its label is the one that matters.
    order = sorted(frame.detections, key=lambda mark: mark.width_px * mark.height_px)
    for mark in order:
        _box(picture, mark, scale, ORANGE, 2)
    for mark in order:
        if mark.width_px >= LABEL_SHARE * frame.image.shape[1] or len(order) == 1:
            _label(picture, mark, scale)
    return picture


def _box(picture: np.ndarray, mark: Mark, scale: int, color: Color, thickness: int) -> None:
    x, y = round(mark.x_px * scale), round(mark.y_px * scale)
    end = (
        round((mark.x_px + mark.width_px) * scale) - 1,
        round((mark.y_px + mark.height_px) * scale) - 1,
    )
    cv2.rectangle(picture, (x, y), end, color[::-1], thickness)


def _label(picture: np.ndarray, mark: Mark, scale: int) -> None:
    (width, _), _ = cv2.getTextSize(mark.label, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)
    x = min(max(0, round(mark.x_px * scale) - 1), max(0, picture.shape[1] - width - 6))
    y = max(0, round(mark.y_px * scale) - _LABEL_PX)
    cv2.rectangle(picture, (x, y), (x + width + 5, y + _LABEL_PX - 1), ORANGE[::-1], -1)
    place = (x + 3, y + _LABEL_PX - 4)
    cv2.putText(picture, mark.label, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK, 1, cv2.LINE_AA)


def write_frame(frame: Frame, out: Path) -> None:
    """Write the drawn picture to ``out``, .png or .jpg.

    Raises:
        UsageError: it cannot be written.
    """
    done, data = cv2.imencode(out.suffix.lower(), draw(frame))
    assert done, "the picture could not be encoded"
    try:
        out.write_bytes(data.tobytes())
    except OSError as error:
        raise UsageError(f"--out {out}: {error.strerror}") from None
