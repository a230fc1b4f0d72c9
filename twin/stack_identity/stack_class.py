"""Whether a stack class can be built, read from its source: nothing of it is imported or run.

What the syntax does not tell (a base class of a library, a class that a function makes) counts as
right; the process that loads the stack says what is wrong with it then.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from pathlib import Path

from schemas.files.regular_file import read_regular
from schemas.validation import Mistake, suggest
from twin.stack_identity.imports import SOURCE_BYTES_MAX, locate

BY_CAMERA = "drives_by_camera"
"""Attribute of a class, True: it cannot drive where ``render`` is false."""
PORTABLE = "portable"
"""Attribute of a class, True, not inherited: it computes the same on every machine."""
CHAIN_MAX = 20
"""Most modules that are looked through for a class: re-exports and bases lead from one to the
next."""


def class_mistakes(
    entry_point: str, parameters: Iterable[str], *, blind: bool = False
) -> list[Mistake]:
    """A missing module or class, parameters that the class does not take, and no camera where it
    says that it drives by one.

    Args:
        entry_point: ``module:Class``.
        parameters: names of the keyword arguments that it will get.
        blind: no camera sees anything.
    """
    module, _, name = entry_point.partition(":")
    spec = locate(module)
    if spec is None:
        missing = f"given '{entry_point}', no module '{module}'"
        return [Mistake("autonomy.stack", f"{missing}; install it or put its folder on PYTHONPATH")]
    source = _Source.of(spec)
    if source is None:
        return []
    stack_class = _find(source, name)
    if stack_class is None:
        classes = [known for known in source.classes() if not known.startswith("_")]
        hint = suggest(name, classes) if classes else "it defines none"
        missing = f"given '{entry_point}', no class '{name}' in module '{module}'; {hint}"
        return [Mistake("autonomy.stack", missing)]
    mistakes = []
    if blind and _says(stack_class, BY_CAMERA):
        told = f"stack {entry_point} drives by a camera, and none sees; name another"
        mistakes.append(Mistake("render", told))
    allowed = _parameters(stack_class)
    if allowed is None:
        return mistakes
    unknown = f"unknown parameter of {entry_point}"
    return mistakes + [
        Mistake(
            f"autonomy.parameters.{parameter}",
            f"{unknown}; {suggest(parameter, allowed) if allowed else 'it takes none'}",
        )
        for parameter in parameters
        if parameter not in allowed
    ]


def says_portable(entry_point: str) -> bool:
    """Whether a stack class says in its own body that it computes the same on every machine.

    What a base says does not count, nor what the syntax does not tell: a class that adds a network
    to a portable one is none.

    Args:
        entry_point: ``module:Class``.
    """
    module, _, name = entry_point.partition(":")
    spec = locate(module)
    source = None if spec is None else _Source.of(spec)
    found = None if source is None else _find(source, name)
    said = [] if found is None or found.node is None else _said(found.node, PORTABLE)
    return bool(said) and said[-1] is True


@dataclass(frozen=True, slots=True)
class _Source:
    """A module's syntax."""

    module: str
    is_package: bool
    tree: ast.Module

    @classmethod
    def of(cls, spec: ModuleSpec) -> _Source | None:
        """Source of a module; None: it is no Python, or has mistakes that its import will tell."""
        if spec.origin is None or not spec.origin.endswith(".py"):
            return None
        try:
            tree = ast.parse(read_regular(Path(spec.origin), SOURCE_BYTES_MAX))
        except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
            return None
        return cls(spec.name, spec.submodule_search_locations is not None, tree)

    def statements(self) -> Iterator[ast.stmt]:
        """Statements of the module itself, also inside ``if`` and ``try``."""
        waiting: list[ast.AST] = list(reversed(self.tree.body))
        while waiting:
            node = waiting.pop()
            if isinstance(node, ast.stmt):
                yield node
            if isinstance(node, ast.If | ast.Try | ast.With | ast.ExceptHandler):
                waiting += reversed(list(ast.iter_child_nodes(node)))

    def classes(self) -> list[str]:
        """Names of the classes that it defines."""
        return [node.name for node in self.statements() if isinstance(node, ast.ClassDef)]

    def imported_from(self, node: ast.ImportFrom) -> _Source | None:
        """The module that ``from ... import`` names; None: it cannot be read."""
        name = node.module or ""
        if node.level:
            package = self.module if self.is_package else self.module.rpartition(".")[0]
            parents = package.split(".")
            parents = parents[: len(parents) - (node.level - 1)]
            name = ".".join([*parents, name] if name else parents)
        spec = locate(name) if name else None
        return None if spec is None else _Source.of(spec)


@dataclass(frozen=True, slots=True)
class _Class:
    """A class, and where it stands; ``node`` None: the syntax does not tell what it is."""

    source: _Source
    node: ast.ClassDef | None


def _find(source: _Source, name: str, left: int = CHAIN_MAX) -> _Class | None:
    """What ``name`` is in a module; None: nothing."""
    definition: _Class | None = None
    for node in source.statements():
        match node:
            case ast.ClassDef() if node.name == name:
                definition = _Class(source, node)
            case ast.ImportFrom():
                for alias in node.names:
                    if alias.name == "*":
                        definition = definition or _Class(source, None)
                    elif (alias.asname or alias.name) == name:
                        origin = source.imported_from(node) if left else None
                        known = origin and _find(origin, alias.name, left - 1)
                        definition = known or _Class(source, None)
            case ast.FunctionDef() if node.name == "__getattr__":
                definition = definition or _Class(source, None)
            case _ if name in _bound(node):
                definition = _Class(source, None)
    return definition


def _bound(node: ast.stmt) -> set[str]:
    """Names that a statement binds otherwise: assignments, functions, imports."""
    if isinstance(node, ast.Import):
        return {alias.asname or alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.FunctionDef):
        return {node.name}
    if not isinstance(node, ast.Assign | ast.AnnAssign | ast.For | ast.With):
        return set()
    return {
        part.id
        for part in ast.walk(node)
        if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
    }


def _parameters(of: _Class, left: int = CHAIN_MAX) -> list[str] | None:
    """Names of the parameters that a class takes beside ``slots``; None: the syntax does not tell.

    The first ``__init__`` along the bases counts. Decorators and metaclasses may add another one.
    """
    node = of.node
    if node is None or node.decorator_list or node.keywords or not left:
        return None
    for statement in node.body:
        if isinstance(statement, ast.FunctionDef) and statement.name == "__init__":
            taken, listed = _taken(statement), _listed(of)
            return taken if listed is None else [*(taken or []), *listed]
    if any(part in ("__new__", "__init__") for part in _names_in(node)) or len(node.bases) != 1:
        return None
    parent = _base(of)
    return None if parent is None else _parameters(parent, left - 1)


def _base(of: _Class) -> _Class | None:
    """The only base of a class; None: it has none or several, or the syntax does not tell."""
    match of.node:
        case ast.ClassDef(bases=[ast.Name(id=name)]):
            return _find(of.source, name)
    return None


def _says(of: _Class, name: str, left: int = CHAIN_MAX) -> bool:
    """Whether a class, or the first of its bases that says anything of it, says ``name = True``."""
    if of.node is not None and (said := _said(of.node, name)):
        return said[-1] is True
    parent = _base(of) if left else None
    return parent is not None and _says(parent, name, left - 1)


def _said(node: ast.ClassDef, name: str) -> list[object]:
    """What the body of a class assigns to ``name``, in its order; None: it is no constant."""
    return [
        part.value.value if isinstance(part.value, ast.Constant) else None
        for part in node.body
        if isinstance(part, ast.Assign | ast.AnnAssign) and name in _bound(part)
    ]


def _listed(of: _Class) -> list[str] | None:
    """Fields of the structs in a class's ``PARAMETERS``; None: it has none, or the syntax does not
    tell."""
    assert of.node is not None
    for statement in of.node.body:
        match statement:
            case ast.Assign(targets=[ast.Name(id="PARAMETERS")], value=ast.Tuple(elts=parts)):
                definitions = [
                    _find(of.source, part.id) for part in parts if isinstance(part, ast.Name)
                ]
                nodes = [
                    definition.node
                    for definition in definitions
                    if definition is not None and definition.node is not None
                ]
                if len(nodes) < len(parts) or any(len(node.bases) != 1 for node in nodes):
                    return None
                return [name for node in nodes for name in _fields(node)]
    return None


def _fields(node: ast.ClassDef) -> list[str]:
    """Names with a type in the body of a struct."""
    return [
        part.target.id
        for part in node.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    ]


def _names_in(node: ast.ClassDef) -> set[str]:
    """Names that the body of a class binds."""
    functions = {part.name for part in node.body if isinstance(part, ast.FunctionDef)}
    return functions.union(*(_bound(part) for part in node.body))


def _taken(init: ast.FunctionDef) -> list[str] | None:
    """Keyword arguments of an ``__init__`` after ``self`` and ``slots``; None: any."""
    arguments = init.args
    if arguments.kwarg is not None or init.decorator_list:
        return None
    plain = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args)][1:]
    return [name for name in (*plain, *(a.arg for a in arguments.kwonlyargs)) if name != "slots"]
