"""Every name that is imported from our packages is there, also in functions and by scripts: what
nothing imports in a test would break unseen."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc")
FOLDERS = (*PACKAGES, "tests", "docs")


def place(module: str) -> Path | None:
    """File of a module of ours, or None."""
    path = ROOT / module.replace(".", "/")
    if path.is_dir():
        return path / "__init__.py"
    return path.with_suffix(".py") if path.with_suffix(".py").exists() else None


@cache
def names_in(path: Path) -> frozenset[str]:
    """What a module binds at its top level; empty for a folder without one."""
    found: set[str] = set()
    waiting = list(ast.parse(path.read_text(encoding="utf-8")).body) if path.exists() else []
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


def missing(tree: ast.AST) -> list[str]:
    """Imports from our packages that lead nowhere, as LINE: MODULE.NAME."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            wanted = [(node.module or "", alias.name) for alias in node.names]
        else:
            continue
        for module, name in wanted:
            if module.partition(".")[0] not in PACKAGES:
                continue
            path = place(module)
            if path is None or not (
                name in ("", "*") or name in names_in(path) or place(f"{module}.{name}")
            ):
                found.append(f"{node.lineno}: {module}.{name}")
    return found


def test_every_import_of_ours_leads_somewhere():
    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(paths) > 500
    lost = {
        str(path.relative_to(ROOT)): found
        for path in paths
        if (found := missing(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert lost == {}


def test_what_leads_nowhere_is_seen():
    code = "from twin.base.errors import NoSuchError\ndef f():\n    import twin.nowhere\n"
    assert missing(ast.parse(code)) == ["1: twin.base.errors.NoSuchError", "3: twin.nowhere."]
    assert missing(ast.parse("from twin.base import errors")) == []
