"""Rigs for stacks on other hosts: what ``--join-dir`` says of them, and who removes it.

A rig's files go with the rig. A worker that was killed leaves its own: the next one on that host
that gets the same folder removes them. Those of other hosts are left alone, since nobody here knows
who lives there.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
from pathlib import Path

import msgspec

from schemas.files.json_text import JsonError, decode_json
from twin.base.files import write_atomic
from twin.fabric.keys.rig_keys import RigKeys

OWNER = ".owner"


class RigOwner(msgspec.Struct, frozen=True):
    """Content of ``.RIG.owner``: the worker whose rig it is, as nobody after it will be."""

    host: str
    pid: int
    born_ticks: int
    """Start of the process, since the host's [clock ticks]: numbers of processes come again."""


def me() -> RigOwner:
    """The worker that this process is."""
    return RigOwner(_host(), os.getpid(), born_ticks(os.getpid()))


class Announcement:
    """One rig's files: ``.RIG.owner``, ``RIG.key`` if it speaks TLS, ``RIG.json``."""

    def __init__(self, folder: Path, rig: str) -> None:
        self._folder = folder
        self._rig = rig

    def write(self, arguments: list[str], keys: RigKeys | None) -> None:
        """Tell of the rig: what ``devkit host`` is started with, and the stack's key.

        Raises:
            OSError: it cannot be written.
        """
        # What is announced is started: nobody else may write there.
        self._folder.mkdir(0o700, parents=True, exist_ok=True)
        # In this order: whoever sees one of them needs those before it.
        write_atomic(self._folder / f".{self._rig}{OWNER}", msgspec.json.encode(me()))
        if keys is not None:
            keys.hand_over(self._folder / f"{self._rig}.key")
        data = json.dumps({"arguments": arguments}).encode()
        write_atomic(self._folder / f"{self._rig}.json", data, mode=0o600)

    def remove(self) -> None:
        """The rig has ended."""
        _remove(self._folder, self._rig)


def sweep(folder: Path) -> list[str]:
    """Remove what workers of this host left behind that are dead; the rigs that were removed."""
    gone = []
    for path in sorted(folder.glob(f".*{OWNER}")):
        try:
            owner = decode_json(path.read_bytes(), RigOwner)
        except (OSError, JsonError):
            continue  # its worker removes it just now, or it is none of ours
        rig = path.name.removesuffix(OWNER).removeprefix(".")
        dead = owner.host == _host() and born_ticks(owner.pid) != owner.born_ticks
        if dead and rig.isalnum():  # whatever somebody else has put there
            _remove(folder, rig)
            gone.append(rig)
    return gone


def born_ticks(pid: int) -> int:
    """Start of a process, since the host's; 0: there is none, or it is dead [clock ticks].

    Not psutil's time of day, which a step of the wall clock changes.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return 0
    return 0 if fields[0] in ("Z", "X") else int(fields[19])


def _remove(folder: Path, rig: str) -> None:
    """All that begins with the rig's name, the owner's note last; half-written files as well."""
    paths = [*folder.glob(f"{rig}.*"), *folder.glob(f".{rig}.*")]
    for path in sorted(paths, key=lambda path: path.name.endswith(OWNER)):
        with contextlib.suppress(OSError):
            path.unlink()


def _host() -> str:
    """Name of the host and its process numbers, which in a container are others."""
    return f"{socket.gethostname()} {Path('/proc/self/ns/pid').readlink()}"
