"""Declarations of kinds by name: those shipped, and those that installed distributions bring.

A distribution brings kinds as entry points of a group such as ``drivetwin.scenarios``. An entry
point names a declaration, or a tuple of them, in a module that imports ``schemas`` and the standard
library only. A declaration names its implementation as ``module:attribute``, which nobody but the
running package imports.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeVar

from schemas.escape import escape
from schemas.kinds.installed import ImportPath, import_path, metadata_folders, normalized

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

OUR_DISTRIBUTION = "drivetwin"
OUR_DISTRIBUTIONS = (OUR_DISTRIBUTION, "drivetwin-worker")
"""Everything, and what a node that only runs workers needs."""


class Plugin(NamedTuple):
    """Another distribution that brings kinds."""

    name: str
    version: str


class Declaration(Protocol):
    """A frozen record that says what a kind is."""

    @property
    def name(self) -> str:
        """Name of the kind in campaigns, commands and files."""


D = TypeVar("D", bound=Declaration)


@dataclass(frozen=True, slots=True)
class Kinds(Generic[D]):
    """The declarations of one group."""

    declared: tuple[D, ...]
    """The shipped ones first, then those of others by distribution."""
    broken: Mapping[str, str]
    """Entry point that cannot be used -> one line that names its distribution and the reason."""
    brought: Mapping[str, Plugin] = field(default_factory=dict)
    """Kind, or entry point that cannot be used, that is not shipped -> who brings it."""

    def names(self) -> tuple[str, ...]:
        """The names of the declarations, then those of what cannot be used: whoever asks for one
        of these is told why."""
        return (*(kind.name for kind in self.declared), *self.broken)

    def get(self, name: str) -> D | None:
        """The declaration called ``name``, or None."""
        return next((kind for kind in self.declared if kind.name == name), None)

    def find(self, name: str) -> D:
        """The declaration called ``name``.

        Raises:
            ValueError: there is none, or it cannot be used; one line.
        """
        kind = self.get(name)
        if kind is None:
            known = ", ".join(declaration.name for declaration in self.declared)
            raise ValueError(self.broken.get(name, f"no '{name}'; there: {known}"))
        return kind


def read_kinds(group: str, type_: type[D], ours: Mapping[str, str]) -> Kinds[D]:
    """The declarations of ``group``.

    Args:
        group: of entry points.
        type_: of the declarations.
        ours: entry point -> ``module:attribute`` of those that are shipped; the same as in
            pyproject.toml. They are not read from the distribution's metadata, which is missing
            beside a source tree and, of an editable install, as old as the installation.
    """
    declared: list[D] = []
    for reference in ours.values():
        declared += _loaded(reference, type_)
    names = {declaration.name for declaration in declared}
    broken: dict[str, str] = {}
    brought: dict[str, Plugin] = {}
    for point in sorted(_foreign(group), key=lambda p: (_distribution(p), p.name)):
        try:
            declarations = _loaded(point.value, type_)
            if taken := sorted(names & {declaration.name for declaration in declarations}):
                raise ValueError(f"the name '{taken[0]}' is taken")
        except (Exception, SystemExit) as error:  # code of others may raise anything, or exit
            line = f"{_distribution(point)}: entry point '{point.name}' of {group}: {_why(error)}"
            broken[point.name] = escape(" ".join(line.split()), 300)
            if point.name not in names:  # else it would pass for who brings a kind that is good
                brought[point.name] = _plugin(point)
            continue
        declared += declarations
        names |= {declaration.name for declaration in declarations}
        brought.update((declaration.name, _plugin(point)) for declaration in declarations)
    return Kinds(tuple(declared), broken, brought)


def installed_plugins() -> dict[str, str]:
    """Every other distribution of this installation that brings kinds of any group, by name, with
    its version."""
    plugins = (_plugin(point) for point in _all_foreign())
    return {plugin.name: plugin.version for plugin in sorted(plugins)}


def implementation(reference: str) -> Any:
    """The object that a declaration names as ``module:attribute``.

    Raises:
        ValueError: it cannot be imported, whatever its module raises, or it exits; one line with
            the distribution that brings it.
    """
    try:
        return _attribute(reference)
    except (Exception, SystemExit) as error:
        line = f"{_owner(reference)}'{reference}' cannot be imported: {_why(error)}"
        raise ValueError(escape(" ".join(line.split()), 300)) from error


def _owner(reference: str) -> str:
    """The distribution whose kinds lie in the package of ``reference``, with a colon; empty: it is
    ours, or nobody's."""
    package = reference.partition(":")[0].partition(".")[0]
    for point in _all_foreign():
        if point.module.partition(".")[0] == package:
            return f"{_distribution(point)}: "
    return ""


def _why(error: BaseException) -> str:
    """What was raised at an import; the type too where its text does not speak for itself."""
    if isinstance(error, ImportError | AttributeError | ValueError):
        return str(error) or type(error).__name__
    return f"{type(error).__name__}: {error}"


def _loaded(reference: str, type_: type[D]) -> list[D]:
    value = _attribute(reference)
    declarations = list(value) if isinstance(value, tuple) else [value]
    if strange := [
        declaration for declaration in declarations if not isinstance(declaration, type_)
    ]:
        raise ValueError(f"'{reference}' is a {type(strange[0]).__name__}, not a {type_.__name__}")
    return declarations


def _attribute(reference: str) -> Any:
    module, _, attribute = reference.partition(":")
    return getattr(importlib.import_module(module), attribute)


def _foreign(group: str) -> list[EntryPoint]:
    """Entry points of other distributions."""
    return [point for point in _all_foreign() if point.group == group]


_looked: dict[ImportPath, list[EntryPoint]] = {}
"""Import path -> the latest look."""


def _all_foreign() -> list[EntryPoint]:
    """Entry points of other distributions, of all groups that bring kinds. A look reads a file of
    each distribution, and every table of kinds needs one, so it is kept as long as nothing was
    installed."""
    place = import_path()
    points = _looked.get(place)
    if points is None:
        folders = metadata_folders()
        points = _asked() if folders is None else _bringing(folders)
        _looked.clear()  # perhaps of another thread, which has its points already
        _looked[place] = points
    return points


def _bringing(folders: Mapping[str, str]) -> list[EntryPoint]:
    """:func:`_all_foreign` of distributions whose metadata lie in ``folders``, by name."""
    ours = {normalized(name) for name in OUR_DISTRIBUTIONS}
    points: list[EntryPoint] = []
    for name, folder in folders.items():
        if name in ours or _GROUPS not in _content(f"{folder}/entry_points.txt"):
            continue
        from importlib.metadata import PathDistribution  # takes 10 ms, and is hardly ever needed

        points += _others(PathDistribution(Path(folder)).entry_points)
    return points


def _asked() -> list[EntryPoint]:
    """:func:`_all_foreign` of whatever distributions there are."""
    from importlib.metadata import entry_points

    points = entry_points()
    return [point for group in points.groups for point in _others(points.select(group=group))]


_GROUPS = f"[{OUR_DISTRIBUTION}.".encode()
"""Begins the heads of groups that bring kinds, in a file of entry points."""


def _content(path: str) -> bytes:
    try:
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - for hundreds of files
            return file.read()
    except OSError:
        return b""


def _others(points: Iterable[EntryPoint]) -> list[EntryPoint]:
    """Entry points that bring kinds, and are not ours."""
    return [
        point
        for point in points
        if point.group.startswith(f"{OUR_DISTRIBUTION}.")
        and (point.dist is None or point.dist.name not in OUR_DISTRIBUTIONS)
    ]


def _distribution(point: EntryPoint) -> str:
    return " ".join(_plugin(point)).rstrip()


def _plugin(point: EntryPoint) -> Plugin:
    if point.dist is None:
        return Plugin("unknown distribution", "")
    return Plugin(point.dist.name, point.dist.version)
