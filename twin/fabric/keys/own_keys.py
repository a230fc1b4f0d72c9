"""Keys that this user's conductors made, in the user's own folder.

Keys lie here and not beside the runs: a run's folder is seen by stacks and containers. The home
folder is the same on all nodes of a cluster, which a runtime folder (``XDG_RUNTIME_DIR``) is not,
so whoever is told a state folder finds its keys on every node, and nobody types them.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import socket
import stat
from pathlib import Path

import msgspec

from schemas.files.json_text import JsonError, decode_json
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.own_folder import VARIABLE, own_folder
from twin.fabric.keys.key_file import UnfitKeyError

KEYS_NAME = "keys"
"""The folder in it that has a folder for each fabric."""

MADE_FOR = "made-for.json"
"""Beside a fabric's keys: for which state folder they were made."""

SWEPT_MAX = 16
"""Number of other fabrics that are looked at when one is made: keys of runs that were removed go
in time, and nobody waits for it."""

_NAME = re.compile(r"[0-9a-f]{16}")


class MadeFor(msgspec.Struct, frozen=True):
    """Content of :data:`MADE_FOR`."""

    host: str
    state: str


def fabric_name(state: Path) -> str:
    """Under which name the keys of the conductor of a state folder lie; a path always has one."""
    return hashlib.sha256(os.fsencode(state.resolve())).hexdigest()[:16]


def fabric_folder(name: str) -> Path:
    """The folder of keys called ``name``, whether it is there or not; nobody else may get at it.

    Raises:
        UnfitKeyError: it is no name of ours, or the folder is not this user's alone.
        UsageError: there is no home folder.
    """
    if not _NAME.fullmatch(name):
        raise UnfitKeyError(f"fabric '{name}': expected 16 hexadecimal digits")
    home = own_folder()
    _check(home, 0o022, f"others may write to it; run `chmod go-w {home}`")
    for folder in (home / KEYS_NAME, home / KEYS_NAME / name):
        _check(folder, 0o077, f"others may look into it; run `chmod 700 {folder}`")
    return home / KEYS_NAME / name


def make_way(name: str) -> Path:
    """:func:`fabric_folder`, and the folders above it are there afterwards.

    Raises:
        UsageError: they cannot be made, or are not this user's alone.
    """
    fabric_folder(name)
    keys = own_folder() / KEYS_NAME
    try:
        keys.parent.parent.mkdir(parents=True, exist_ok=True)
        for folder in (keys.parent, keys):
            with contextlib.suppress(FileExistsError):
                folder.mkdir(mode=0o700)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(
            f"{error.filename}: cannot be made: {reason}; keys lie there: set {VARIABLE} to a "
            "folder of your own that can be written"
        ) from None
    return fabric_folder(name)


def note(folder: Path, state: Path) -> None:
    """Say which state folder the keys in ``folder`` are for, and remove some of gone ones.

    Raises:
        TwinError: it cannot be written.
    """
    made_for = MadeFor(socket.gethostname(), str(state.resolve()))
    try:
        write_atomic(folder / MADE_FOR, msgspec.json.encode(made_for), mode=0o600)
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    with contextlib.suppress(OSError):
        _sweep(folder)


def _sweep(made: Path) -> None:
    """Remove keys whose state folder is gone from this host, of the next few names."""
    names = sorted(os.listdir(made.parent))
    place = names.index(made.name)
    for name in (names[place + 1 :] + names[:place])[:SWEPT_MAX]:
        folder = made.parent / name
        try:
            made_for: MadeFor = decode_json((folder / MADE_FOR).read_bytes(), MadeFor)
        except (OSError, JsonError):
            continue  # somebody makes it just now
        if made_for.host == socket.gethostname() and not os.path.lexists(made_for.state):
            shutil.rmtree(folder, ignore_errors=True)


def _check(folder: Path, forbidden: int, remedy: str) -> None:
    """Raise UnfitKeyError unless ``folder``, if it is there, is a folder of this user's own."""
    elsewhere = f"set {VARIABLE} to a folder of your own, where keys can lie"
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise UnfitKeyError(f"{folder}: {error.strerror}; {elsewhere}") from None
    if not stat.S_ISDIR(status.st_mode):
        kind = "a symbolic link" if stat.S_ISLNK(status.st_mode) else "no folder"
        raise UnfitKeyError(f"{folder}: {kind}; {elsewhere}")
    if status.st_uid != os.geteuid():
        raise UnfitKeyError(
            f"{folder}: belongs to user id {status.st_uid}, you are {os.geteuid()}; {elsewhere}"
        )
    if status.st_mode & forbidden:
        mode = f"{stat.S_IMODE(status.st_mode):04o}"
        raise UnfitKeyError(f"{folder}: mode {mode}: {remedy}, or {elsewhere}")
