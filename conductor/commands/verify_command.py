"""``conductor verify``: is a finished run what it was when it was signed?"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_INFRASTRUCTURE, EXIT_PASS, UsageError
from twin.base.progress import bars

if TYPE_CHECKING:
    from conductor.trust.verify import Verified

SHOWN_MAX = 50
"""Differences that are told to people."""


def verify(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Campaign folder of a run.")],
    deep: Annotated[
        bool,
        typer.Option("--deep", help="Also compute KPI digests, fingerprint and verdicts again."),
    ] = False,
    public_key: Annotated[
        list[str] | None,
        typer.Option(
            help="Who may have signed it: 64 hexadecimal digits or a file of them; repeatable. "
            "Default: your own key, and those in your list of trusted keys."
        ),
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Check a finished run against its signed manifest, offline: signature, every file, and the
    journal's chain.

    Exit code 3: it is not as it was signed, or not signed; a line per difference says in what.
    """
    from conductor.trust.signing import parse_key, trusted_keys
    from conductor.trust.verify import verify_run

    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; give that of a run, e.g. runs/aeb-demo")
    trusted = frozenset(map(parse_key, public_key)) if public_key else trusted_keys()
    with bars() as told:
        verified = verify_run(folder, trusted, deep=deep, told=told)
    _print_json(verified) if output is Output.json else _print(verified)
    raise typer.Exit(EXIT_INFRASTRUCTURE if verified.differences else EXIT_PASS)


def _print_json(verified: Verified) -> None:
    manifest = verified.manifest
    shown = {
        "fits": not verified.differences,
        "differences": verified.differences,
        "notes": verified.notes,
        "key": manifest.key if manifest else None,
        "fingerprint": manifest.fingerprint if manifest else None,
        "files": verified.files,
        "wall_s": round(verified.wall_s, 3),
        "attempts": verified.attempts,
        "attempts_per_s": round(verified.rate, 1),
    }
    print(json.dumps(shown))


def _print(verified: Verified) -> None:
    for line in verified.differences[:SHOWN_MAX]:
        print(line)
    if len(verified.differences) > SHOWN_MAX:
        print(f"and {len(verified.differences) - SHOWN_MAX} more; --output json lists all")
    for note in verified.notes:
        print(f"note: {note}", file=sys.stderr)
    if verified.manifest is not None:
        print(
            f"{'differs' if verified.differences else 'fits'}: {counted(verified.files, 'file')} "
            f"in {verified.wall_s:.1f} s, signed by key {verified.manifest.key}"
        )
    if verified.attempts:
        print(f"deep: {counted(verified.attempts, 'attempt')}, {verified.rate:.0f} per second")
