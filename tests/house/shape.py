"""The shape of the house: sizes of files, functions and folders, and names of public classes.

``python tests/house/shape.py`` prints them beside their limits; exit code 1 beyond one. Part of
``make check``.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")
FILE_LINES = (150, 300, 600)
"""Limits of the median, the 90th percentile and the longest file."""
FUNCTION_LINES = (30, 70)
"""Limits of the 90th percentile and the longest function."""
KERNEL_LINES = 120
FOLDER_MODULES = 20


@dataclass
class House:
    """What was counted."""

    files: dict[str, int] = field(default_factory=dict)
    """Lines by path; an ``__init__.py`` is no module."""
    functions: dict[str, int] = field(default_factory=dict)
    kernels: dict[str, int] = field(default_factory=dict)
    folders: Counter[str] = field(default_factory=Counter)
    classes: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    """Places of every public class name."""


def look(root: Path = ROOT) -> House:
    """Read all sources of the packages."""
    house = House()
    for path in sorted(path for name in PACKAGES for path in (root / name).rglob("*.py")):
        name, text = str(path.relative_to(root)), path.read_text()
        if path.name != "__init__.py":
            house.files[name] = text.count("\n")
            house.folders[str(path.parent.relative_to(root))] += 1
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = _own_lines(node)
                kind = house.kernels if _on_device(node) else house.functions
                kind[f"{name}:{node.lineno} {node.name}"] = lines
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                house.classes[node.name].append(f"{name}:{node.lineno}")
    return house


def _on_device(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    words = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
    return "kernel" in words or "wp.func" in words


def _own_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Without the functions in it: a factory of a kernel is as long as what it adds."""
    own = set(range(node.lineno, (node.end_lineno or 0) + 1))
    for inner in ast.walk(node):
        if isinstance(inner, ast.FunctionDef) and inner is not node:
            own -= set(range(inner.lineno, (inner.end_lineno or 0) + 1))
    return len(own)


def at_share(values: list[int], share: float) -> int:
    """The value below which ``share`` of them lie."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


def lines(house: House) -> list[tuple[str, str, str, bool]]:
    """Figure, what it is now, its limit, and whether it keeps it."""
    files, functions = list(house.files.values()), list(house.functions.values())
    folder, modules = house.folders.most_common(1)[0]
    twice = {name: places for name, places in house.classes.items() if len(places) > 1}
    numbers = [
        ("file lines, median", at_share(files, 0.5), FILE_LINES[0], ""),
        ("file lines, 90 % below", at_share(files, 0.9), FILE_LINES[1], ""),
        ("file lines, longest", *_longest(house.files, FILE_LINES[2])),
        ("function lines, 90 % below", at_share(functions, 0.9), FUNCTION_LINES[0], ""),
        ("function lines, longest", *_longest(house.functions, FUNCTION_LINES[1])),
        ("kernel lines, longest", *_longest(house.kernels, KERNEL_LINES)),
        ("modules in a folder, most", modules, FOLDER_MODULES, folder),
        ("public class names that occur twice", len(twice), 0, _shown(twice)),
    ]
    return [
        (what, f"{value} {where}".strip(), str(limit), value <= limit)
        for what, value, limit, where in numbers
    ]


def _longest(sizes: dict[str, int], limit: int) -> tuple[int, int, str]:
    beyond = sorted((size, name) for name, size in sizes.items() if size > limit)[::-1]
    size, name = beyond[0] if beyond else max((size, name) for name, size in sizes.items())
    more = f" and {len(beyond) - 1} more beyond it" if len(beyond) > 1 else ""
    return size, limit, f"({name}{more})"


def _shown(twice: dict[str, list[str]]) -> str:
    return "; ".join(f"{name}: {', '.join(places)}" for name, places in sorted(twice.items())[:5])


def main() -> int:
    """Print the table."""
    rows = lines(look())
    for what, now, limit, kept in rows:
        print(f"{'ok  ' if kept else 'MISS'} {what}: {now}, at most {limit}")
    return 0 if all(kept for *_, kept in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
