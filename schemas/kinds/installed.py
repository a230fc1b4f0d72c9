"""Installed distributions, found as ``importlib.metadata`` finds them.

That takes 10 ms to load, and as long again to look at some hundred distributions.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from importlib.machinery import PathFinder
from pathlib import Path

_SUFFIXES = (".dist-info", ".egg-info")

ImportPath = tuple[bool, tuple[tuple[str, int], ...]]
"""Whether distributions are looked for in folders alone, and which those are, with the times at
which they changed, as an installation does it."""

_looked: dict[ImportPath, dict[str, str] | None] = {}
"""Import path -> the latest look."""
_lock = threading.Lock()


def import_path() -> ImportPath:
    """The import path as it is now."""
    finders = [finder for finder in sys.meta_path if hasattr(finder, "find_distributions")]
    return finders == [PathFinder], tuple((folder, _changed_ns(folder)) for folder in sys.path)


def metadata_folders() -> dict[str, str] | None:
    """Normalized name of each distribution -> folder of its metadata, the first on the import path;
    None: not all of them lie in folders there, and ``importlib.metadata`` has to be asked."""
    place = import_path()
    with _lock:
        if place not in _looked:
            folders = _metadata_folders() if place[0] else None
            _looked.clear()
            _looked[place] = folders
        return _looked[place]


def normalized(name: str) -> str:
    """The name of a distribution as it is compared."""
    return re.sub(r"[-_.]+", "_", name).lower()


def version_of(name: str) -> str:
    """Version of a distribution; empty: it is not installed."""
    folders = metadata_folders()
    if folders is None:
        return _version_asked(name)
    folder = folders.get(normalized(name))
    if folder is None:
        return ""
    # Its head alone: the text of the project's page behind it takes ten times as long to read.
    for file in ("METADATA", "PKG-INFO"):
        head = _text(f"{folder}/{file}").partition("\n\n")[0]
        if found := _VERSION.search(head):
            return found[1]
    return _version_asked(name)


_VERSION = re.compile(r"^Version: *(\S+) *$", re.MULTILINE)


def _version_asked(name: str) -> str:
    import importlib.metadata

    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _metadata_folders() -> dict[str, str] | None:
    folders: dict[str, str] = {}
    for place in sys.path:
        try:
            names = os.listdir(place or ".")
        except NotADirectoryError:
            return None  # an archive
        except OSError:
            continue
        if place.lower().endswith(".egg"):
            return None
        for name in names:
            if name.lower().endswith(_SUFFIXES):
                key = normalized(name.rpartition(".")[0].partition("-")[0])
                folders.setdefault(key, f"{place or '.'}/{name}")
    return folders


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _changed_ns(folder: str) -> int:
    """When an entry of the import path changed; 0: it is not there [ns]."""
    try:
        return Path(folder or ".").stat().st_mtime_ns
    except OSError:
        return 0
