"""``conductor.json``: how workers and viewers find a conductor on a shared file system."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec

from twin.fabric.errors import UsageError

FILE_NAME = "conductor.json"
"""Name of the file in the state folder and in each campaign folder."""

POLL_S = 0.2
"""How often a conductor that is awaited is looked for [s]."""


class ConductorFile(msgspec.Struct, frozen=True):
    """Content of ``conductor.json``."""

    endpoint: str
    pid: int
    host: str
    epoch: int
    namespace: str
    version: str


def find_conductor(folder: Path, wait_s: float = 0.0) -> ConductorFile:
    """Read ``conductor.json`` of a state or campaign folder.

    Args:
        folder: state or campaign folder, perhaps on a shared file system.
        wait_s: how long a conductor that is just starting may take [s].

    Raises:
        UsageError: there is none, or it is damaged.
    """
    until_s = time.monotonic() + wait_s
    while not (folder / FILE_NAME).exists() and time.monotonic() < until_s:
        time.sleep(POLL_S)
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
