"""Contents of files and folders: which of them count, and their SHA-256."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from schemas.files.assets import file_digest
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from twin.base.cache import cache_folder, is_trusted
from twin.base.errors import UsageError
from twin.base.files import write_atomic

FILES_MAX = 10_000
"""Most files of the folders of a stack."""

BYTES_MAX = 8 << 30
"""Most bytes of the folders of a stack [bytes]."""

KEPT_BYTES_MIN = 32 << 20
"""Size from which on a file's digest is kept in the cache folder, and the file is read again only
if size, times or inode changed [bytes]."""

_NOTE_BYTES_MAX = 1 << 16

_RUN_FOLDER = ({"conductor.db"}, {"campaign.yaml", "outcomes.json"})
"""A folder that holds all of one of these is the folder of a run, or of a conductor."""

_ENVIRONMENT = ("pyvenv.cfg", "conda-meta", "CACHEDIR.TAG")
"""A folder that holds one of these is a Python environment or a cache."""


class Budget:
    """What is left of :data:`FILES_MAX` and :data:`BYTES_MAX` for one stack."""

    def __init__(self) -> None:
        self._files = 0
        self._bytes = 0

    def spend(self, folder: Path, size: int) -> None:
        """Count one more file, of ``size`` bytes, below ``folder``.

        Raises:
            UsageError: it is one too many.
        """
        self._files += 1
        self._bytes += size
        hint = "take what is not the stack's out of it, or put its code into a folder of its own"
        if self._files > FILES_MAX:
            raise UsageError(f"{folder}: more than {FILES_MAX} files belong to the stack; {hint}")
        if self._bytes > BYTES_MAX:
            raise UsageError(
                f"{folder}: more than {BYTES_MAX >> 30} GiB belong to the stack; {hint}"
            )


def files_below(folder: Path, budget: Budget) -> dict[str, Path]:
    """Files of a stack in ``folder`` and below, by their path relative to it, sorted.

    Left out are hidden files and folders, compiled Python, Python environments, caches, folders of
    runs and whatever is no regular file. A folder that is reached twice by links counts once.

    Raises:
        UsageError: too many, or a folder that cannot be read.
    """
    reached: set[tuple[int, int]] = set()
    files: dict[str, Path] = {}
    waiting = [(folder, "")]
    while waiting:
        here, prefix = waiting.pop()
        try:
            status = here.stat()
            names = sorted(entry.name for entry in os.scandir(here))
        except OSError as error:
            raise UsageError(f"{here}: cannot be read ({error.strerror})") from None
        if (status.st_dev, status.st_ino) in reached or (prefix and _is_left_out(names)):
            continue
        reached.add((status.st_dev, status.st_ino))
        below = []
        for name in names:
            if name.startswith(".") or name.endswith("~"):
                continue
            path = here / name
            try:
                mode = path.stat()
            except OSError:
                continue  # a link that leads nowhere: nobody loads it
            if stat.S_ISDIR(mode.st_mode):
                if name != "__pycache__" and not name.endswith((".egg-info", ".dist-info")):
                    below.append((path, f"{prefix}{name}/"))
            elif stat.S_ISREG(mode.st_mode) and not _is_compiled(name, names):
                budget.spend(folder, mode.st_size)
                files[prefix + name] = path
        waiting += reversed(below)
    return dict(sorted(files.items()))


def _is_left_out(names: list[str]) -> bool:
    held = set(names)
    return any(name in held for name in _ENVIRONMENT) or any(run <= held for run in _RUN_FOLDER)


def _is_compiled(name: str, names: list[str]) -> bool:
    """Compiled from a source that lies beside it, as Python 2 did."""
    return name.endswith(".pyc") and name[:-1] in names


def named_path(name: str, path: Path, budget: Budget) -> dict[str, Path]:
    """``name`` of a file, or of the files of a folder each with its path behind it.

    Raises:
        UsageError: there is neither.
    """
    if path.is_dir():
        return {f"{name}/{below}": p for below, p in files_below(path, budget).items()}
    if not path.is_file():
        raise UsageError(f"{name}: {path}: no such file or folder")
    budget.spend(path, path.stat().st_size)
    return {name: path}


class _Kept(msgspec.Struct, frozen=True):
    """What a large file, or the folder of an image, was when it was read."""

    stamp: list[int | str]
    sha256: str


def content_digest(path: Path) -> str:
    """SHA-256 of a file's content; that of a large one is remembered.

    Raises:
        UsageError: it cannot be read.
    """
    try:
        status = path.stat()
        if status.st_size < KEPT_BYTES_MIN:
            return file_digest(path, None)
        return _remembered(path, lambda: _stamp(path.stat()), lambda: file_digest(path, None))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None


def tree_digest(folder: Path) -> str:
    """SHA-256 over all files and links of an unpacked container image; remembered.

    Folders count by what is in them: a runtime makes empty ones where folders of the host appear.

    Raises:
        UsageError: a folder cannot be read.
    """
    try:
        return _remembered(folder, lambda: _tree_stamp(folder), lambda: _tree_sha(folder))
    except OSError as error:
        raise UsageError(f"{folder}: cannot be read ({error.strerror})") from None


def _stamp(status: os.stat_result) -> list[int | str]:
    times = [status.st_mtime_ns, status.st_ctime_ns]
    return [status.st_dev, status.st_ino, status.st_size, *times]


def _tree(folder: Path) -> Iterator[tuple[str, os.DirEntry[str]]]:
    """Everything below ``folder`` by its relative path, in order; links are not followed."""
    waiting = [(str(folder), "")]
    while waiting:
        here, prefix = waiting.pop()
        for entry in sorted(os.scandir(here), key=lambda entry: entry.name):
            yield prefix + entry.name, entry
            if entry.is_dir(follow_symlinks=False):
                waiting.append((entry.path, f"{prefix}{entry.name}/"))


def _tree_stamp(folder: Path) -> list[int | str]:
    sha = hashlib.sha256()
    for name, entry in _tree(folder):
        sha.update(f"{name} {_stamp(entry.stat(follow_symlinks=False))}\n".encode())
    return [sha.hexdigest()]


def _tree_sha(folder: Path) -> str:
    sha = hashlib.sha256()
    for name, entry in _tree(folder):
        if entry.is_dir(follow_symlinks=False):
            continue
        content = ""
        if entry.is_symlink():
            content = str(Path(entry.path).readlink())
        elif entry.is_file():
            try:
                content = file_digest(Path(entry.path), None)
            except PermissionError:  # such as password files: who may not read them does not
                content = "unreadable"
        sha.update(f"{name}\0{content}\n".encode())
    return sha.hexdigest()


def _remembered(
    path: Path, stamp: Callable[[], list[int | str]], compute: Callable[[], str]
) -> str:
    """What ``compute`` says of ``path``, or said when its stamp was the same."""
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:32]
    note = cache_folder() / "contents" / f"{name}.json"
    before = stamp()
    if not is_trusted(cache_folder()) or not is_trusted(note.parent):
        return compute()
    try:
        kept: _Kept = decode_json(read_regular(note, _NOTE_BYTES_MAX), _Kept)
        if kept.stamp == before:
            return kept.sha256
    except (OSError, JsonError):
        pass  # not read yet, or damaged
    value = compute()
    if stamp() == before:  # nobody wrote to it meanwhile
        try:
            note.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(note, msgspec.json.encode(_Kept(before, value)), sync=False)
        except OSError:
            pass  # it is read again next time
    return value
