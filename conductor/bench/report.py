"""``conductor bench-report``: seconds and memory of reports over a large campaign of real files."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from conductor.bench.report_campaign import plan_of, write_files, write_outcomes
from conductor.report.pages.document import PAGE_FILE
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError

WALL_S_MAX = 60.0
"""Longest report over the campaign that is allowed, by the issue of 10,000 cases [s]."""
MEMORY_BYTES_MAX = 10**9
_NEW_SHARE = 0.01
_PROGRAM = (
    "import sys; from conductor.report import make_report; from pathlib import Path; "
    "print(make_report(Path(sys.argv[1])).content.read)"
)


@dataclass(frozen=True, slots=True)
class ReportRun:
    """One report, made by a process of its own."""

    what: str
    wall_s: float
    cpu_s: float
    memory_bytes: int
    """Most resident memory."""
    read: int
    """KPI files that it read."""


def bench_report(cases: int, folder: Path, *, as_json: bool, check: bool) -> int:
    """Write a campaign below ``folder``, report it four times, remove it; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix="bench-report-", dir=folder))
    try:
        return _bench(cases, scratch, as_json=as_json, check=check)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _bench(cases: int, scratch: Path, *, as_json: bool, check: bool) -> int:
    plan = plan_of(cases)
    print("writing the campaign", file=sys.stderr)
    ends = write_files(scratch, plan)
    new = max(1, round(_NEW_SHARE * len(ends)))
    steps = [
        ("first report, 2 % of the cases left", 2 * new),
        ("next report, 1 % of the cases new", new),
        ("complete: the fingerprint takes every file", 0),
        ("nothing new", 0),
    ]
    runs: list[ReportRun] = []
    for what, left in steps:
        if not runs or left != steps[len(runs) - 1][1]:
            write_outcomes(scratch, plan.campaign, ends, left)
        runs.append(_measure(what, scratch))
    page_bytes = (scratch / PAGE_FILE).stat().st_size
    missed = list(_missed(runs))
    if as_json:
        rows = [asdict(report) for report in runs]
        print(json.dumps({"cases": len(ends), "page_bytes": page_bytes, "reports": rows}))
    else:
        for run in runs:
            print(
                f"{run.what}: {run.wall_s:.1f} s ({run.cpu_s:.1f} s of CPU), "
                f"{run.memory_bytes / 1e6:.0f} MB, {run.read} files read"
            )
        print(f"{len(ends)} cases, page of {page_bytes / 1e6:.1f} MB")
    for line in missed:
        print(f"conductor: {line}", file=sys.stderr)
    return EXIT_FAILED if check and missed else EXIT_PASS


def _missed(runs: list[ReportRun]) -> Iterator[str]:
    for run in runs:
        if run.wall_s > WALL_S_MAX:
            yield f"{run.what}: {run.wall_s:.1f} s, allowed are {WALL_S_MAX:g} s"
        if run.memory_bytes > MEMORY_BYTES_MAX:
            yield f"{run.what}: {run.memory_bytes / 1e6:.0f} MB, allowed are 1000 MB"
    if runs[-1].read:
        yield f"{runs[-1].what}: {runs[-1].read} files read, expected none"


def _measure(what: str, folder: Path) -> ReportRun:
    """Run a report as a child, because memory is counted per process."""
    reading, writing = os.pipe()
    began = time.monotonic()
    pid = os.posix_spawn(
        sys.executable,
        [sys.executable, "-c", _PROGRAM, str(folder)],
        os.environ,
        file_actions=[
            (os.POSIX_SPAWN_DUP2, writing, 1),
            (os.POSIX_SPAWN_CLOSE, reading),
        ],
    )
    os.close(writing)
    with os.fdopen(reading) as output:
        printed = output.read()
    _, status, usage = os.wait4(pid, 0)
    wall_s = time.monotonic() - began
    if status != 0:
        raise InfrastructureError(f"bench-report: the report ended with status {status}")
    return ReportRun(
        what, wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024, int(printed)
    )
