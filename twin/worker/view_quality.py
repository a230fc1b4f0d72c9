"""How well pictures of a case are compressed: as well as their budget of bytes allows. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

QUALITY_MAX, QUALITY_MIN, QUALITY_STEP = 75, 40, 5
"""JPEG qualities."""

BYTES_PER_PIXEL = 0.1
"""Budget of a picture [bytes]: 24 kB at 640x360, so that 21 s at 20 Hz take 11 MB. At one quality
for all, snow takes three times as many bytes as fog."""

HEAD_BYTES = 1000
"""And so much more, for the tables in front [bytes]."""

ROOM = 0.75
"""Quality rises while pictures take less than this share of their budget [-]."""


@dataclass(slots=True)
class Quality:
    """The quality of a camera's next picture; follows from its pictures so far."""

    value: int = 60

    def took(self, nbytes: int, pixels: int) -> None:
        """A picture of so many pixels took so many bytes."""
        budget = HEAD_BYTES + BYTES_PER_PIXEL * pixels
        if nbytes > budget:
            self.value = max(QUALITY_MIN, self.value - QUALITY_STEP)
        elif nbytes < ROOM * budget:
            self.value = min(QUALITY_MAX, self.value + QUALITY_STEP)
