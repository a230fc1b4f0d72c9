"""A comparison on a terminal."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table
from rich.text import Text

from conductor.report.compare.comparison import Comparison
from conductor.report.compare.page import told

ROWS_MAX = 50
"""Most rows of a table; the page and the JSON output have more."""
_PIPE_WIDTH = 160
_STYLES = {"regression": "bold red", "identical": "bold green", "no regression": "bold green"}


def print_comparison(found: Comparison) -> None:
    """Print it to standard output; in a pipe without colours and cut lines."""
    console = Console(file=sys.stdout, highlight=False, soft_wrap=True, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = _PIPE_WIDTH
    words = told(found)
    console.print(Text(_plain(words.result), style=_STYLES[words.kind]))
    for line in words.lines:
        console.print(_plain(line))
    for shown in words.tables:
        table = Table(box=None, padding=(0, 2, 0, 0), title=shown.title, title_justify="left")
        for index, column in enumerate(shown.columns):
            right = "right" if index >= shown.numeric else "left"
            table.add_column(column, justify=right, overflow="fold")  # type: ignore[arg-type]
        for row in shown.rows[:ROWS_MAX]:
            table.add_row(*(Text(_plain(cell)) for cell in row))
        console.print()
        console.print(table, soft_wrap=False)
        if len(shown.rows) > ROWS_MAX:
            console.print(f"and {len(shown.rows) - ROWS_MAX} more, see --output json")


def _plain(text: str) -> str:
    """Text without what a terminal would take for a command."""
    return "".join(char if char.isprintable() else "?" for char in text)
