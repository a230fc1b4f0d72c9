"""``twin driving``: the files of a part of free driving."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError

PARTS = 10
"""Parts of 100 km each."""


def driving(
    part: Annotated[int, typer.Option(min=1, max=PARTS, help="Which part, 1 to 10.")],
    commit: Annotated[str, typer.Option(help="Commit that froze the stack, 40 digits.")],
    out: Annotated[Path, typer.Option(help="Folder of all parts.")] = Path("runs/driving"),
    output: OutputOption = Output.human,
) -> None:
    """Write roads, scenarios and the campaign of 100 km of free driving, with seeds by the commit.

    `make driving PART=3` writes, runs and reports a part.
    """
    if not re.fullmatch("[0-9a-f]{40}", commit):
        raise UsageError(
            f"--commit: given '{commit[:60]}', expected 40 hexadecimal digits, as `git log -1 "
            "--format=%H -- devkit/fusion` prints them"
        )
    from twin.scenario.free_driving.ledger import make_part

    folder = make_part(out, commit, part)
    print(json.dumps({"folder": str(folder)}) if output is Output.json else str(folder))
