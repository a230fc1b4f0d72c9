"""Recorded drives that others made, read by a process apart (:mod:`twin.world.apart`).

The process sees the recording alone. It answers plain arrays, which are checked by their types and
then by :func:`twin.drives.drive.drive_mistake`.
"""

from __future__ import annotations

import os
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec

from schemas.escape import escape
from schemas.files.regular_file import open_regular
from twin.base.errors import UsageError
from twin.drives.drive import DriveQuestion, RecordedDrive, drive_mistake
from twin.drives.recording import METADATA
from twin.world.apart.reading import AskedFile, read_apart, unprotected

FILE_BYTES_MAX = 64 << 30
"""Largest file of a recording [bytes]."""
FILES_MAX = 1_000
"""Most files of a rosbag2 folder."""
MEMORY_BYTES_MAX = 4 << 30
"""Address space of the process that reads one [bytes]."""
CPU_S = 600
"""Processor time that it may take [s]."""
WALL_S = 1_800
"""Time until it is given up, however busy the machine is [s]."""
ANSWER_BYTES_MAX = 256 << 20
"""What it may answer [bytes]."""

_PARSER = "twin.drives.reading:RECORDED_DRIVE"
_SUFFIXES = (".mcap", ".db3", ".zstd")


def drive_apart(path: Path, question: DriveQuestion) -> RecordedDrive:
    """The drive of a recording, read in a process apart.

    Args:
        path: an MCAP file, or a rosbag2 folder.
        question: what is looked for.

    Raises:
        UsageError: no recording, or one that cannot be used; one line.
        InfrastructureError: the process did not start.
    """
    first, others = _files(path)
    asked = AskedFile(_PARSER, first, others, msgspec.json.encode(question))
    answers = read_apart(
        [asked],
        cpu_s=CPU_S,
        wall_s=WALL_S,
        memory_bytes=MEMORY_BYTES_MAX,
        answer_bytes=ANSWER_BYTES_MAX,
    )
    try:
        with closing(answers):
            drive: RecordedDrive = next(answers)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if wrong := drive_mistake(drive):
        raise UsageError(f"{path}: cannot be read as a recorded drive: its reader answered {wrong}")
    return replace(
        drive,
        topics=[escape(text) for text in drive.topics],
        notes=[escape(text) for text in drive.notes],
    )


def _files(path: Path) -> tuple[Path, list[Path]]:
    """The file that is asked about, and further ones that belong to it."""
    others: list[Path] = []
    if path.is_dir():
        first = path / METADATA
        try:
            names = sorted(entry.name for entry in os.scandir(path))
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}") from None
        if METADATA not in names:
            raise UsageError(f"{path}: no {METADATA} in it; give an MCAP file or a rosbag2 folder")
        others = [path / name for name in names if name.endswith(_SUFFIXES)]
        if len(others) > FILES_MAX:
            raise UsageError(f"{path}: {len(others)} files, allowed: up to {FILES_MAX}")
    elif path.suffix == ".mcap":
        first = path
    else:
        raise UsageError(f"{path}: expected a file that ends in .mcap, or a rosbag2 folder")
    for file in (first, *others):
        try:
            open_regular(file, FILE_BYTES_MAX).close()
        except OSError as error:
            raise UsageError(f"{file}: {error.strerror}") from None
    return first, [Path(os.path.realpath(file.parent)) / file.name for file in others]


def note_of_reading() -> str:
    """A line if recordings are read without a sandbox on this machine; empty: with one."""
    words: str = unprotected("recordings")
    return words
