"""What names a state folder in its result store."""

from __future__ import annotations

import re
import secrets
from pathlib import Path

from schemas.files.regular_file import read_regular
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic

_FILE = "store.id"


def folder_id(folder: Path, option: str) -> str:
    """32 hexadecimal digits: the same from each host that sees the folder, others when it is
    removed and used again. They are in a file of it, which is made here if there is none.

    Args:
        folder: of the conductor; created if missing.
        option: by which another folder is given, for the line that asks for one.

    Raises:
        InfrastructureError: the folder cannot be read or written.
        UsageError: the file is damaged.
    """
    path = folder / _FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            write_atomic(path, secrets.token_hex(16).encode() + b"\n")
        text = read_regular(path, 64).decode("ascii", "replace").strip()
    except OSError as error:
        raise storage_error(error, str(path)) from None
    if not re.fullmatch(r"[0-9a-f]{32}", text):
        raise UsageError(f"{path}: damaged; remove it and give an empty {option} folder")
    return text
