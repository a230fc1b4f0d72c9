"""Files that somebody named: opened only if they are regular files, read only up to a bound.

A path out of a campaign may name a device that never ends, or a pipe that nobody writes to. The
type is looked at before it is opened, and again on what was opened.
"""

from __future__ import annotations

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

RUN_FILE_BYTES_MAX = 1 << 30
"""Largest file of a run's folder that is read as a whole [bytes]."""

_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def open_regular(path: Path, most: int | None = None) -> BufferedReader:
    """A regular file, open for reading.

    Args:
        path: the file; links to it are followed.
        most: its largest size [bytes]; None: any.

    Raises:
        OSError: it is no regular file, or larger, or cannot be opened; ``strerror`` says which.
    """
    _check(path, path.stat(), most)
    # O_NONBLOCK: what took its place since must not hold us up.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        _check(path, os.fstat(descriptor), most)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, most: int) -> bytes:
    """The content of a regular file of at most ``most`` bytes.

    Raises:
        OSError: as :func:`open_regular`; also if it grows meanwhile.
    """
    with open_regular(path, most) as file:
        data = file.read(most + 1)
    if len(data) > most:  # it grows, or lies in a file system that tells no sizes
        raise OSError(errno.EFBIG, f"more than {most} bytes, at most {most} are read", str(path))
    return data


def _check(path: Path, found: os.stat_result, most: int | None) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        kind = next((words for is_kind, words in _KINDS if is_kind(found.st_mode)), "no file")
        raise OSError(errno.EINVAL, f"{kind}; a regular file is needed", str(path))
    if most is not None and found.st_size > most:
        raise OSError(errno.EFBIG, f"{found.st_size} bytes, at most {most} are read", str(path))
