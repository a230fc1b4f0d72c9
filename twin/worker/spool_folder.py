"""The spool on disk: a file for each result that the conductor has not got yet."""

from __future__ import annotations

import contextlib
from pathlib import Path

from twin.base.files import write_atomic


class SpoolFolder:
    """Several workers may share one folder: a result delivered twice is settled once."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def read(self) -> list[bytes]:
        """Contents of all files; none without a folder."""
        if self._folder is None:
            return []
        contents = []
        for path in sorted(self._folder.glob("*.result")):
            with contextlib.suppress(OSError):  # another worker delivered it meanwhile
                contents.append(path.read_bytes())
        return contents

    def write(self, token: int, data: bytes) -> None:
        """Keep ``data``, complete or not at all.

        Raises:
            OSError: it cannot be written; the result is still in memory.
        """
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        write_atomic(self._path(token), data)

    def forget(self, token: int) -> None:
        """The result is settled; an empty folder goes too."""
        if self._folder is None:
            return
        with contextlib.suppress(OSError):
            self._path(token).unlink(missing_ok=True)
            self._folder.rmdir()  # fails while it holds others

    def _path(self, token: int) -> Path:
        assert self._folder is not None
        return self._folder / f"{token}.result"
