"""The command `viewer play`, for :mod:`viewer.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import duration

File = Annotated[
    Path,
    typer.Argument(
        help="A scenario file (.xosc, .yaml), which `twin play` plays first, or what "
        "`twin play FILE --save OUT.play` wrote."
    ),
]
Save = Annotated[Path | None, typer.Option(help="Recording to write (.rrd); nothing is opened.")]
Shot = Annotated[Path | None, typer.Option(help="Picture to write (PNG); nothing is opened.")]
AtS = Annotated[
    float | None, duration("Stop there [s]; default: play, and make a picture of the first event.")
]
Size = Annotated[str, typer.Option(help="Width x height of the picture [px].")]
Speed = Annotated[
    float, typer.Option(min=0.05, max=50.0, help="Sim time per wall time of playing.")
]
Web = Annotated[bool, typer.Option("--web", help="Show it in a browser, from one loopback port.")]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Of --web: the port; 0: a free one.")]
Distribution = Annotated[
    Path | None, typer.Option(help="A parameter distribution file that varies the scenario.")
]
Permutation = Annotated[int | None, typer.Option(min=0, help="Which of its permutations, from 0.")]
UntilS = Annotated[float | None, duration("Play no longer than this [s]; default: as `twin play`.")]


def register(app: typer.Typer) -> None:
    """Add the command to the viewer's."""
    app.command()(play)


def play(
    file: File,
    save: Save = None,
    shot: Shot = None,
    at_s: AtS = None,
    size: Size = "1280x720",
    speed: Speed = 1.0,
    web: Web = False,
    port: Port = 0,
    distribution: Distribution = None,
    permutation: Permutation = None,
    until_s: UntilS = None,
) -> None:
    """Show a scenario from above as it is played without a stack: lanes, bodies, trails,
    trajectories, speeds, and a log of events and of the triggers that fired.

    `viewer play cut-in.xosc` opens a window and plays; Space pauses. Without a display:
    `viewer play cut-in.xosc --shot cut-in.png --at-s 4.5`, or `--web`, or `--save cut-in.rrd` to
    open the recording elsewhere with `rerun cut-in.rrd`.

    Exit code 2: the file is broken, needs what is not played, or ends before --at-s.
    """
    from twin.base.errors import UsageError
    from viewer.playback.shot import parse_size
    from viewer.playing.command import PlayOptions, run_play

    if distribution is not None and permutation is None:
        raise UsageError("--distribution needs --permutation: one scenario is shown at a time")
    given = (
        ("--distribution", distribution),
        ("--permutation", permutation),
        ("--until-s", until_s),
    )
    options = PlayOptions(
        file,
        save=save,
        shot=shot,
        size=parse_size(size),
        at_s=at_s,
        speed=speed,
        web=web,
        port=port,
        player=tuple(f"{name}={value}" for name, value in given if value is not None),
    )
    raise typer.Exit(run_play(options))
