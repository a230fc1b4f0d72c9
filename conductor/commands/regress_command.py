"""``conductor regress``: failures that were found become cases of a regression campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schemas.words import counted


def regress_command(
    folder: Annotated[Path, typer.Argument(help="Campaign folder, e.g. runs/rain.")],
    into: Annotated[Path, typer.Option(help="Campaign file to write, or to add the cases to.")],
    case: Annotated[
        list[str] | None,
        typer.Option(help="A case; may be repeated. Without it, the mildest of each cluster."),
    ] = None,
) -> None:
    """Add failures of a run to a campaign file, each with the values and the random numbers it had:
    the same stack comes to the same KPIs.

    Without --case, the mildest failure of each cluster that the run's search has found.
    """
    from conductor.run.regression import regress

    added = regress(folder, case or [], into)
    print(f"{into}: {counted(len(added), 'case')} added; run it with: conductor run {into}")
