"""Rules of the tests themselves, read from their syntax trees."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROOT = TESTS.parent

PRIVATE_ALLOWED = 48
"""Test functions that may touch private attributes of what they test. It may only shrink."""


@dataclass(slots=True)
class Module:
    """One file below ``tests``."""

    path: Path
    functions: dict[str, list[ast.FunctionDef]] = field(default_factory=dict)
    """Functions and methods by name, nested ones included."""
    helpers: list[str] = field(default_factory=list)
    """Modules of the tests that it imports from."""
    private: set[str] = field(default_factory=set)
    """Attributes with an underscore that the file itself defines."""

    @property
    def tests(self) -> list[ast.FunctionDef]:
        """The functions that pytest collects from here."""
        if not self.path.name.startswith("test_"):
            return []
        names = [name for name in self.functions if name.startswith("test_")]
        return [function for name in names for function in self.functions[name]]


@cache
def modules() -> dict[str, Module]:
    """Every file below ``tests`` by the name under which others import it."""
    parsed = {}
    for path in sorted(TESTS.rglob("*.py")):
        module = Module(path)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                module.functions.setdefault(node.name, []).append(node)
                module.private.add(node.name)
            elif isinstance(node, ast.ImportFrom) and node.module:
                module.helpers += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
            elif isinstance(node, ast.Import):
                module.helpers += [alias.name for alias in node.names]
            elif isinstance(node, ast.Attribute) and _is_self(node) and _is_store(node):
                module.private.add(node.attr)
        name = ".".join(path.relative_to(TESTS).with_suffix("").parts)
        parsed[name] = module
        # A test's own folder is on the path, as is that of the tests.
        parsed.setdefault(path.stem, module)
    return parsed


def _is_self(node: ast.Attribute) -> bool:
    return isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")


def _is_store(node: ast.Attribute) -> bool:
    return isinstance(node.ctx, ast.Store)


def can_fail(module: Module, function: ast.FunctionDef, seen: frozenset[str] = frozenset()) -> bool:
    """Whether ``function`` asserts something, itself or through a named helper of the tests."""
    called = set()
    for node in ast.walk(function):
        # A test that raises fakes a fault; a helper that raises has found one.
        if isinstance(node, ast.Assert) or (seen and isinstance(node, ast.Raise)):
            return True
        name = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", None)
        if name in ("raises", "warns", "fail") or (name or "").startswith("assert_"):
            return True
        called.add(name)
    known = modules()
    places = [module, *(known[name] for name in module.helpers if name in known)]
    for place in places:
        for name in sorted((called & set(place.functions)) - seen - {function.name}):
            if any(can_fail(place, f, seen | {function.name}) for f in place.functions[name]):
                return True
    return False


def private_touched(module: Module, function: ast.FunctionDef) -> Iterator[str]:
    """Attributes with one leading underscore that belong to what is tested."""
    for node in ast.walk(function):
        if isinstance(node, ast.Attribute) and not _is_self(node):
            name = node.attr
            if name.startswith("_") and not name.startswith("__") and name not in module.private:
                yield name


def named(module: Module, function: ast.FunctionDef) -> str:
    return f"{module.path.relative_to(ROOT)}::{function.name}"


def test_files_of_tests_have_names_of_their_own():
    """Pytest imports them by that name alone: of two it collects one."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []


def test_every_test_asserts_something() -> None:
    idle = [
        named(module, function)
        for module in {id(m): m for m in modules().values()}.values()
        for function in module.tests
        if not can_fail(module, function)
    ]
    assert idle == [], "assert what must hold, or expect an error with pytest.raises"


def test_private_attributes_are_touched_by_ever_fewer_tests() -> None:
    touching = [
        f"{named(module, function)}: {', '.join(sorted(names))}"
        for module in {id(m): m for m in modules().values()}.values()
        for function in module.tests
        if (names := set(private_touched(module, function)))
    ]
    count = len(touching)
    assert count <= PRIVATE_ALLOWED, "use a public way:\n" + "\n".join(touching)
    assert count == PRIVATE_ALLOWED, f"{count} are left: lower PRIVATE_ALLOWED to that"
