"""What simulators show, and to whom; a word of the command line and of the campaign file."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from msgspec import Struct

View = Literal["none", "live", "record", "record+live"]
"""View mode as files say it."""

Keep = Literal["all", "failed", "none"]

RECORDER = "recorder"
"""What a worker lacks that cannot write recordings."""


class Recording(Struct, frozen=True, forbid_unknown_fields=True):
    """What is recorded of attempts, and kept."""

    keep: Keep = "all"
    """Where `view` says that there are recordings. ``failed``: the recording of an attempt is
    removed at its end if its verdict is ``pass``. ``none``: nothing is recorded."""
    drive: Keep = "none"
    """What the stack saw and answered, without loss, whatever `view` says: `devkit replay` gives it
    to a stack again. ``failed``: removed at the end if the verdict is ``pass``."""


class ViewMode(StrEnum):
    """What simulators show, and to whom; no result depends on it."""

    none = "none"
    """Nothing."""
    live = "live"
    """Thumbnails and single cases, while a viewer subscribes."""
    record = "record"
    """Everything, to a recorder process beside the simulator; one file per attempt."""
    record_live = "record+live"

    @property
    def records(self) -> bool:
        """A recorder runs beside each simulator."""
        return self in (ViewMode.record, ViewMode.record_live)

    @property
    def unrecorded(self) -> ViewMode:
        """The mode of viewing without a recorder."""
        return ViewMode.live if self.shows else ViewMode.none

    @property
    def shows(self) -> bool:
        """Viewers may look through the conductor's router."""
        return self in (ViewMode.live, ViewMode.record_live)
