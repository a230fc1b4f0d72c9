"""How well pictures of a case are compressed: as well as their budget of bytes allows. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

QUALITY_MAX, QUALITY_MIN, QUALITY_STEP = 75, 25, 5
"""JPEG qualities."""

HEAD_BYTES, BYTES_PER_PIXEL = 8000, 0.05
"""Budget of a picture [bytes]: 11 kB at 320x180, where a pixel shows more, 20 kB at 640x360, so
that the 530 of an AEB case take less than 12 MB with all else. Most is the camera's noise: at one
quality for all, a snowy day takes five times as many bytes as fog (58 and 12 kB at 80)."""

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
