"""A folder as result store."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path, PurePosixPath

from schemas.files.regular_file import read_regular
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.stores.protocol import (
    SMALL_BYTES_MAX,
    DamagedObjectError,
    MissingObjectError,
    StoreError,
)


def open_folder(url: str) -> FolderStore:
    """The store in the folder ``url``, a path or ``file://`` and one; made if it is missing.

    Raises:
        TwinError: it cannot be made.
    """
    path = Path(url.removeprefix("file://")).absolute()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return FolderStore(path)


class FolderStore:
    """See :class:`twin.stores.protocol.ResultStore`."""

    def __init__(self, folder: Path) -> None:
        self.url = str(folder)
        self._folder = folder

    def put(self, name: str, data: bytes) -> None:
        """See the protocol."""
        path = self._path(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, data)
        except OSError as error:
            raise _failed(error, path) from None

    def create(self, name: str, data: bytes) -> bool:
        """See the protocol; a hard link has one winner, also on network file systems."""
        path = self._path(name)
        new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(new, data)
            try:
                os.link(new, path)
            except FileExistsError:
                return self.get(name) == data
            finally:
                new.unlink()
        except OSError as error:
            raise _failed(error, path) from None
        return True

    def get(self, name: str, size_max: int = SMALL_BYTES_MAX) -> bytes:
        """See the protocol."""
        path = self._path(name)
        try:
            if path.stat().st_size > size_max:
                raise DamagedObjectError(f"{path}: more than {size_max} bytes")
            return read_regular(path, size_max)
        except (FileNotFoundError, NotADirectoryError):
            raise MissingObjectError(f"{path}: is not there") from None
        except OSError as error:
            raise _failed(error, path) from None

    def names(self, prefix: str) -> list[str]:
        """See the protocol."""
        names = []
        for folder, _, files in os.walk(self._path(prefix)):
            below = Path(folder).relative_to(self._folder)
            names += [str(PurePosixPath(below) / file) for file in files if file[0] != "."]
        return sorted(names)

    def delete(self, name: str) -> None:
        """See the protocol."""
        with contextlib.suppress(OSError):
            self._path(name).unlink(missing_ok=True)

    def _path(self, name: str) -> Path:
        return self._folder / name


def _failed(error: OSError, path: Path) -> StoreError:
    return StoreError(f"{path}: {error.strerror or error}; check the folder of the store")
