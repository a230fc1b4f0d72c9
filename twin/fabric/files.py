"""Files that are complete or absent, whatever is killed while they are written."""

from __future__ import annotations

import os
import secrets
from pathlib import Path


def write_atomic(path: Path, data: bytes | bytearray | memoryview) -> None:
    """Write a file that is complete or absent, also after a power cut; its folder must exist.

    Raises:
        OSError: it cannot be written; what stood there before still stands.
    """
    # Random, because two hosts may write to one folder under the same pid.
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("wb") as file:
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
