"""Reading the files of an AutoDRIVE study's logs, also out of archives.

Nothing is written, and names inside an archive are never used as paths. A file that cannot be read
does not stop the others.
"""

from __future__ import annotations

import gzip
import stat
import tarfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from schemas.escape import escape
from schemas.files.autodrive_log import LOG_BYTES_MAX, parse_log_name

ARCHIVE_SUFFIXES = (".tar.gz", ".tgz")
NAME_CHARS_MAX = 200
"""Longest name of a file in a message [characters]."""
NO_LOG = "not the name of a log"
_TWICE = "is there a second time; the first one counts"


@dataclass(frozen=True, slots=True)
class LogFile:
    """A file in a folder of logs: a log with its bytes, or why there are none."""

    name: str
    """Path in the folder, escaped; of a log always ``batch_N/aeb_metrics_sim_inst_M.csv``."""
    place: tuple[int, int] | None
    """Batch and instance, from 1; None: the file is no log of its own, by its name or because it is
    an archive or a repeat."""
    data: bytes
    """Content of the file; empty if it was not read."""
    refused: str = ""
    """Why it was not read, or what is wrong with it, on one line; empty: it was read."""
    batch: int = 0
    """Batch that a folder or an archive is named after if it could not be read to its end; else
    0."""


def read_log_files(folder: Path) -> Iterator[LogFile]:
    """Every file in the batches of ``folder``, by name: ``batch_N/*`` and in ``batch_N.tar.gz``.

    What is no log by its name, is too large, or cannot be read comes with the reason. A log that is
    there a second time, such as in a folder and in an archive, is refused if the first could be
    read. ``folder`` may itself be a batch.
    """
    known: set[tuple[int, int]] = set()
    for file in _all_files(folder):
        if file.place is None or file.refused:
            yield file
        elif file.place in known:
            yield replace(file, place=None, data=b"", refused=_TWICE)
        else:
            known.add(file.place)
            yield file


def _all_files(folder: Path) -> Iterator[LogFile]:
    itself = [folder.absolute()] if parse_batch(folder.absolute().name) else []
    for path in [*itself, *sorted(folder.glob("batch_*"))]:
        if path.is_dir():
            yield from _read_batch(path)
        elif path.name.endswith(ARCHIVE_SUFFIXES):
            yield from _read_archive(path)


def parse_batch(name: str) -> int:
    """Number of the batch by the name of its folder or archive; 0: it is none."""
    for suffix in ARCHIVE_SUFFIXES:
        name = name.removesuffix(suffix)
    place = parse_log_name(f"{name}/aeb_metrics_sim_inst_1.csv")
    return place[0] if place else 0


def _shown(name: str) -> str:
    return escape(name, NAME_CHARS_MAX)


def _read_batch(path: Path) -> Iterator[LogFile]:
    try:
        files = sorted(path.iterdir())
    except OSError as error:
        reason = error.strerror or str(error)
        yield LogFile(_shown(path.name), None, b"", reason, parse_batch(path.name))
        return
    for file in files:
        yield _read_file(file, f"{path.name}/{file.name}")


def _read_file(file: Path, name: str) -> LogFile:
    place = parse_log_name(name)
    if place is None:
        return LogFile(_shown(name), None, b"", NO_LOG)
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            return LogFile(name, place, b"", "not a file")
        if status.st_size > LOG_BYTES_MAX:
            return LogFile(name, place, b"", _too_large(status.st_size))
        with file.open("rb") as stream:
            return _bounded(name, place, stream)
    except OSError as error:
        return LogFile(name, place, b"", error.strerror or str(error))


def _bounded(name: str, place: tuple[int, int], stream: IO[bytes]) -> LogFile:
    data = stream.read(LOG_BYTES_MAX + 1)
    if len(data) > LOG_BYTES_MAX:  # it has grown, or its header lies
        return LogFile(name, place, b"", _too_large(len(data)))
    return LogFile(name, place, data)


def _too_large(size: int) -> str:
    return f"has at least {size} bytes, a log at most {LOG_BYTES_MAX}"


def _read_archive(path: Path) -> Iterator[LogFile]:
    try:
        with gzip.open(path) as whole, tarfile.open(fileobj=whole, mode="r:") as archive:
            for member in archive:
                if not member.isdir():
                    yield _read_member(path, archive, member)
            # A damaged header ends the members without a word, and what was read is known to be
            # what was packed when the checksum behind all of it has been seen.
            whole.seek(archive.offset)
            while block := whole.read(1 << 20):
                if block.count(0) < len(block):
                    raise tarfile.ReadError("a damaged header after the last file")
    except (tarfile.TarError, EOFError, OSError, zlib.error, ValueError) as error:
        why = escape(str(error)) or type(error).__name__
        reason = f"not read to its end, its logs may be damaged: {why}"
        yield LogFile(_shown(path.name), None, b"", reason, parse_batch(path.name))


def _read_member(path: Path, archive: tarfile.TarFile, member: tarfile.TarInfo) -> LogFile:
    name = member.name.removeprefix("./")
    place = parse_log_name(name)
    if place is None:
        return LogFile(_shown(f"{path.name}/{name}"), None, b"", NO_LOG)
    stream = archive.extractfile(member) if member.isfile() else None
    if stream is None:
        return LogFile(name, place, b"", "a link or a device in the archive, not a file")
    if member.size > LOG_BYTES_MAX:
        return LogFile(name, place, b"", _too_large(member.size))
    return _bounded(name, place, stream)
