"""``conductor export`` and ``compare``, and how ``conductor report`` takes logs from elsewhere."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from conductor.commands.audit_command import audit_command
from conductor.commands.certify_command import certify_command
from conductor.commands.driving_command import driving_command
from conductor.commands.fingerprint_command import fingerprint
from conductor.commands.regress_command import regress_command
from conductor.commands.verify_command import verify
from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_FAILED, UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.progress import bars
from twin.stores.opening import is_url

NOTES_MAX = 20
"""Most notes on standard error; all of an import are in its folder."""


class Format(StrEnum):
    """Layouts of an export."""

    autodrive_csv = "autodrive-csv"
    csv = "csv"


class RecordingsOf(StrEnum):
    """Cases whose recordings are fetched from a store."""

    none = "none"
    failed = "failed"
    all = "all"


FetchedRecordings = Annotated[
    RecordingsOf | None,
    typer.Option(
        help="Of a run in a store: fetch recordings of the cases that did not pass (failed), of "
        "all, or none, the default. The run must be signed."
    ),
]
"""Option of reports."""


def add_report_commands(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command("fingerprint")(fingerprint)
    app.command("verify")(verify)
    app.command("certify")(certify_command)
    app.command("audit")(audit_command)
    app.command("export")(export_command)
    app.command("compare")(compare_command)
    app.command("driving")(driving_command)
    app.command("regress")(regress_command)


def report_folder(
    folder: str | None,
    logs: Path | None,
    out: Path | None,
    recordings: RecordingsOf | None = None,
) -> Path:
    """The campaign folder to report on; logs are imported into one first, and of a run in a store
    what a report reads is fetched, with ``recordings`` (None: as nothing was said).

    Raises:
        UsageError: not exactly one of ``folder`` and ``logs``, ``out`` without logs, no logs, or
            ``recordings`` of no store.
        InfrastructureError: the disk lets us down.
    """
    from conductor.report.autodrive.importing import import_autodrive

    if (folder is None) == (logs is None):
        raise UsageError(
            "report: give either a campaign folder, e.g. runs/aeb-demo, or --import-autodrive DIR"
        )
    if recordings is not None and not (folder and is_url(folder)):
        raise UsageError(
            "report: --recordings belongs to a run in a store, e.g. s3://bucket/night; a campaign "
            "folder has its recordings"
        )
    if logs is None:
        assert folder is not None
        if is_url(folder):
            from conductor.stored.fetching import fetch_run

            hint = "" if recordings else "--recordings failed, or all, fetches them"
            return fetch_run(folder, out, (recordings or RecordingsOf.none).value, hint=hint)
        if out is not None:
            raise UsageError(
                "report: --out belongs to --import-autodrive and to stores; the report of a "
                "campaign is written into its folder"
            )
        return Path(folder)
    out = out or Path("runs") / f"imported-{logs.absolute().name}"
    with bars():
        imported = import_autodrive(logs, out)
    _tell(imported.left_out, f"all are in {out}/imported.json")
    return out


def export_command(
    folder: Annotated[Path, typer.Argument(help="Campaign folder, e.g. runs/aeb-256.")],
    out: Annotated[Path, typer.Option(help="Folder to write; must be empty or new.")],
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            help="autodrive-csv: logs of the AutoDRIVE study; csv: KPI rows of each case and a "
            "summary, of any scenario.",
        ),
    ] = Format.autodrive_csv,
    output: OutputOption = Output.human,
) -> None:
    """Write a campaign's cases in the layout of other tools, so that their notebooks read them."""
    from conductor.report.autodrive.export import export_autodrive
    from conductor.report.pages.csv_export import export_csv

    with bars():
        if format_ is Format.csv:
            files, notes, last = export_csv(folder, out), list[str](), "a summary"
        else:
            exported = export_autodrive(folder, out)
            files, notes, last = exported.files, exported.notes, "config.json"
    if output is Output.json:
        print(json.dumps({"files": [str(path) for path in files], "notes": notes}))
    else:
        print(f"{out}: {counted(len(files) - 1, 'log')} and {last}")
    _tell(notes, "--output json lists all")


def compare_command(
    before: Annotated[Path, typer.Argument(metavar="RUN_A", help="Campaign folder before.")],
    after: Annotated[Path, typer.Argument(metavar="RUN_B", help="Campaign folder after.")],
    html: Annotated[Path | None, typer.Option(help="Write a page, .html.")] = None,
    markdown: Annotated[
        Path | None, typer.Option(help="Write Markdown, .md, e.g. for a pull request.")
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Say what changed between two runs of the same cases; exit code 1 on a regression.

    A regression is a case whose verdict has become worse: best is `pass` or `avoided`, then comes
    a verdict without a collision, such as false braking, then `mitigated`, then a collision,
    `fail`, `not_mitigated`, `inconclusive` or no verdict. Cases that are in one run only are listed
    and do not count.
    """
    from conductor.report.compare.folders import compare_folders
    from conductor.report.compare.page import as_html, as_json, as_markdown
    from conductor.report.compare.text import print_comparison

    for path, suffix in ((html, ".html"), (markdown, ".md")):
        if path is not None and (path.suffix.lower() != suffix or path.is_dir()):
            raise UsageError(f"{path}: expected the name of a file that ends in {suffix}")
    with bars():
        comparison = compare_folders(before, after)
    for path, render in ((html, as_html), (markdown, as_markdown)):
        if path is not None:
            _write(path, render(comparison))
    if output is Output.json:
        print(json.dumps(as_json(comparison), allow_nan=False))
    else:
        print_comparison(comparison)
    if comparison.regressions:
        raise typer.Exit(EXIT_FAILED)


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.encode())
    except OSError as error:
        raise storage_error(error, str(path)) from None


def _tell(notes: list[str], more: str) -> None:
    for note in notes[:NOTES_MAX]:
        print(f"conductor: {note}", file=sys.stderr)
    if len(notes) > NOTES_MAX:
        print(f"conductor: and {len(notes) - NOTES_MAX} more; {more}", file=sys.stderr)
