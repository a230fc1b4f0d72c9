"""How well pictures of a case are compressed: as well as their budget of bytes allows. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

QUALITY_MAX, QUALITY_MIN, QUALITY_STEP = 75, 25, 5
"""JPEG qualities."""

BYTES_PER_PIXEL = 0.08
"""Budget of a picture [bytes]: 19 kB at 640x360, so that the 530 of an AEB case take less than
12 MB with all else. Most of it is the camera's noise: at one quality for all, a snowy day takes
five times as many bytes as fog (58 and 12 kB at 80)."""

HEAD_BYTES = 1000
"""And so much more, for the tables in front [bytes]."""

ROOM = 0.75
"""Quality rises while pictures take less than this share of their budget [-]."""


@dataclass(slots=True)
class Quality:
    """The quality of a camera's next picture; follows from its pictures so far."""

    value: int = 50

    def took(self, nbytes: int, pixels: int) -> None:
        """A picture of so many pixels took so many bytes."""
        budget = HEAD_BYTES + BYTES_PER_PIXEL * pixels
        if nbytes > budget:
            self.value = max(QUALITY_MIN, self.value - QUALITY_STEP)
        elif nbytes < ROOM * budget:
            self.value = min(QUALITY_MAX, self.value + QUALITY_STEP)
