"""A recorded tick as a picture: the camera's pixels, boxes over them, a line of figures below."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from twin.base.errors import UsageError
from viewer.live.mosaic import decoded
from viewer.playback.frames import Mark, PlayedTick
from viewer.recording.scenery import CYAN, GREY, ORANGE, RED, YELLOW, Color

WIDTH_MIN_PX = 640
"""Smaller pictures are enlarged by a whole number, so that labels have room [px]."""
LINE_PX = 28
"""Height of the line below [px]."""

Area = tuple[int, int, int, int]
"""Left, top, right and bottom [px]."""

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_TEXT = 0.45
_WHITE: Color = (236, 238, 242)
_BACKGROUND: Color = (18, 20, 25)


def drawn(frame: PlayedTick, pixels_of: PlayedTick) -> np.ndarray:
    """``frame``'s boxes and figures on the picture of ``pixels_of``: BGR uint8 [H, W, 3].

    They differ where a tick has no picture of its own: the last one still stands then, and only
    the figures go on. Width and height are even, as video encoders want them.

    Raises:
        UsageError: the picture is damaged.
    """
    pixels = decoded(pixels_of.jpeg or b"")
    if pixels is None:
        seconds = pixels_of.sim_time_ns / 1e9
        raise UsageError(f"the picture at {seconds:g} s is damaged in this recording")
    scale = max(1, -(-WIDTH_MIN_PX // pixels.shape[1]))
    canvas = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    for mark in pixels_of.truth or []:
        _box(canvas, mark, scale, CYAN, 1)
    color = RED if pixels_of.aeb else ORANGE
    for mark in reversed(pixels_of.detections or []):  # the largest on top
        _box(canvas, mark, scale, color, 2)
    taken: list[Area] = []
    cause = pixels_of.trigger
    if cause is not None:
        _box(canvas, cause, scale, YELLOW, 5)
        _box(canvas, cause, scale, RED, 2)
        _label(canvas, cause, scale, YELLOW, taken, f"AEB: {cause.label}")
    for mark in pixels_of.detections or []:
        if mark != cause:
            _label(canvas, mark, scale, color, taken, mark.label)
    return _with_line(canvas, frame)


def figures(frame: PlayedTick) -> str:
    """The line below a picture; what was not recorded is a dash."""
    brake = "-" if frame.brake is None else f"{100 * frame.brake:.0f} %"
    return (
        f"{frame.sim_time_ns / 1e9:6.2f} s   speed {_number(frame.speed_mps)} m/s   "
        f"DTC {_number(frame.dtc_m)} m   brake {brake}"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _box(canvas: np.ndarray, mark: Mark, scale: int, color: Color, thickness: int) -> None:
    x, y = round(mark.x_px * scale), round(mark.y_px * scale)
    right = round((mark.x_px + mark.width_px) * scale)
    bottom = round((mark.y_px + mark.height_px) * scale)
    cv2.rectangle(canvas, (x, y), (right, bottom), color[::-1], thickness)


def _label(
    canvas: np.ndarray, mark: Mark, scale: int, color: Color, taken: list[Area], text: str
) -> None:
    """Above the box, inside the picture; left out where it would hide an earlier one."""
    if not text:
        return
    width, height = (edge + 6 for edge in _size(text))
    x = min(max(0, round(mark.x_px * scale) - 1), max(0, canvas.shape[1] - width))
    y = max(0, round(mark.y_px * scale) - height)
    area = (x, y, x + width, y + height)
    if any(_overlap(area, other) for other in taken):
        return
    taken.append(area)
    cv2.rectangle(canvas, area[:2], area[2:], color[::-1], cv2.FILLED)
    _write(canvas, text, x + 3, y + height - 3, _BACKGROUND)


def _overlap(a: Area, b: Area) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _with_line(picture: np.ndarray, frame: PlayedTick) -> np.ndarray:
    height, width = picture.shape[:2]
    shape = (height + LINE_PX + (height + LINE_PX) % 2, width + width % 2, 3)
    canvas = np.full(shape, _BACKGROUND[::-1], np.uint8)
    canvas[:height, :width] = picture
    base = height + LINE_PX // 2 + 5
    _write(canvas, figures(frame), 8, base, _WHITE)
    text = "AEB" if frame.aeb is not None else "AEB -"
    left = width - _size(text)[0] - 10
    if frame.aeb:
        cv2.rectangle(
            canvas, (left - 6, height + 4), (width - 4, height + LINE_PX - 4), RED[::-1], cv2.FILLED
        )
    _write(canvas, text, left, base, _WHITE if frame.aeb else GREY)
    return canvas


@cache
def _size(text: str) -> tuple[int, int]:
    (width, height), _ = cv2.getTextSize(text, _FONT, _TEXT, 1)
    return width, height


def _write(canvas: np.ndarray, text: str, x: int, y: int, color: Color) -> None:
    cv2.putText(canvas, text, (x, y), _FONT, _TEXT, color[::-1], 1, cv2.LINE_AA)
