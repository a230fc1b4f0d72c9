"""``viewer bench``: what looking costs, on the viewer's side and on the simulation's.

Its targets for the simulation are in :mod:`viewer.bench.compare`.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from twin.base.errors import EXIT_FAILED, EXIT_PASS, UsageError
from twin.base.progress import bars, counter, steps
from viewer.bench import compare as bench_compare
from viewer.bench import in_browser, pairs, running
from viewer.bench import table as bench_table
from viewer.bench.compare import MODES, CampaignRun, compare
from viewer.bench.running import BenchOptions

WARM_UP_S = 10.0
"""Before anything is measured: imports, first pictures, subscriptions [s]."""

CPU_MAX = 0.25
"""Target: the viewer process takes at most this share of a core [-]."""
LAG_MAX_S = 2.0
"""Target: a picture is on a page so long after the simulator was there, at most [s]."""
TABLE_MAX_S = 1.5
"""Target: list, campaign and table of a finished campaign take so much processor time [s]."""
TABLE_MEMORY_MAX_MB = 400.0
"""Target: and take at most so much memory [MB]."""
CONSOLE_CPU_MAX = 0.15
"""Target: the console takes at most this share of a core [-]."""
MEMORY_MAX_MB = 600.0
"""Target: and at most so much memory at the end [MB]."""


def bench(options: BenchOptions, *, as_json: bool, check: bool) -> int:
    """Measure and print; the exit code."""
    if options.focus > min(8, options.cases):
        raise UsageError(f"--focus {options.focus}: at most 8, and at most --cases")
    asked: dict[str, tuple[float, Callable[[BenchOptions], dict[str, Any]]]] = {
        "viewer": (options.seconds, measure_viewer),
        "console": (options.seconds and options.console, measure_console),
        "page": (options.page, lambda options: in_browser.measure_page(options.page)),
        "table": (options.seconds and options.ended, measure_table),
        "simulation": (options.rounds, measure_simulation),
        "pairs": (options.pairs, measure_pairs),
    }
    with bars():
        parts = [(name, measure) for name, (amount, measure) in asked.items() if amount]
        figures = {name: measure(options) for name, measure in steps("parts", parts)}
    missed = misses(figures)
    figures["missed"] = missed
    if as_json:
        print(json.dumps(figures))
    else:
        for line in _lines(figures):
            print(line)
    return EXIT_FAILED if check and missed else EXIT_PASS


def measure_viewer(options: BenchOptions) -> dict[str, Any]:
    """CPU share and memory of ``viewer live`` over many synthetic cases."""
    with running.source(options.cases) as endpoint:
        full = [word for i in range(options.focus) for word in ("--case", f"case-{i:03d}")]
        with running.viewer("--connect", endpoint, "--insecure", *full) as child:
            process = psutil.Process(child.pid)
            time.sleep(WARM_UP_S)
            before, begun_s = process.cpu_times(), time.monotonic()
            first_mb = process.memory_info().rss / 1e6
            time.sleep(options.seconds)
            after, wall_s = process.cpu_times(), time.monotonic() - begun_s
            last_mb = process.memory_info().rss / 1e6
            counts = running.counts(child)
    used_s = after.user + after.system - before.user - before.system
    return {
        "cases": options.cases,
        "in_full": options.focus,
        "seconds": round(wall_s, 1),
        "cpu_share": round(used_s / wall_s, 4),
        "memory_first_mb": round(first_mb, 1),
        "memory_last_mb": round(last_mb, 1),
        **counts,
    }


def measure_console(options: BenchOptions) -> dict[str, Any]:
    """CPU share and memory of ``viewer web`` over many synthetic cases, with a page that follows
    them and asks for the pictures on its screen."""
    with (
        running.source(options.console) as endpoint,
        running.console("--connect", endpoint, "--insecure") as web,
    ):
        process = psutil.Process(web.child.pid)
        with running.page(web.url) as page:
            page.wait()
            time.sleep(WARM_UP_S)
            page.lags_s.clear()
            before, begun_s, seen = process.cpu_times(), time.monotonic(), page.pictures
            time.sleep(options.seconds)
            after, wall_s = process.cpu_times(), time.monotonic() - begun_s
            seen = page.pictures - seen
        memory_mb = process.memory_info().rss / 1e6
    used_s = after.user + after.system - before.user - before.system
    return {
        "cases": options.console,
        "seconds": round(wall_s, 1),
        "cpu_share": round(used_s / wall_s, 4),
        "memory_mb": round(memory_mb, 1),
        "pictures_per_s": round(seen / wall_s, 1),
        **page.lag(),
    }


def measure_table(options: BenchOptions) -> dict[str, Any]:
    """Time that the console takes to tell of a finished campaign, and its memory."""
    with running.started(
        "a finished campaign", "viewer.bench.table", str(options.ended)
    ) as started:
        return started[1]


def measure_simulation(options: BenchOptions) -> dict[str, Any]:
    """One campaign with nobody, each kind of viewer, and recorders; interleaved."""
    runs: dict[str, list[CampaignRun]] = {mode: [] for mode in MODES}
    with tempfile.TemporaryDirectory(prefix="viewer-bench-") as folder:
        ran = counter("runs", options.rounds * len(MODES))
        for index in range(options.rounds):
            # Another order every round: machines warm up, and neighbours come and go.
            first = index % len(MODES)
            for mode in MODES[first:] + MODES[:first]:
                out = Path(folder) / f"{mode}-{index}"
                runs[mode].append(running.simulate(options, mode, out))
                shutil.rmtree(out, ignore_errors=True)
                ran(1)
    return {"campaign": options.campaign, "rounds": options.rounds, **compare(runs)}


def measure_pairs(options: BenchOptions) -> dict[str, Any]:
    """One campaign with a page of the console and without, in turns."""
    found: list[pairs.Pair] = []
    with tempfile.TemporaryDirectory(prefix="viewer-bench-") as folder:
        ran = counter("runs of pairs", options.pairs * len(pairs.MODES))
        for index in range(options.pairs):
            runs = {}
            # The other one first every time: machines warm up, and neighbours come and go.
            for mode in pairs.MODES[:: -1 if index % 2 else 1]:
                out = Path(folder) / f"{mode}-{index}"
                runs[mode] = running.simulate(options, mode, out)
                shutil.rmtree(out, ignore_errors=True)
                ran(1)
            found.append(pairs.Pair(runs["alone"], runs["console"]))
    return {"campaign": options.campaign, **pairs.compare(found)}


def misses(found: dict[str, Any]) -> list[str]:
    """A line per target that was missed."""
    missed = []
    if viewer := found.get("viewer"):
        if viewer["cpu_share"] > CPU_MAX:
            missed.append(f"viewer: {viewer['cpu_share']:.0%} of a core, at most {CPU_MAX:.0%}")
        if viewer["memory_last_mb"] > MEMORY_MAX_MB:
            missed.append(f"viewer: {viewer['memory_last_mb']} MB, at most {MEMORY_MAX_MB:.0f}")
    if console := found.get("console"):
        if console["cpu_share"] > CONSOLE_CPU_MAX:
            missed.append(
                f"console: {console['cpu_share']:.0%} of a core, at most {CONSOLE_CPU_MAX:.0%}"
            )
        missed += _lag_misses(console, "console")
        if not console["pictures_per_s"]:
            missed.append("console: the page was given no picture")
    if page := found.get("page"):
        missed += in_browser.misses(page)
    if table := found.get("table"):
        if table["first_cpu_s"] > TABLE_MAX_S:
            cpu = f"{table['first_cpu_s']} s of a processor, at most {TABLE_MAX_S:g} s"
            missed.append(f"console: its table in {cpu}")
        if table["memory_mb"] > TABLE_MEMORY_MAX_MB:
            memory = f"{table['memory_mb']} MB, at most {TABLE_MEMORY_MAX_MB:.0f}"
            missed.append(f"console: {table['cases']} cases take {memory}")
    if simulation := found.get("simulation"):
        missed += bench_compare.misses(simulation)
    if paired := found.get("pairs"):
        missed += pairs.misses(paired) + _lag_misses(paired, "a campaign with a page")
    return missed


def _lag_misses(found: dict[str, Any], what: str) -> list[str]:
    """Whether pictures come too late, or nobody can say how late they are."""
    if found["lag_max_s"] is None:
        return [f"{what}: nobody knows how far its pictures lag behind the simulators"]
    if found["lag_max_s"] > LAG_MAX_S:
        return [f"{what}: pictures lag {found['lag_max_s']} s, at most {LAG_MAX_S:g}"]
    return []


def _lines(figures: dict[str, Any]) -> list[str]:
    lines = []
    if viewer := figures.get("viewer"):
        lines.append(
            f"viewer, {viewer['cases']} cases of which {viewer['in_full']} in full, "
            f"{viewer['seconds']} s: {viewer['cpu_share']:.1%} of a core, "
            f"{viewer['memory_first_mb']} MB at first, {viewer['memory_last_mb']} MB at last, "
            f"{viewer['received']} messages"
        )
    if console := figures.get("console"):
        lines.append(
            f"console, {console['cases']} cases, {console['seconds']} s: "
            f"{console['cpu_share']:.1%} of a core, {console['memory_mb']} MB, "
            f"{console['pictures_per_s']} pictures a second for one page; {pairs.lag_line(console)}"
        )
    if page := figures.get("page"):
        lines += in_browser.lines(page)
    if table := figures.get("table"):
        lines.append(bench_table.line(table))
    if simulation := figures.get("simulation"):
        lines.append(f"{Path(simulation['campaign']).name}, {simulation['rounds']} runs of each:")
        lines += [f"  {line}" for line in bench_compare.lines(simulation)]
    if paired := figures.get("pairs"):
        lines.append(f"{Path(paired['campaign']).name}, {paired['pairs']} pairs of runs:")
        lines += [f"  {line}" for line in pairs.lines(paired)]
    return lines + [f"missed: {line}" for line in figures["missed"]]
