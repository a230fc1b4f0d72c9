"""What a stack imports, read from the syntax of its sources: nothing of it is run.

Packages are located by their top-level name alone, and what is below it on disk: importing a
parent would run code of the user, which checking a campaign must not.
"""

from __future__ import annotations

import ast
import functools
import importlib
import os
import sys
import sysconfig
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.machinery import BuiltinImporter, FrozenImporter, ModuleSpec, PathFinder
from pathlib import Path

from schemas.files.regular_file import open_regular
from twin.base.errors import UsageError
from twin.base.software import ALL_PACKAGES
from twin.stack_identity.content import Budget, files_below
from twin.stack_identity.installed import claimants, is_site

OURS = frozenset(ALL_PACKAGES)
"""Packages that the software digest speaks for."""

SOURCE_BYTES_MAX = 16 << 20
"""Largest source file whose imports are read [bytes]."""


def search_path(script: Path | None = None, *, environment: bool = True) -> list[str]:
    """Folders in which modules are looked for, as the process of the stack will look for them.

    Args:
        script: the program, if that is none of ours.
        environment: it runs in this Python environment; otherwise only ``PYTHONPATH`` counts.
    """
    first = str(Path.cwd() if script is None else script.resolve().parent)
    further = sys.path if environment else os.environ.get("PYTHONPATH", "").split(os.pathsep)
    scripts = sysconfig.get_path("scripts")
    return list(
        dict.fromkeys([first, *(folder for folder in further if folder and folder != scripts)])
    )


@dataclass(slots=True)
class _Top:
    """A top-level module or package that is the user's own."""

    folders: list[str]
    """Folders of a package; empty: it is a module."""
    is_namespace: bool


@dataclass(slots=True)
class Imports:
    """The files that sources import, directly and through others."""

    path: Sequence[str]
    """Folders in which modules are looked for."""
    budget: Budget
    files: dict[str, Path] = field(default_factory=dict)
    """Files of the user's own modules and packages, by name relative to where they are found."""
    distributions: set[str] = field(default_factory=set)
    """Names of the installed distributions that are imported."""
    _tops: dict[str, _Top | None] = field(default_factory=dict)
    _visited: set[str] = field(default_factory=set)
    _waiting: list[tuple[Path, str, bool]] = field(default_factory=list)
    """Sources whose imports are not read yet: file, module name, whether it is a package."""

    def __post_init__(self) -> None:
        importlib.invalidate_caches()

    def add_module(self, module: str) -> bool:
        """The whole top-level package of ``module`` and what the module imports; False: there is no
        such module.

        Raises:
            UsageError: a source cannot be read, or there are too many files.
        """
        name = module.partition(".")[0]
        top = self._top(name)
        if top is not None and top.is_namespace:
            for folder in top.folders:
                self._add_folder(name, Path(folder))
        self._visit(module)
        self._drain()
        return locate(module, self.path) is not None

    def add_script(self, script: Path) -> None:
        """What a program imports.

        Raises:
            UsageError: as :meth:`add_module`.
        """
        self._waiting.append((script, "", False))
        self._drain()

    def _drain(self) -> None:
        while self._waiting:
            source, module, is_package = self._waiting.pop()
            for name in imported(source, module, is_package=is_package):
                self._visit(name)

    def _visit(self, dotted: str) -> None:
        """Add the modules that ``import dotted`` loads, as far as they are the user's own."""
        if dotted in self._visited:
            return
        self._visited.add(dotted)
        parts = dotted.split(".")
        if self._top(parts[0]) is None:
            return
        path, name, counted = list(self.path), "", False
        for part in parts:
            spec = _spec(part, path, is_top=not name)
            if spec is None:
                return  # an attribute, or a module that is not there
            name = f"{name}.{part}" if name else part
            folders = _folders(spec, path, part)
            if spec.origin is not None and not counted:
                self._add_unit(name, spec, folders)
                counted = True
            self._visited.add(name)
            self._read_later(name, spec, is_package=bool(folders))
            if not folders:
                return
            path = folders

    def _add_unit(self, name: str, spec: ModuleSpec, folders: list[str]) -> None:
        """A package with all its files, or a module that is in none."""
        if folders:
            for folder in folders:
                self._add_folder(name.replace(".", "/"), Path(folder))
            return
        origin = Path(spec.origin or "")
        if not origin.is_file():  # in an archive, which counts as a whole
            origin = next((p for p in origin.parents if p.is_file()), origin)
        parent = name.rpartition(".")[0].replace(".", "/")
        self.budget.spend(origin.parent, origin.stat().st_size if origin.is_file() else 0)
        self.files[f"{parent}/{origin.name}" if parent else origin.name] = origin

    def _add_folder(self, prefix: str, folder: Path) -> None:
        if not folder.is_dir():  # a package in an archive
            archive = next((p for p in folder.parents if p.is_file()), None)
            if archive is not None:
                self.files[archive.name] = archive
            return
        for name, path in files_below(folder, self.budget).items():
            self.files[f"{prefix}/{name}"] = path

    def _read_later(self, name: str, spec: ModuleSpec, *, is_package: bool) -> None:
        source = Path(spec.origin or "")
        if source.suffix == ".py" and source.is_file():
            self._waiting.append((source, name, is_package))

    def _top(self, name: str) -> _Top | None:
        """The user's own module or package; None: it is ours, the standard library's, installed, or
        not there."""
        if name not in self._tops:
            self._tops[name] = self._looked_up(name)
        return self._tops[name]

    def _looked_up(self, name: str) -> _Top | None:
        if name in OURS or name in sys.builtin_module_names:
            return None
        spec = _spec(name, list(self.path), is_top=True)
        if spec is None:
            return None
        folders = _folders(spec, list(self.path), name)
        if spec.origin is not None:
            place = Path(folders[0]).parent if folders else Path(spec.origin).parent
            if is_standard(Path(spec.origin)) or self._is_installed(place, name):
                return None
            return _Top(folders, is_namespace=False)
        local = [f for f in folders if not self._is_installed(Path(f).parent, name, shared=True)]
        return _Top(local, is_namespace=True) if local else None

    def _is_installed(self, place: Path, name: str, *, shared: bool = False) -> bool:
        owners = claimants(place, name, shared=shared)
        self.distributions.update(owners)
        return bool(owners)


def locate(module: str, path: Sequence[str] | None = None) -> ModuleSpec | None:
    """Where a module is, without importing its parents; None: nowhere.

    Args:
        module: its name.
        path: folders in which it is looked for; None: those of :func:`search_path`.
    """
    if module.partition(".")[0] in sys.builtin_module_names:
        return BuiltinImporter.find_spec(module)
    importlib.invalidate_caches()
    folders = list(search_path() if path is None else path)
    spec: ModuleSpec | None = None
    for part in module.split("."):
        spec = _spec(part, folders, is_top=spec is None) if folders else None
        if spec is None:
            return None
        folders = _folders(spec, folders, part)
    if spec is not None:
        spec.name = module
    return spec


def is_standard(file: Path) -> bool:
    """Whether a module's file belongs to Python's standard library."""
    if str(file) in ("built-in", "frozen"):
        return True
    parents = (*file.parents, *file.resolve().parents)
    return not _standard_folders().isdisjoint(parents) and not any(map(is_site, parents))


@functools.cache
def _standard_folders() -> frozenset[Path]:
    paths = sysconfig.get_paths()
    known = {Path(paths["stdlib"]), Path(paths["platstdlib"])}
    return frozenset(known | {folder.resolve() for folder in known})


def _spec(part: str, path: list[str], *, is_top: bool) -> ModuleSpec | None:
    """How a module would be loaded from one of the folders ``path``, by the last part of its name:
    by the whole name, Python would ask for the parent, which is not imported."""
    try:
        spec = PathFinder.find_spec(part, path)
        if spec is None and is_top:
            # Editable installations may leave finders of their own, which run already.
            for finder in sys.meta_path:
                if finder in (BuiltinImporter, FrozenImporter, PathFinder):
                    continue
                spec = finder.find_spec(part, None, None)
                if spec is not None:
                    break
    except (ImportError, OSError, ValueError, AttributeError):
        return None
    return spec


def _folders(spec: ModuleSpec, path: list[str], part: str) -> list[str]:
    """Folders of a package's modules; none: it is a module."""
    if spec.submodule_search_locations is None:
        return []
    if spec.origin is not None:
        return list(spec.submodule_search_locations)
    # A namespace: its own list looks the parent up among loaded modules.
    portions = [str(Path(folder) / part) for folder in path if (Path(folder) / part).is_dir()]
    return portions or list(spec.submodule_search_locations)


def imported(source: Path, module: str, *, is_package: bool) -> Iterator[str]:
    """Dotted names that the import statements of a source name, wherever they stand; of ``from a
    import b`` both ``a`` and ``a.b``.

    Args:
        source: the file.
        module: its name; empty: a program.
        is_package: it is the ``__init__`` of a package.

    Raises:
        UsageError: it cannot be read as Python, in one line.
    """
    package = module if is_package else module.rpartition(".")[0]
    for node in ast.walk(_parsed(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _base(node, package)
            if base:
                yield base
                yield from (f"{base}.{alias.name}" for alias in node.names if alias.name != "*")


def _base(node: ast.ImportFrom, package: str) -> str:
    """Module that is imported from; empty: it is beyond the top-level package."""
    if not node.level:
        return node.module or ""
    parts = package.split(".") if package else []
    if node.level > len(parts):
        return ""
    kept = parts[: len(parts) - node.level + 1]
    return ".".join([*kept, node.module] if node.module else kept)


def _parsed(source: Path) -> ast.Module:
    try:
        with open_regular(source) as file:
            data = file.read(SOURCE_BYTES_MAX + 1)
        if len(data) > SOURCE_BYTES_MAX:
            raise UsageError(
                f"{source}: more than {SOURCE_BYTES_MAX >> 20} MiB of Python; what it imports "
                "cannot be told, make it smaller"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the user's code, told when it is run
            return ast.parse(data, str(source))
    except SyntaxError as error:
        where = f" line {error.lineno}" if error.lineno else ""
        raise UsageError(f"{source}{where}: cannot be read as Python ({error.msg})") from None
    except (ValueError, RecursionError, MemoryError) as error:
        words = str(error) or type(error).__name__
        raise UsageError(f"{source}: cannot be read as Python ({words})") from None
    except OSError as error:
        raise UsageError(f"{source}: cannot be read ({error.strerror})") from None
