"""What a formula is made of, and how tall it may grow."""

from __future__ import annotations

from dataclasses import dataclass

DEPTH_MAX = 40
"""Most operators inside each other."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A number."""

    value: float


@dataclass(frozen=True, slots=True)
class Column:
    """A KPI column, in the unit of its name."""

    name: str


@dataclass(frozen=True, slots=True)
class Unary:
    """``abs`` or ``negative`` of a number."""

    operator: str
    part: Node


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """``+``, ``-``, ``*`` or ``/`` of two numbers."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class AtLeast:
    """A condition: ``large`` is above ``small``, and by how much."""

    large: Node
    small: Node


@dataclass(frozen=True, slots=True)
class Not:
    """The opposite of a condition."""

    part: Node


@dataclass(frozen=True, slots=True)
class Both:
    """``and`` of two conditions, or, by ``either``, their ``or``."""

    left: Node
    right: Node
    either: bool


@dataclass(frozen=True, slots=True)
class Over:
    """``always`` of a condition, or, by ``once``, ``eventually``."""

    part: Node
    once: bool
    begin_ns: int
    """First moment that counts, from the row on [ns]."""
    end_ns: int | None
    """Last one; None: the end of the case."""


@dataclass(frozen=True, slots=True)
class Until:
    """``holds`` is true up to a moment at which ``then`` is."""

    holds: Node
    then: Node
    begin_ns: int
    end_ns: int | None


Node = Constant | Column | Unary | Arithmetic | AtLeast | Not | Both | Over | Until
NUMBERS = (Constant, Column, Unary, Arithmetic)
"""Nodes that are numbers; all others are conditions."""


def parts_of(node: Node) -> tuple[Node, ...]:
    """The nodes right below a node."""
    match node:
        case Constant() | Column():
            return ()
        case Unary() | Not() | Over():
            return (node.part,)
        case AtLeast():
            return (node.large, node.small)
        case Until():
            return (node.holds, node.then)
        case _:
            return (node.left, node.right)


def columns_of(node: Node) -> list[str]:
    """Names of the columns of a formula, each once, from left to right."""
    names: dict[str, None] = {}
    left = [node]
    while left:
        latest = left.pop()
        if isinstance(latest, Column):
            names[latest.name] = None
        left += reversed(parts_of(latest))
    return list(names)
