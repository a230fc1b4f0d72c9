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

_CHUNK_BYTES = 1 << 16

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
        # Python sets aside as much as it is asked to read.
        data = file.read(os.fstat(file.fileno()).st_size)
        while len(data) <= most and (more := file.read(_CHUNK_BYTES)):
            data += more
    if len(data) > most:  # it grows, or lies in a file system that tells no sizes
        raise OSError(errno.EFBIG, f"more than {most} bytes, at most {most} are read", str(path))
    return data


def open_below(folder: Path, name: str) -> BufferedReader:
    """A regular file below ``folder`` that belongs to the folder's owner; no link leads there.

    For files of a run's folder that are shown to others: a link, or a file that somebody else put
    there, may stand for any file that we may read.

    Args:
        folder: where it lies; links to the folder itself are followed.
        name: its path from there.

    Raises:
        OSError: there is none, or it is a link, of another owner or no regular file; ``strerror``
            says which.
    """
    *parents, last = Path(name).parts
    if any(part in ("/", "..") for part in (*parents, last)):
        raise OSError(errno.EINVAL, "not below its folder", str(folder / name))
    at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        owner = os.fstat(at).st_uid
        for part in parents:
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
            inner = os.open(part, flags, dir_fd=at)
            os.close(at)
            at = inner
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(last, flags, dir_fd=at)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENOTDIR):
            words = "a symbolic link stands there or on the way"
            raise OSError(error.errno, words, str(folder / name)) from None
        raise OSError(error.errno, error.strerror, str(folder / name)) from None
    finally:
        os.close(at)
    try:
        status = os.fstat(descriptor)
        _check(folder / name, status, None)
        if status.st_uid != owner:
            words = f"belongs to user id {status.st_uid}, its folder to {owner}"
            raise OSError(errno.EPERM, words, str(folder / name))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def _check(path: Path, status: os.stat_result, most: int | None) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        kind = next((words for is_kind, words in _KINDS if is_kind(status.st_mode)), "no file")
        raise OSError(errno.EINVAL, f"{kind}; a regular file is needed", str(path))
    if most is not None and status.st_size > most:
        raise OSError(errno.EFBIG, f"{status.st_size} bytes, at most {most} are read", str(path))
