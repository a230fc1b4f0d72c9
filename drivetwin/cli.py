"""The ``drivetwin`` command: which commands there are, and where to begin."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load

# isort: split
import importlib
import json

import typer

from twin.base.cli import EXIT_CODES, Output, OutputOption, make_app, version_option
from twin.base.command import run

COMMANDS = ("conductor", "twin", "devkit", "viewer", "hpc")
"""Packages with a command of their name, in the order in which a new user meets them."""

HELP = (
    "Lists the commands of the project. `conductor run aeb-demo` is the first to try; "
    "`conductor doctor` says whether this machine is ready."
)

app = make_app("drivetwin", HELP)


@app.callback(invoke_without_command=True, no_args_is_help=False, help=HELP, epilog=EXIT_CODES)
def listing(
    output: OutputOption = Output.human,
    version: bool = version_option(),  # noqa: ARG001 - its callback prints it
) -> None:
    """List the commands, with a line each."""
    lines = {name: line_of(name) for name in COMMANDS}
    if output is Output.json:
        print(json.dumps(lines))
        return
    for name, line in lines.items():
        print(f"{name:10} {line}")
    print("\n`COMMAND --help` explains one; `conductor doctor` says whether this machine is ready.")


def line_of(name: str) -> str:
    """First sentence of a command's help."""
    group: typer.Typer = importlib.import_module(f"{name}.cli").app
    return str(group.info.help).partition(". ")[0].rstrip(".") + "."


def main() -> None:
    """Entry point."""
    run(app, "drivetwin")
