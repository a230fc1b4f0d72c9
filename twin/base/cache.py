"""The folder for what is fetched once and never changes."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from twin.base.errors import UsageError


def cache_folder() -> Path:
    """``TWIN_CACHE``, on a cluster a folder that all nodes share; else one in the home folder."""
    folder = os.environ.get("TWIN_CACHE", "")
    return Path(folder).absolute() if folder else Path.home() / ".cache/drivetwin"


def check_cache(cache: Path) -> None:
    """Refuse a cache in which somebody else may have put what is run or believed here; one that is
    not there yet is nobody's.

    Raises:
        UsageError: it, or a folder in it, is of another user or may be written by others; one line.
        OSError: it cannot be looked at.
    """
    for folder in (cache, *(cache / name for name in ("repositories", "images", "mirrors"))):
        _check(folder)
    for parent in cache.resolve().parents:
        status = parent.stat() if parent.exists() else None
        # Where everybody may rename, this folder is another one in a moment.
        if status and status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            raise UsageError(
                f"cache {cache}: everybody may write to {parent}; choose another with TWIN_CACHE"
            )


def is_trusted(cache: Path) -> bool:
    """Whether :func:`check_cache` has nothing against it."""
    try:
        check_cache(cache)
    except (UsageError, OSError):
        return False
    return True


def _check(folder: Path) -> None:
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return
    if stat.S_ISLNK(status.st_mode):
        status = folder.stat()
    if status.st_uid != os.geteuid():
        raise UsageError(
            f"cache {folder}: belongs to user id {status.st_uid}, you are {os.geteuid()}: what "
            "lies there would be run as you; choose a folder of your own with TWIN_CACHE"
        )
    if status.st_mode & 0o022:
        raise UsageError(
            f"cache {folder}: others may write to it (mode {stat.S_IMODE(status.st_mode):04o}): "
            f"what lies there would be run as you; if you trust it, `chmod -R go-w {folder}`"
        )
