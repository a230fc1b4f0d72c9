"""The command ``devkit replay``."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from devkit.checking.command import parsed_parameters
from twin.base.cli import Output, OutputOption, duration
from twin.base.errors import EXIT_FAILED, EXIT_PASS, UsageError

if TYPE_CHECKING:
    from devkit.replaying.replay import Replayed, StackChoice


RunCommand = Annotated[
    bool,
    typer.Option(
        "--run-command",
        help="Run the command that a record holds; without it, such a record is refused.",
    ),
]
Tolerance = Annotated[
    list[str] | None,
    typer.Option(
        help="FIELD=NUMBER: a smaller difference is none; throttle, brake, steering_rad, "
        "handbrake, detections (in pixels), pose (in metres). Default: exact. Repeatable."
    ),
]


def replay(
    run: Annotated[
        Path, typer.Argument(help="Campaign folder, the folder of an attempt, or its drive.record.")
    ],
    cases: Annotated[
        list[str] | None, typer.Argument(metavar="CASE", help="Default: all with a record.")
    ] = None,
    stack: Annotated[
        str,
        typer.Option(
            help="module:Class, a command line in quotes, or a campaign file; default: the stack "
            "that was recorded."
        ),
    ] = "",
    parameters: Annotated[
        str,
        typer.Option(help="Stack parameters as JSON; of the recorded stack, those that change."),
    ] = "{}",
    tolerance: Tolerance = None,
    attempt: Annotated[
        int | None, typer.Option(min=1, help="Number of the attempt; default: the last recorded.")
    ] = None,
    device: Annotated[
        str, typer.Option(help="Where its networks compute, cpu or cuda:N; default: as recorded.")
    ] = "",
    run_command: RunCommand = False,
    plots: Annotated[
        Path | None, typer.Option(help="Folder for a picture per case, CASE.png.")
    ] = None,
    deadline_s: Annotated[
        float, duration("Longest time for an answer, start-up included [s].", least=0.1)
    ] = 60.0,
    output: OutputOption = Output.human,
) -> None:
    """Show a stack what was recorded and compare its commands; exits 1 if they differ.

    Without a simulator: the frames of the attempts come byte for byte from their records, which
    campaigns with `recording: {drive: all}` leave.
    """
    from devkit.replaying.compare import parse_tolerances
    from devkit.replaying.replay import find_records
    from devkit.replaying.replay import replay as run_replay

    asked = _asked(stack, parsed_parameters(parameters), device, deadline_s)
    asked = replace(asked, run_command=run_command)
    tolerances = parse_tolerances(tolerance or [])
    paths = find_records(run, cases or [], attempt)

    def report(one: Replayed) -> None:
        if output is Output.human:
            _print(one)
        if plots is not None:
            from devkit.replaying.plot import write_plot

            write_plot(one, plots / f"{one.head.case.id}.png")

    done, damaged = run_replay(paths, asked, tolerances, report)
    equal = sum(one.equal for one in done)
    if output is Output.json:
        result = {"equal": equal == len(paths), "cases": [_plain(one) for one in done]}
        print(json.dumps({**result, "damaged": damaged}, indent=1))
    elif done:
        print(f"{equal} of {len(paths)} equal")
    if damaged:
        raise UsageError("\n".join(damaged))
    raise typer.Exit(EXIT_PASS if equal == len(done) else EXIT_FAILED)


def _asked(stack: str, parameters: dict[str, Any], device: str, timeout_s: float) -> StackChoice:
    from devkit.checking.check import names_file, plan_of
    from devkit.replaying.replay import StackChoice

    plan = plan_of(stack, parameters) if stack else None
    variants = plan.campaign.autonomy.perception if plan and names_file(stack) else {}
    return StackChoice(plan.cases[0].rig if plan else None, variants, parameters, device, timeout_s)


def _print(one: Replayed) -> None:
    ticks = len(one.pairs)
    verdict = "equal" if one.equal else "differs"
    rate = f"{ticks / one.wall_s:.0f} ticks/s" if one.wall_s > 0 else ""
    head = f"{one.head.case.id}, attempt {one.head.attempt}"
    print(f"{head}: {verdict}, {ticks} ticks, {rate}", flush=True)
    if any(row.largest for row in one.rows):
        columns = f"{'ticks':>7}{'differ':>8}{'first tick':>12}{'largest':>12}{'allowed':>9}"
        print(f"  {'field':<13}{columns}")
        for row in one.rows:
            first = "-" if row.first_tick < 0 else str(row.first_tick)
            largest = "other" if math.isinf(row.largest) else f"{row.largest:.6g}"
            print(
                f"  {row.field:<13}{row.ticks:>7}{row.differ:>8}{first:>12}{largest:>12}"
                f"{row.tolerance:>9g}"
            )
    for note in one.notes:
        print(f"  {note}")
    if one.ended:
        print(f"  {one.ended}")


def _plain(one: Replayed) -> dict[str, Any]:
    return {
        "case": one.head.case.id,
        "attempt": one.head.attempt,
        "equal": one.equal,
        "ticks": len(one.pairs),
        "wall_s": round(one.wall_s, 3),
        "fields": [
            {
                "field": row.field,
                "tolerance": row.tolerance,
                "ticks": row.ticks,
                "differ": row.differ,
                # JSON has no infinity: no number says how far apart they are.
                "largest": None if math.isinf(row.largest) else row.largest,
                "first_tick": row.first_tick,
            }
            for row in one.rows
        ],
        "notes": one.notes,
        "ended": one.ended,
    }
