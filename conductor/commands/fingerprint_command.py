"""``conductor fingerprint``: what a run came to, or whether two runs are the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_FAILED, EXIT_PASS
from twin.base.progress import bars

DIFFERENCES_SHOWN_MAX = 20
"""Cases that are named for people."""

Folder = Annotated[Path, typer.Argument(help="Campaign folder, e.g. runs/aeb-demo.")]


def fingerprint(
    folder: Folder,
    other: Annotated[
        Path | None, typer.Argument(help="A second one: are the two runs the same?")
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Print the SHA-256 over all KPI values of a finished campaign; of two, say whether they are
    the same to the last bit.

    Exit code 1: they differ; the cases that do are named, with the first value.
    """
    from conductor.records.fingerprint import fingerprint as compute
    from conductor.trust.sign_run import require_fit

    for run in (folder, *([other] if other else [])):
        require_fit(run)
    if other is not None:
        raise typer.Exit(_are_same(folder, other, as_json=output is Output.json))
    with bars():
        result = compute(folder)
    if output is Output.json:
        shown = {"fingerprint": result.sha256, "cases": result.cases, "mixed": result.mixed}
        print(json.dumps({**shown, "realtime": result.realtime}))
    else:
        print(f"{result.sha256} {result.caveat}".rstrip())


def _are_same(first: Path, second: Path, *, as_json: bool) -> int:
    from conductor.records.sameness import sameness

    with bars():
        comparison = sameness(first, second)
    if as_json:
        sums = [run.sha256 for run in comparison.fingerprints]
        differences = {case.case: case.words for case in comparison.differences}
        shown = {"same": comparison.same, "fingerprints": sums, "differences": differences}
        print(json.dumps({**shown, "notes": comparison.notes}))
    elif comparison.same:
        print(
            f"the same: {comparison.fingerprints[0].sha256} "
            f"{comparison.fingerprints[0].caveat}".rstrip()
        )
    else:
        cases = max(run.cases for run in comparison.fingerprints)
        print(f"not the same: {len(comparison.differences)} of {counted(cases, 'case')}")
        for case in comparison.differences[:DIFFERENCES_SHOWN_MAX]:
            print(f"  {case.case}: {case.words}")
        if len(comparison.differences) > DIFFERENCES_SHOWN_MAX:
            print("  ...; --output json lists all")
        for note in comparison.notes:
            print(f"note: {note}")
    return EXIT_PASS if comparison.same else EXIT_FAILED
