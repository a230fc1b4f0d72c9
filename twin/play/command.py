"""``twin play``: scenario files without a stack."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError, storage_error

if TYPE_CHECKING:
    from twin.play.report import NamedPlay

CsvOption = Annotated[
    Path | None,
    typer.Option(help="Write poses to this CSV file; of several permutations to this folder."),
]
SaveOption = Annotated[
    Path | None,
    typer.Option(
        help="Write everything to this file for `viewer play`; of several permutations to this "
        "folder."
    ),
]
SpeedOption = Annotated[
    float | None,
    typer.Option(
        min=0.05,
        max=50.0,
        help="Then show it in a window at so many times the real speed, as `viewer play` does.",
    ),
]


def play(
    file: Annotated[Path, typer.Argument(help="A .xosc or .yaml file, or a shipped scenario.")],
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
    csv: CsvOption = None,
    save: SaveOption = None,
    speed: SpeedOption = None,
    until_s: Annotated[
        float, typer.Option(min=0.0, max=86_400.0, help="Stop then, if it still runs [s].")
    ] = 600.0,
    device: Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")] = "cpu",
    output: OutputOption = Output.human,
) -> None:
    """Play a scenario without a stack, and say what happened when.

    All actors, the ego among them, are moved by the default controller. Prints starts and ends of
    storyboard elements (of a .yaml file: events) and why it ended; of several permutations rows.

    `twin play cut-in.xosc --csv cut-in.csv` also writes where everybody was: time_s, entity, x_m,
    y_m, z_m, heading_rad, speed_mps, of entities that are there, rear axle on the ground.
    `twin play cut-in.xosc --save cut-in.play` keeps all of it for `viewer play cut-in.play`;
    `twin play cut-in.xosc --speed 1` shows it at once. Without a display: `viewer play --help`.

    Exit code 2: the file is broken or needs what is not played; a line with file and line number
    for everything. Reading needs lxml: pip install 'drivetwin[scenarios]'.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    if speed is not None and distribution is not None and permutation is None:
        raise UsageError("--speed needs --permutation: one scenario is shown at a time")
    from twin.play.permutations import play_file
    from twin.play.report import remarks, write_csv
    from twin.play.saving import save_plays
    from twin.play.showing import show_play

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
    _show(str(file), plays, step_s, output)
    told = sys.stderr if output is Output.json else sys.stdout
    if csv is not None:
        _write(csv, lambda: write_csv(csv, plays), told)
    if save is not None:
        _write(save, lambda: save_plays(save, plays, step_s), told)
    if speed is not None:
        show_play(file, plays, step_s, speed, told)


def _show(file: str, plays: Sequence[NamedPlay], step_s: float, output: Output) -> None:
    """Print what happened."""
    from rich.console import Console

    from twin.play.report import end_line, event_table, summary_table, to_json
    from twin.scenario.storyboard.native.document import is_native

    if output is Output.json:
        print(json.dumps(to_json(plays, step_s), indent=1))
    else:
        single, by_hand = len(plays) == 1, is_native(file)
        table = (
            event_table(plays[0], step_s, by_hand=by_hand)
            if single
            else summary_table(plays, step_s)
        )
        Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)
        if single:
            print(end_line(plays[0], step_s))


def _write(out: Path, write: Callable[[], list[Path]], told: TextIO) -> None:
    try:
        paths = write()
    except OSError as error:
        raise storage_error(error, str(out)) from None
    print(paths[0] if len(paths) == 1 else f"{len(paths)} files in {out}", file=told)
