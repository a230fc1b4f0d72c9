"""``conductor.json``: how workers and viewers find a conductor on a shared file system."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import msgspec

from twin.fabric.errors import UnreachableError, UsageError

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


def await_conductor(folder: Path, wait_s: float) -> ConductorFile:
    """Like :func:`find_conductor`, but a conductor that is just starting may take ``wait_s`` [s].

    A file of a conductor that was killed is left behind, so the endpoint must answer.

    Raises:
        UsageError: there is no file, or it is damaged.
        UnreachableError: nobody answers at its endpoint.
    """
    until_s = time.monotonic() + wait_s
    while True:
        try:
            found = find_conductor(folder)
            probe(found.endpoint)
            return found
        except (UsageError, UnreachableError):
            if time.monotonic() >= until_s:
                raise
            time.sleep(POLL_S)


def probe(endpoint: str, timeout_s: float = 2.0) -> None:
    """Raise UnreachableError unless something accepts connections at ``tcp/HOST:PORT``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout_s).close()
    except OSError as error:
        raise UnreachableError(
            f"{endpoint}: no conductor answers ({error}); start it again, "
            "or remove the stale conductor.json"
        ) from None


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
