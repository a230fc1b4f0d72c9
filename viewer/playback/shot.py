"""A picture of a recording at a moment, rendered without a window."""

from __future__ import annotations

import re
import time
from pathlib import Path

from twin.base.errors import InfrastructureError, UsageError
from twin.base.progress import counter
from viewer.playback.folder import RecordedMoment
from viewer.playback.outputs import write_whole
from viewer.playback.window import asked, window

SETTLE_S = 1.0
"""Time for pictures to be decoded after a jump in time [s]."""


def parse_size(text: str) -> tuple[int, int]:
    """``1280x720`` -> (1280, 720).

    Raises:
        UsageError: not of that form, or out of range.
    """
    match = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(64 <= edge <= 8192 for edge in size):
        raise UsageError(
            f"--size {text}: expected WIDTHxHEIGHT in pixels, 64 to 8192, e.g. 1280x720"
        )
    return size


def shoot(recording: Path, moment: RecordedMoment, out: Path, size: tuple[int, int]) -> None:
    """Render ``recording`` at ``moment`` into the PNG file ``out``.

    Raises:
        InfrastructureError: no Vulkan driver, or the viewer failed.
        UsageError: ``out`` cannot be written.
    """
    arguments = ["--window-size", f"{size[0]}x{size[1]}", str(recording)]
    more = counter("steps", 3)
    with window(arguments, headless=True) as shown:
        shown.show(moment)
        more(1)
        time.sleep(SETTLE_S)
        more(1)
        picture = asked(shown.client.take_screenshot)
    if not picture:
        raise InfrastructureError("viewer: it has rendered nothing")
    write_whole(out, picture)
    more(1)
