"""Statements of a syntax tree, without the expressions in them: rules that ask for imports and
definitions alone look at a tenth of the nodes."""

from __future__ import annotations

import ast
from collections.abc import Iterator

_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Every statement below a node, at any depth, with handlers and cases in which some lie."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        for block in _BLOCKS:
            inner = getattr(node, block, None)
            if isinstance(inner, list):
                yield from inner
                waiting += inner
