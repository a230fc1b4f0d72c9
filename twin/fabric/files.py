"""Files that are complete or absent, whatever is killed while they are written."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from twin.fabric.errors import InfrastructureError


def write_atomic(path: Path, data: bytes | bytearray | memoryview, *, mode: int = 0o666) -> None:
    """Write a file that is complete or absent, also after a power cut; its folder must exist.

    Args:
        path: the file.
        data: its content.
        mode: who may read and write it, less the umask, from the first byte on.

    Raises:
        OSError: it cannot be written; what stood there before still stands.
    """
    # Random, because two hosts may write to one folder under the same pid.
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextlib.contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Nobody else writes to ``folder`` meanwhile; it is made if it is missing.

    Raises:
        InfrastructureError: somebody does.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InfrastructureError(
                f"{folder}: another process is writing to it; wait for it or give another folder"
            ) from None
        yield
    finally:
        os.close(descriptor)
