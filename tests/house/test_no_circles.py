"""No module imports itself over others; imports inside functions and for types alone count, too."""

from __future__ import annotations

import ast
from pathlib import Path

from house.statements import statements

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Files of the packages by module name."""
    named = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def imports(root: Path = ROOT) -> dict[str, set[str]]:
    """For every module of ours the modules of ours that it names in imports.

    ``from twin.rig import engine`` is an import of ``twin.rig.engine``, not of the package: the
    package's own file is loaded with any of its modules and holds nothing but its docstring.
    """
    named = modules(root)
    graph: dict[str, set[str]] = {}
    for name, path in named.items():
        found: set[str] = set()
        for node in statements(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                origin = node.module or ""
                if node.level:
                    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
                    parts = package.split(".")
                    parts = parts[: len(parts) - node.level + 1]
                    origin = ".".join([*parts, *([origin] if origin else [])])
                for alias in node.names:
                    inner = f"{origin}.{alias.name}"
                    found.add(inner if inner in named else origin)
        graph[name] = (found & named.keys()) - {name}
    return graph


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules of which each imports, over others, every other (Tarjan)."""
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    groups = []

    def visit(name: str) -> None:
        index[name] = lowest[name] = len(index)
        stack.append(name)
        for other in sorted(graph[name]):
            if other not in index:
                visit(other)
                lowest[name] = min(lowest[name], lowest[other])
            elif other in stack:
                lowest[name] = min(lowest[name], index[other])
        if lowest[name] == index[name]:
            at = stack.index(name)
            group = stack[at:]
            del stack[at:]
            if len(group) > 1:
                groups.append(sorted(group))

    for name in sorted(graph):
        if name not in index:
            visit(name)
    return sorted(groups)


def test_modules_import_in_one_direction():
    graph = imports()
    assert len(graph) > 300
    assert circles(graph) == []


def test_a_circle_over_types_and_functions_is_seen(tmp_path):
    """Three modules, of which one names the next at its top, for types, and in a function."""
    for package in PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    twin = tmp_path / "twin"
    (twin / "a.py").write_text("from twin import b\n")
    (twin / "b.py").write_text("if TYPE_CHECKING:\n    from twin.c import C\n")
    (twin / "c.py").write_text("def f():\n    from . import a\n")
    (twin / "d.py").write_text("import twin.a\n")
    graph = imports(tmp_path)
    assert graph["twin.c"] == {"twin.a"}
    assert circles(graph) == [["twin.a", "twin.b", "twin.c"]]
