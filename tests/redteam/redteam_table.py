"""All attacks, and their table as a page shows it."""

from __future__ import annotations

import importlib

from attacks import ATTACKS, Attack, Found

MODULES = (
    *(
        "stack_rows",
        "stranger_rows",
        "member_rows",
        "route_rows",
        "console_rows",
        "run_rows",
        "input_rows",
    ),
    *("scenario_rows", "recording_rows", "certificate_rows", "ros2_rows", "store_rows"),
    "cluster_rows",
)
BEGIN, END = "<!-- redteam: begin -->", "<!-- redteam: end -->"
HEAD = ("Row", "Attack", "Who", "Rights", "Outcome", "By what")

for _module in MODULES:
    importlib.import_module(_module)  # which fills the table
ATTACKS.sort(key=lambda each: each.row)


def markdown(found: list[tuple[Attack, Found]]) -> str:
    """As a table of a Markdown page."""
    lines = [f"| {' | '.join(HEAD)} |", "|---:" + "|---" * (len(HEAD) - 1) + "|"]
    for each, came in found:
        outcome = "**open**" if came.outcome == "open" else came.outcome
        cells = (str(each.row), each.what, each.who, each.rights, outcome, came.by)
        lines.append(f"| {' | '.join(map(_cell, cells))} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
