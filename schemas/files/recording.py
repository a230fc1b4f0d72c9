"""Files of a recorded attempt, and what is known of a recording that lies in a result store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from schemas.files.regular_file import open_below

RECORDING_FILE = "recording.rrd"
RECORDING_NOTE = "recording.json"
"""Says whether the recording beside it is complete; absent: it is not."""

RECORDING_BYTES_MAX = 1 << 28
"""Largest recording that is put into a result store, or fetched from one [bytes]."""
NOTE_BYTES_MAX = 4096
"""Largest note beside a recording that is read [bytes]."""


class RecordingNote(Struct, frozen=True):
    """Content of the note, as far as others than the viewer read it."""

    complete: bool
    kept: bool = True
    """Whether the recording was kept; the campaign may ask for those of failed cases alone."""
    sha256: str = ""
    """Digest of the recording; empty: it was not kept."""


class RecordingObject(Struct, frozen=True, gc=False):
    """A recording in a result store, where its digest names it."""

    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
    size: Annotated[int, Meta(ge=1, le=RECORDING_BYTES_MAX)]
    """Length [bytes]."""
    complete: bool
    """Whether no message is missing in it."""


def note_in(folder: Path) -> RecordingNote | None:
    """What the recorder says of its file in ``folder``; None: it is at work, or was killed."""
    try:
        with open_below(folder, RECORDING_NOTE) as file:
            return msgspec.json.decode(file.read(NOTE_BYTES_MAX), type=RecordingNote)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None


def size_in(folder: Path) -> int:
    """What the recording in ``folder`` takes now, finished or not [bytes]."""
    try:
        return (folder / RECORDING_FILE).lstat().st_size
    except OSError:
        return 0
