"""``conductor doctor``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_INFRASTRUCTURE

PORT = 7447
"""The port that the documents use for a conductor that several hosts reach."""


def doctor_command(
    out: Annotated[Path, typer.Option(help="Where runs would be kept.")] = Path("runs"),
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port that a conductor would listen at.")
    ] = PORT,
    output: OutputOption = Output.human,
) -> None:
    """Say whether this machine is ready for campaigns, and what to do where it is not.

    Exit code 0: nothing is bad, though lines may warn; 3: a line is bad.
    """
    from dataclasses import asdict

    from conductor.doctor.judging import findings
    from conductor.doctor.look import look_at_machine

    facts = look_at_machine(out, port)
    lines = findings(facts)
    bad = [line for line in lines if line.level == "bad"]
    if output is Output.json:
        print(json.dumps({"ready": not bad, "lines": list(map(asdict, lines))}))
    else:
        for line in lines:
            print(f"{line.level:5} {line.what:13} {line.found}")
            if line.do and line.level != "ok":
                print(f"{'':19} -> {line.do}" + (f"; see {line.page}" if line.page else ""))
        print("this machine is ready" if not bad else "this machine is not ready")
    if bad:
        raise typer.Exit(EXIT_INFRASTRUCTURE)
