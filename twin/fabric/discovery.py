"""``conductor.json``: how workers and viewers find a conductor on a shared file system."""

from __future__ import annotations

from pathlib import Path

import msgspec

from twin.fabric.errors import UsageError

FILE_NAME = "conductor.json"
"""Name of the file in the state folder and in each campaign folder."""


class ConductorFile(msgspec.Struct, frozen=True):
    """Content of ``conductor.json``."""

    endpoint: str
    pid: int
    host: str
    epoch: int
    namespace: str
    version: str


def find_conductor(folder: Path) -> ConductorFile:
    """Read ``conductor.json`` of a state or campaign folder.

    Raises:
        UsageError: there is none, or it is damaged.
    """
    path = folder / FILE_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=ConductorFile)
    except FileNotFoundError:
        raise UsageError(
            f"{path}: no conductor serves this folder; start one with "
            f"`conductor serve --state {folder}`"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
