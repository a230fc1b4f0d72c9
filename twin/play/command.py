"""``twin play``: scenario files without a stack."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError, storage_error


def play(
    file: Annotated[Path, typer.Argument(help="An OpenSCENARIO XML file (.xosc), 1.0 to 1.3.")],
    distribution: Annotated[
        Path | None, typer.Option(help="A parameter distribution file that varies it.")
    ] = None,
    permutation: Annotated[
        int | None,
        typer.Option(min=0, help="Play this permutation of the distribution only, from 0."),
    ] = None,
    step_s: Annotated[
        float, typer.Option(min=0.0001, max=0.1, help="Step of the storyboard [s].")
    ] = 0.01,
    every: Annotated[
        int, typer.Option(min=1, help="Poses are written after every so many steps.")
    ] = 5,
    csv: Annotated[
        Path | None,
        typer.Option(help="Write poses to this CSV file; of several permutations to this folder."),
    ] = None,
    until_s: Annotated[
        float, typer.Option(min=0.0, max=86_400.0, help="Stop then, if it still runs [s].")
    ] = 600.0,
    device: Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")] = "cpu",
    output: OutputOption = Output.human,
) -> None:
    """Play an OpenSCENARIO XML file without a stack, and say what happened when.

    All actors, the ego among them, are moved by the default controller. Prints starts and ends of
    all storyboard elements; of several permutations a row for each.

    `twin play cut-in.xosc --csv cut-in.csv` also writes where everybody was: time_s, entity, x_m,
    y_m, z_m, heading_rad, speed_mps, of entities that are there, rear axle on the ground.

    Exit code 2: the file is broken or needs what is not played; a line with file and line number
    for everything. Reading needs lxml: pip install 'drivetwin[scenarios]'.
    """
    from rich.console import Console

    from twin.play.permutations import play_file
    from twin.play.report import event_table, remarks, summary_table, to_json, write_csv

    try:
        plays = play_file(
            file,
            distribution,
            permutation,
            step_s=step_s,
            every=every,
            until_s=until_s,
            device=device,
        )
    except ValueError as error:
        raise UsageError(str(error)) from None
    for line in remarks(plays):
        print(line, file=sys.stderr)
    if output is Output.json:
        print(json.dumps(to_json(plays, step_s), indent=1))
    else:
        single = len(plays) == 1
        table = event_table(plays[0], step_s) if single else summary_table(plays, step_s)
        Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)
    if csv is not None:
        try:
            paths = write_csv(csv, plays)
        except OSError as error:
            raise storage_error(error, str(csv)) from None
        words = str(paths[0]) if len(paths) == 1 else f"{len(paths)} files in {csv}"
        print(words, file=sys.stderr if output is Output.json else sys.stdout)
