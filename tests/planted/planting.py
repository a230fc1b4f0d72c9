"""Planted bugs as data: where each one goes, what it changes, and the test that must notice it.

A bug names a symbol (``module:qualified.name``) and an edit inside that symbol's source, so entries
survive moves within and between lines. The catalogue is one YAML file per package.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

CATALOGUE = Path(__file__).parent / "catalogue"
_FIELDS = {"name", "kind", "symbol", "old", "new", "test", "seconds"}


class PlantingError(ValueError):
    """An entry does not fit the code any more. One line."""


@dataclass(frozen=True, slots=True)
class Planted:
    """One bug of the catalogue."""

    name: str
    """What goes wrong, in kebab case; unique."""
    kind: str
    """The slip an engineer makes, such as ``off by one``."""
    symbol: str
    """``module:qualified.name`` of a function, a class, or an assigned name."""
    old: str
    """Text inside the symbol's source; occurs there exactly once."""
    new: str
    """What takes its place."""
    test: str
    """``path::name`` of the test that must fail."""
    seconds: float
    """How long that test took with the bug planted, start of pytest included [s]."""

    @property
    def module(self) -> str:
        """Dotted name of the module."""
        return self.symbol.partition(":")[0]

    @property
    def package(self) -> str:
        """Top-level package."""
        return self.module.partition(".")[0]

    @property
    def test_file(self) -> str:
        """File of the named test, relative to the repository."""
        return self.test.partition("::")[0]


_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Compiled where PyYAML is: every process of the tests reads the catalogue when it collects."""


def load_catalogue(folder: Path = CATALOGUE) -> list[Planted]:
    """Every entry, by package and in the order of the files.

    Raises:
        PlantingError: an entry has missing or unknown fields, or a name occurs twice.
    """
    bugs: list[Planted] = []
    for path in sorted(folder.glob("*.yaml")):
        for entry in yaml.load(path.read_text(encoding="utf-8"), _LOADER):
            if set(entry) != _FIELDS:
                wrong = ", ".join(sorted(set(entry) ^ _FIELDS))
                raise PlantingError(f"{path.name}: {entry.get('name')}: missing or unknown {wrong}")
            bugs.append(Planted(**entry))
    names = [bug.name for bug in bugs]
    for name in names:
        if names.count(name) > 1:
            raise PlantingError(f"the name {name} occurs {names.count(name)} times; choose another")
    return bugs


def source_path(root: Path, module: str) -> Path:
    """The file of a module below ``root``.

    Raises:
        PlantingError: there is none.
    """
    base = root.joinpath(*module.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    raise PlantingError(f"module {module}: no such file; name where the code lives now")


def planted_source(root: Path, bug: Planted) -> tuple[Path, str]:
    """The file that ``bug`` changes and its whole text with the bug in it; nothing is written.

    Raises:
        PlantingError: the symbol is gone, the text does not occur there exactly once, or what
            comes out cannot be compiled.
    """
    path = source_path(root, bug.module)
    text = path.read_text(encoding="utf-8")
    spans = list(_spans(text, bug.symbol.partition(":")[2]))
    if not spans:
        raise PlantingError(f"{bug.name}: no symbol {bug.symbol}; name where the code lives now")
    hits = [(begin, end) for begin, end in spans if bug.old in text[begin:end]]
    count = sum(text[begin:end].count(bug.old) for begin, end in hits)
    if count != 1:
        raise PlantingError(
            f"{bug.name}: the old text occurs {count} times in {bug.symbol}, expected once; "
            "adapt the entry to the code"
        )
    ((begin, end),) = hits
    changed = text[:begin] + text[begin:end].replace(bug.old, bug.new) + text[end:]
    try:
        same = ast.dump(ast.parse(changed)) == ast.dump(ast.parse(text))
    except SyntaxError as error:
        raise PlantingError(f"{bug.name}: does not compile: {error}") from None
    if same:
        raise PlantingError(f"{bug.name}: the edit changes no code")
    return path, changed


def named_test_exists(root: Path, test: str) -> bool:
    """Whether a test function (or the class of a state machine) of that name stands in its file."""
    file, _, name = test.partition("::")
    path = root / file
    if not name or not path.is_file():
        return False
    wanted = name.partition("[")[0].partition("::")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return any(wanted in _names(node) for node in tree.body)


def _spans(text: str, qualified: str) -> Iterator[tuple[int, int]]:
    """Begin and end of every definition of a name, in characters."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    nodes: list[ast.AST] = [ast.parse(text)]
    for name in qualified.split("."):
        nodes = [child for node in nodes for child in _children(node) if name in _names(child)]
    for node in nodes:
        first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
        yield starts[first - 1], starts[node.end_lineno or node.lineno]


def _children(node: ast.AST) -> Iterator[ast.AST]:
    """Statements of a body, and of the branches that stand in it."""
    for child in ast.iter_child_nodes(node):
        yield child
        if isinstance(child, (ast.If, ast.Try, ast.With)):
            yield from _children(child)


def _names(node: ast.AST) -> set[str]:
    """What a statement defines."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return {node.name}
    if isinstance(node, ast.Assign):
        targets = node.targets
    elif isinstance(node, ast.AnnAssign):
        targets = [node.target]
    else:
        return set()
    return {
        part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)
    }
