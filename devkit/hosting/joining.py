"""``devkit host --join``: serves rigs that workers of other hosts announce in a shared folder.

Whoever writes there says what this process starts, so an announcement is believed only if this user
wrote it and nobody else could have.
"""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from msgspec import Struct

from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import open_regular
from twin.base.errors import UsageError
from twin.base.process import end, spawn

PERIOD_S = 0.2
"""Time between two looks into a shared folder for new rigs [s]."""

FILE_BYTES_MAX = 1 << 20
"""Largest announcement that is read [bytes]."""

ENTRIES_MAX = 10_000
"""Number of files of the folder that are looked at, at most."""

TOLD_MAX = 1000
"""Number of unfit files that are reported, at most."""

WORDS = (
    *("--connect", "--rig", "--namespace", "--slots", "--stack", "--parameters", "--expected"),
    *("--foreign", "--source"),
)
"""Options of ``devkit host`` that a worker may announce."""

COMMAND = "--foreign"
"""The one that names a command."""


class Announced(Struct, frozen=True, forbid_unknown_fields=True):
    """Content of ``RIG.json``."""

    arguments: list[str]


class UnfitError(ValueError):
    """A file is no announcement that is believed; one line says why."""


@dataclass(slots=True)
class Announcements:
    """Announcements of one folder; what is none is told once and left where it is."""

    folder: Path
    commands: bool = False
    """Start what they name as commands, too."""
    _told: set[str] = field(default_factory=set)

    def claim(self) -> tuple[str, list[str]] | None:
        """Take the first rig that may be served, and what it is served with; the rename decides
        between several hosts.

        Raises:
            UsageError: others can write to the folder.
        """
        if not _check_folder(self.folder):
            return None
        for path in self._files():
            try:
                arguments = read_announcement(path, commands=self.commands)
            except FileNotFoundError:
                continue  # somebody else takes it just now
            except UnfitError as error:
                self._tell(path, str(error))
                continue
            mine = path.with_suffix(f".claimed-{os.uname().nodename}-{os.getpid()}")
            with suppress(FileNotFoundError):
                path.rename(mine).unlink(missing_ok=True)
                return path.stem, arguments
        return None

    def _files(self) -> Iterator[Path]:
        names = sorted(entry.name for entry in islice(os.scandir(self.folder), ENTRIES_MAX))
        return (
            self.folder / name
            for name in names
            if name.endswith(".json") and not name.startswith(".")
        )

    def _tell(self, path: Path, why: str) -> None:
        if path.name in self._told or len(self._told) >= TOLD_MAX:
            return
        self._told.add(path.name)
        print(f"{escape(str(path))}: ignored: {escape(why)}", file=sys.stderr, flush=True)


def run_join(folder: Path, *, commands: bool = False) -> int:
    """Serve rigs announced in ``folder`` one after the other, each in a process of its own.

    Beside an announcement lies the rig's key, if it has one.

    Args:
        folder: ``--join-dir`` of the workers; may come later.
        commands: also start the commands of campaigns (``autonomy.command``, bridges, containers).

    Raises:
        UsageError: others can write to the folder.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    announcements = Announcements(folder, commands)
    child: subprocess.Popen[bytes] | None = None
    try:
        while True:
            claimed = announcements.claim()
            if claimed is None:
                time.sleep(PERIOD_S)
                continue
            rig, arguments = claimed
            print(f"joining {rig}", file=sys.stderr, flush=True)
            key = folder / f"{rig}.key"
            key_option = ["--key", str(key)] if key.exists() else []
            words = [sys.executable, "-m", "devkit", "host", *arguments, *key_option]
            try:
                child = spawn(words, log=sys.stderr.buffer)
            except OSError as error:
                print(f"rig {rig}: cannot be started: {error.strerror}", file=sys.stderr)
                continue
            child.wait()
            child = None
    finally:
        if child is not None:
            end(child)


def read_announcement(path: Path, *, commands: bool) -> list[str]:
    """The arguments of ``devkit host`` that a file announces.

    Raises:
        UnfitError: this user did not write it alone, it announces nothing, or a command that is not
            to be started.
        FileNotFoundError: it is gone.
    """
    rig = path.stem
    if not (rig.isascii() and rig.isalnum()):
        raise UnfitError("expected the name of a rig, letters and digits")
    try:
        announced = decode_json(_own_bytes(path), Announced)
    except JsonError as error:
        raise UnfitError(f"no announcement: {error}") from None
    words, values = announced.arguments[::2], announced.arguments[1::2]
    for word in words:
        if word not in WORDS or words.count(word) > 1:
            raise UnfitError(f"option '{word}', allowed once each: {', '.join(WORDS)}")
    if len(words) != len(values) or any("\0" in value for value in values):
        raise UnfitError("expected an option and its value in turns")
    options = dict(zip(words, values, strict=True))
    if options.get("--rig") != rig:
        raise UnfitError(f"it announces rig '{options.get('--rig', '')}', its name says {rig}")
    if options.get(COMMAND) and not commands:
        raise UnfitError(
            "its campaign names a command (autonomy.command, bridge or image); start this host "
            "with --commands to have it run here"
        )
    return announced.arguments


def _own_bytes(path: Path) -> bytes:
    """The content of a file that nobody but this user can have written.

    Raises:
        UnfitError: somebody else can; or it is too large, or no file.
        FileNotFoundError: there is none.
    """
    if path.is_symlink():
        raise UnfitError("a symbolic link")
    try:
        file = open_regular(path, FILE_BYTES_MAX)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UnfitError(str(error.strerror)) from None
    with file:
        status = os.fstat(file.fileno())
        if status.st_uid != os.geteuid():
            raise UnfitError(f"belongs to user id {status.st_uid}, you are {os.geteuid()}")
        if status.st_mode & 0o022:
            raise UnfitError(f"others may write to it (mode {stat.S_IMODE(status.st_mode):04o})")
        return file.read(FILE_BYTES_MAX)


def _check_folder(folder: Path) -> bool:
    """Whether the folder is there yet.

    Raises:
        UsageError: others can put files of ours into it, or it is no folder.
    """
    try:
        status = folder.stat()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror}") from None
    if not stat.S_ISDIR(status.st_mode):
        raise UsageError(f"{folder}: not a folder; give that of `twin worker --join-dir`")
    sticky = bool(status.st_mode & stat.S_ISVTX)
    if status.st_mode & 0o022 and not sticky:
        mode = f"{stat.S_IMODE(status.st_mode):04o}"
        raise UsageError(
            f"{folder}: others may write to it (mode {mode}), and so say what runs here; run "
            f"`chmod go-w {folder}`"
        )
    if status.st_uid not in (os.geteuid(), 0) and not sticky:
        raise UsageError(
            f"{folder}: belongs to user id {status.st_uid}, you are {os.geteuid()}; give a folder "
            "of your own"
        )
    return True
