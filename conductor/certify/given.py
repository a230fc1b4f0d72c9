"""Files that the command line names."""

from __future__ import annotations

from pathlib import Path

from schemas.files.regular_file import read_regular
from twin.base.errors import UsageError


def read_given(path: Path, bytes_max: int, option: str = "") -> bytes:
    """The content of a regular file of at most ``bytes_max``; ``option``: that names it.

    Raises:
        UsageError: there is no such file; one line.
    """
    try:
        return read_regular(path, bytes_max)
    except OSError as error:
        shown = f"{option} {path}".lstrip()
        raise UsageError(f"{shown}: {error.strerror or error}") from None
