"""``twin bench all``: its options, and what it prints."""

from __future__ import annotations

import datetime
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import typer

from schemas.escape import escape
from schemas.validation import suggest
from schemas.words import counted
from twin.base.errors import UsageError
from twin.base.progress import bars
from twin.base.software import software_digest
from twin.bench.trends.benches import BENCHES, Bench, Outcome, in_a_process, measure
from twin.bench.trends.history import (
    FALL_MIN,
    HistoryRow,
    Trend,
    append_history,
    machine_of,
    read_history,
    trends,
)
from twin.bench.trends.page import write_page

LABEL_CHARS_MAX = 200
"""Longest label of a run [characters]."""


def bench_all(
    device: str,
    only: str,
    history: Path,
    page: Path,
    label: str,
    *,
    as_json: bool,
    check: bool,
    run: Callable[[Sequence[str]], Outcome | str] = in_a_process,
) -> None:
    """Measure, add to the history, draw the page, print.

    Raises:
        UsageError: an option or the history cannot be used; before anything is measured.
        typer.Exit: 1, a bench gave no figures, or with ``check`` a target fell.
    """
    benches = chosen(only)
    label = checked_label(label)
    machine = machine_of(device)
    before = read_history(history)
    at = f"{datetime.datetime.now(datetime.UTC):%Y-%m-%dT%H:%M:%SZ}"
    with bars():
        outcomes = measure(benches, device, _telling(run))
    said = {"at": at, "machine": machine, "software": software_digest()[:12], "label": label}
    rows = [
        HistoryRow(
            **said,
            target=figure.target,
            value=figure.value,
            unit=figure.unit,
            better=figure.better,
        )
        for outcome in outcomes.values()
        for figure in outcome.figures
    ]
    append_history(history, rows)
    here = trends([*before, *rows], machine)
    write_page(page, machine, here)
    measured = {row.target for row in rows}
    now = [trend for trend in here if trend.row.target in measured]
    failed = {name: each.failure for name, each in outcomes.items() if each.failure}
    print(json.dumps(as_plain(machine, now, failed), indent=1) if as_json else words(machine, now))
    print(f"twin: history {history}, page {page}", file=sys.stderr)
    for name, why in failed.items():
        print(f"twin: bench {name}: {why}", file=sys.stderr)
    fell = [trend.row.target for trend in now if trend.fell]
    if fell:
        print(f"twin: fell by {FALL_MIN:.0%} or more: {', '.join(fell)}", file=sys.stderr)
    if failed or (check and fell):
        raise typer.Exit(1)


def chosen(only: str) -> list[Bench]:
    """The benches that ``--only`` names; empty: all.

    Raises:
        UsageError: there is no such bench.
    """
    names = [bench.name for bench in BENCHES]
    wanted = [name.strip() for name in only.split(",")] if only else names
    for name in wanted:
        if name not in names:
            given = escape(name, 80)
            raise UsageError(f"--only: no bench '{given}'; {suggest(given, names)}")
    return [bench for bench in BENCHES if bench.name in wanted]


def checked_label(label: str) -> str:
    """A label that fits into one line.

    Raises:
        UsageError: it does not.
    """
    if len(label) > LABEL_CHARS_MAX or not label.isprintable():
        raise UsageError(
            f"--label: {counted(len(label), 'character')} given, allowed are {LABEL_CHARS_MAX} "
            "that can be printed"
        )
    return label


def as_plain(machine: str, now: Sequence[Trend], failed: dict[str, str]) -> dict[str, Any]:
    """The result for ``--output json``."""
    return {
        "machine": machine,
        "targets": [
            {
                **msgspec.to_builtins(trend.row),
                "median": trend.median,
                "change": trend.change,
                "earlier": len(trend.earlier),
                "fell": trend.fell,
            }
            for trend in now
        ],
        "failed": failed,
    }


def words(machine: str, now: Sequence[Trend]) -> str:
    """The result for people: a line per target."""
    lines = [machine]
    for trend in now:
        line = f"{trend.row.target:<34} {trend.row.value:>14,.4g} {trend.row.unit:<15}"
        if trend.change is not None:
            line += f" {trend.change:+7.1%} of the median of {counted(len(trend.earlier), 'run')}"
        lines.append(line + ("  FELL" if trend.fell else ""))
    return "\n".join(line.rstrip() for line in lines)


def _telling(
    run: Callable[[Sequence[str]], Outcome | str],
) -> Callable[[Sequence[str]], Outcome | str]:
    def told(command: Sequence[str]) -> Outcome | str:
        print(f"twin: {' '.join(command)}", file=sys.stderr, flush=True)
        return run(command)

    return told
