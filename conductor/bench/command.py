"""``conductor bench``: runs the comparison and the large campaign, prints, and checks targets."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from conductor.bench.compare import AIMS, TARGETS, SchedulerComparison, compare
from conductor.bench.own import check_disk
from conductor.bench.scale import TARGETS as SCALE_TARGETS
from conductor.bench.scale import Scale, measure_scale
from twin.base.errors import EXIT_FAILED, EXIT_PASS
from twin.base.progress import bars


def bench(tasks: int, rounds: int, cases: int, folder: Path, *, as_json: bool, check: bool) -> int:
    """Measure and print; the exit code.

    Args:
        tasks: cases per run of the comparison; 0 leaves it out.
        rounds: runs of each scheduler.
        cases: cases of the large campaign; 0 leaves it out.
        folder: where journals are written, on a real disk.
        as_json: one JSON object instead of tables.
        check: exit code 1 when a target is missed.
    """
    check_disk(folder)

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    with bars():
        comparison = compare(tasks, rounds, folder, say) if tasks else None
    scale = measure_scale(cases, folder) if cases else None
    misses = (comparison.misses() if comparison else []) + (scale.misses() if scale else [])
    if as_json:
        document = comparison.to_json() if comparison else {}
        if scale:
            document["scale"] = scale.to_json()
        print(json.dumps({**document, "misses": misses}))
    else:
        console = Console()
        if comparison:
            console.print(_comparison_table(comparison))
        if scale:
            console.print(_scale_table(scale))
    for line in misses:
        say(f"missed: {line}")
    return EXIT_FAILED if check and misses else EXIT_PASS


_LABELS = {
    "k8": "conductor, 8 per request (durable)",
    "k1": "conductor, 1 per request (durable)",
    "files": "conductor, 8 per request, with KPI files (durable)",
    "dask": "dask.distributed (in memory)",
    "hyperqueue": "HyperQueue (in memory)",
}


def _comparison_table(comparison: SchedulerComparison) -> Table:
    table = Table("scheduler", "cases/s", "least", "most", "aim", title="no-op cases, 2 processes")
    for name, label in _LABELS.items():
        rates = [run.rate for run in comparison.runs[name]]
        if not rates:
            table.add_row(label, "not installed", "", "", "")
            continue
        middle = comparison.rate(name)
        aim = f"{AIMS[name]:.0f}" if name in AIMS else ""
        table.add_row(label, f"{middle:.0f}", f"{min(rates):.0f}", f"{max(rates):.0f}", aim)
    table.add_section()
    files, judged = comparison.ratio("files", "k8"), comparison.judged_rate()
    if files is not None and judged is not None:
        table.add_row("ratio files k8", f"{files:.3f}x", "", "", "")
        table.add_row("with KPI files, until all are judged", f"{judged:.0f}", "", "", "")
    for name, ratio in comparison.ratios().items():
        shown = "-" if ratio is None else f"{ratio:.1f}x"
        table.add_row(name.replace("_", " "), shown, "", "", f">= {TARGETS[name]:g}x")
    return table


def _scale_table(scale: Scale) -> Table:
    table = Table("what", "measured", "at most", title=f"a campaign of {scale.cases} cases")
    for name, most in SCALE_TARGETS.items():
        table.add_row(name, f"{getattr(scale, name):.2f}", f"{most:g}")
    return table
