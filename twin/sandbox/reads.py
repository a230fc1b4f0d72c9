"""What a stack has to read: Python, our packages, its own code, and what its campaign names."""

from __future__ import annotations

import os
import shutil
import site
import sys
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from schemas.sections.foreign import Foreign
from twin.base.errors import UsageError
from twin.base.own_folder import own_folder
from twin.base.software import own_folders
from twin.sandbox.view import SCRATCH

_SITES = ("site-packages", "dist-packages")


def python_reads() -> list[Path]:
    """Folders of this Python, of what is installed in it, and of our packages."""
    found = [sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix]
    found += [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    found += [site.getusersitepackages()] if site.ENABLE_USER_SITE else []
    found += [entry for entry in sys.path if entry and _is_installed(Path(entry))]
    found += os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    places = [Path(entry) for entry in found if entry.startswith("/") and entry != "/"]
    places += [place for each in _links(Path(sys.executable)) for place in [each.parent.parent]]
    return unnested([*places, *own_folders()])


def _is_installed(entry: Path) -> bool:
    """Whether an entry of the path of modules is an archive, or a folder of installed packages."""
    if entry.name in _SITES or entry.is_file():
        return True
    return any(entry.glob("*.dist-info"))


def _links(program: Path) -> list[Path]:
    """A program and what it links to, one after the other, in folders called ``bin``."""
    found = [program]
    while found[-1].is_symlink() and len(found) < 10:
        found.append(found[-1].parent / found[-1].readlink())
    return [Path(os.path.normpath(each)) for each in found if each.parent.name == "bin"]


def stack_reads(
    stack: str,
    foreign: Foreign | None,
    files: Sequence[str],
    parameters: Mapping[str, Any],
    models: Iterable[str] = (),
) -> list[Path]:
    """What a stack's own code consists of, and the files that its campaign names.

    Args:
        stack: entry point ``module:Class``.
        foreign: its command.
        files: further files and folders.
        parameters: its own; some may name files.
        models: paths of the networks that its cases look with.
    """
    from twin.stack_identity.identity import Named, stack_files  # workers start without

    found: list[Path] = []
    try:
        found = [_whole(name, path) for name, path in stack_files(Named(stack, foreign, files))]
    except UsageError:
        pass  # the process that misses something says what
    if foreign is not None:
        found += [each for word in foreign.command for each in _environment(word)]
        found += _beside(script_folder(foreign))
    found += [Path(each).absolute() for each in models]
    for value in parameters.values():
        if isinstance(value, str) and _is_file(value):
            found.append(Path(value).absolute())
    return unnested(found)


def script_folder(foreign: Foreign) -> Path | None:
    """Where the script behind a bridge lies: published ones find their files in the working folder,
    and are started there. None: its path does not say."""
    if foreign.bridge == "none":
        return None
    for word in foreign.command:
        path = Path(word)
        if path.is_absolute() and path.suffix == ".py" and path.is_file():
            return path.parent
    return None


def _beside(folder: Path | None) -> list[Path]:
    """What lies in a script's folder, unless everything of somebody does."""
    if folder is None or folder in (SCRATCH, Path.home()) or folder in own_folder().parents:
        return []
    return sorted(folder.iterdir())


def _environment(word: str) -> list[Path]:
    """The environment of Python that a program of a command belongs to, and the Python that this
    was made of; nothing of any other program."""
    named = shutil.which(word)
    found = []
    for program in _links(Path(named).absolute()) if named else []:
        prefix = program.parent.parent
        marks = (prefix / "pyvenv.cfg", prefix / "conda-meta", *prefix.glob("lib/python3*/os.py"))
        if prefix != Path("/") and any(mark.exists() for mark in marks):
            found.append(prefix)
    return found


def _is_file(value: str) -> bool:
    """As :func:`twin.stack_identity.identity.named_files` has it: a file, or with a ``/`` in
    it a folder."""
    try:
        return bool(value) and (Path(value).is_file() or ("/" in value and Path(value).is_dir()))
    except (OSError, ValueError):
        return False


def _whole(name: str, path: Path) -> Path:
    """The file at ``path``, called ``name``, or the package or folder that it counts with."""
    words = Path(name).parts
    path = path.absolute()
    if words[0].startswith("autonomy."):  # autonomy.files[0]/data/curve.csv
        below = len(words) - 1
    else:  # mystack/control/curve.py, below a folder where modules are found
        below = len(words) - 1 if path.parts[-len(words) :] == words else 0
    return path.parents[below - 1] if below else path


def unnested(paths: Iterable[Path]) -> list[Path]:
    """``paths`` and what they link to, without those that lie in others of them, sorted."""
    kept: list[Path] = []
    every = {each for path in paths for each in (path, path.resolve())}
    for path in sorted(every, key=lambda each: (len(each.parts), each)):
        if not any(path == each or each in path.parents for each in kept):
            kept.append(path)
    return sorted(kept)
