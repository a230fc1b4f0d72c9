"""Every name that is imported from our packages is there, also in functions and by scripts: what
nothing imports in a test would break unseen."""

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from house.statements import statements

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")
FOLDERS = (*PACKAGES, "tests", "docs")


def place(module: str) -> Path | None:
    """File of a module of ours, or None."""
    path = ROOT / module.replace(".", "/")
    if path.is_dir():
        return path / "__init__.py"
    return path.with_suffix(".py") if path.with_suffix(".py").exists() else None


class OwnImport(NamedTuple):
    """An import from one of our packages; ``name``: empty where the module itself is imported."""

    line: int
    module: str
    name: str


class ParsedModule(NamedTuple):
    """What a file binds at its top level, and what it imports of ours at any depth."""

    names: frozenset[str]
    imports: tuple[OwnImport, ...]


@cache
def read(path: Path) -> ParsedModule:
    """A file, parsed once though many import from it; empty for a folder without one."""
    tree = ast.parse(path.read_text(encoding="utf-8") if path.exists() else "")
    return ParsedModule(bound(tree), tuple(imports_of(tree)))


def bound(tree: ast.Module) -> frozenset[str]:
    """Names that a tree binds at its top level."""
    found: set[str] = set()
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.If | ast.Try | ast.With):
            waiting += ast.iter_child_nodes(node)
        else:
            found |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    return frozenset(found)


def imports_of(tree: ast.AST) -> Iterator[OwnImport]:
    """Imports from our packages."""
    for node in statements(tree):
        if isinstance(node, ast.Import):
            wanted = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            wanted = [(node.module or "", alias.name) for alias in node.names]
        else:
            continue
        for module, name in wanted:
            if module.partition(".")[0] in PACKAGES:
                yield OwnImport(node.lineno, module, name)


def missing(imports: Iterable[OwnImport]) -> list[str]:
    """Those that lead nowhere, as LINE: MODULE.NAME."""
    lost = []
    for line, module, name in imports:
        path = place(module)
        if path is None or not (
            name in ("", "*") or name in read(path).names or place(f"{module}.{name}")
        ):
            lost.append(f"{line}: {module}.{name}")
    return lost


def test_every_import_of_ours_leads_somewhere():
    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(paths) > 500
    lost = {
        str(path.relative_to(ROOT)): found
        for path in paths
        if (found := missing(read(path).imports))
    }
    assert lost == {}


def test_what_leads_nowhere_is_seen():
    code = "from twin.base.errors import NoSuchError\ndef f():\n    import twin.nowhere\n"
    lost = ["1: twin.base.errors.NoSuchError", "3: twin.nowhere."]
    assert sorted(missing(imports_of(ast.parse(code)))) == lost
    assert missing(imports_of(ast.parse("from twin.base import errors"))) == []
