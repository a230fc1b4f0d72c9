"""``conductor driving``: false full brakings per distance, of one campaign or of all parts."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_FAILED, EXIT_PASS, EXIT_UNFINISHED, UsageError, storage_error
from twin.base.files import write_atomic


def driving_command(
    folder: Annotated[
        Path, typer.Argument(help="Folder of all parts, or of one campaign of free driving.")
    ] = Path("runs/driving"),
    markdown: Annotated[Path | None, typer.Option(help="Write the page, .md.")] = None,
    output: OutputOption = Output.human,
) -> None:
    """Say how many false full brakings there were on how many kilometres of free driving.

    Exit code 1: more than one, or cases without a verdict; 75: cases have not ended.
    """
    from conductor.report.driving.page import FALSE_MAX, page, said
    from conductor.report.driving.series import read_series, sums

    if markdown is not None and (markdown.suffix.lower() != ".md" or markdown.is_dir()):
        raise UsageError(f"{markdown}: expected the name of a file that ends in .md")
    series = read_series(folder)
    total = sums(series.cases)
    if markdown is not None:
        try:
            markdown.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(markdown, page(series, markdown.parent).encode())
        except OSError as error:
            raise storage_error(error, str(markdown)) from None
    if output is Output.json:
        told = {**asdict(total), "left": series.left, "undecided": len(series.undecided)}
        print(json.dumps(told))
    else:
        print("\n".join([*said(series), *([str(markdown)] if markdown else [])]))
    if total.false > FALSE_MAX or series.undecided:
        raise typer.Exit(EXIT_FAILED)
    raise typer.Exit(EXIT_UNFINISHED if series.left else EXIT_PASS)
