"""``twin validate``: does what is simulated behave as it should."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.fabric.cli import Output, OutputOption
from twin.fabric.errors import UsageError

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Compare the simulator with references."
)


@app.callback()
def _root() -> None:
    """Compare the simulator with references."""


@app.command()
def vehicle(
    name: Annotated[str, typer.Argument(help="A shipped vehicle, or the path of a vehicle file.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for a page with the table and all plots.")
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Drive a vehicle through its manoeuvres: braking, accelerating, cornering, heaving.

    Every figure is compared with a closed form, a regulation, or what the vehicle's file cites.
    Exit code 1: one is out of tolerance.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    from rich.console import Console

    from twin.validate import page, table
    from twin.vehicle.vehicle_file import load_vehicle

    try:
        car = load_vehicle(name)
        checks = table.validate(car)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if output is Output.json:
        print(json.dumps(table.to_json(car, checks), indent=1))
    else:
        width = None if sys.stdout.isatty() else 140
        Console(width=width).print(table.to_table(car, checks))
    if out is not None:
        path = page.write(out, car, checks)
        print(path, file=sys.stderr if output is Output.json else sys.stdout)
    raise typer.Exit(0 if all(check.passed for check in checks) else 1)
