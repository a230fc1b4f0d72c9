"""Options of the command ``twin dataset``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

OutArgument = Annotated[
    Path, typer.Argument(help="Folder of the dataset; one that is there goes on.")
]
CountOption = Annotated[int | None, typer.Option(help="Images; default 1000.")]
SeedOption = Annotated[int | None, typer.Option(help="Decides everything; default 1.")]
SizeOption = Annotated[str | None, typer.Option(help="WIDTHxHEIGHT; default 320x192 [px].")]
FileFormatOption = Annotated[str | None, typer.Option("--format", help="jpg or png; default jpg.")]
QualityOption = Annotated[int | None, typer.Option(help="Of JPEG, 1 to 100; default 92.")]
SceneOption = Annotated[
    str | None, typer.Option(help="Its variants are the streets; default downtown.")
]
OtherSceneOption = Annotated[
    str | None, typer.Option(help="Absent from training; default crossing.")
]
VehicleOption = Annotated[
    str | None, typer.Option(help="Shipped vehicle, or a vehicle file; default opencav.")
]
CameraOption = Annotated[
    str | None, typer.Option(help="Which of its cameras; default front_right.")
]
CamerasOption = Annotated[
    int | None, typer.Option(help="How many cameras with other lenses and effects; default 8.")
]
SplitSharesOption = Annotated[
    str | None,
    typer.Option(help="Shares of train, held_out and other_scene; default 0.8,0.1,0.1."),
]
StreetsOption = Annotated[
    str | None, typer.Option(help="Streets of train, held_out, other_scene; default 6,2,1.")
]
RuleOption = Annotated[
    list[str] | None,
    typer.Option(help="A rule of what is a label, KEY=NUMBER, repeatable; docs/dataset.md."),
]
JobsOption = Annotated[
    int | None,
    typer.Option(
        min=1, max=256, help="Processes; default: cores, on a GPU at most 4. Changes no byte."
    ),
]
BatchOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=4096,
        help="Images a process renders together; default: by their size. Changes no byte.",
    ),
]
PreviewOption = Annotated[
    Path | None, typer.Option(help="Write a contact sheet with boxes, .png or .jpg.")
]
