"""``viewer bench``: what looking costs, on the viewer's side and on the simulation's.

Its targets for the simulation are in :mod:`viewer.bench.compare`.
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, UsageError
from twin.base.process import end, last_lines, spawn
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from viewer.bench import compare as bench_compare
from viewer.bench import in_browser
from viewer.bench import table as bench_table
from viewer.bench.compare import MODES, CampaignRun, compare, window
from viewer.bench.course import CampaignCourse
from viewer.recording import naming

WARM_UP_S = 10.0
"""Before anything is measured: imports, first pictures, subscriptions [s]."""

CAMPAIGN = Path(__file__).with_name("bench_campaign.yaml")
"""What is simulated with and without viewers."""

SIMULATED = 32
"""Cases of it that are simulated unless somebody says otherwise."""

WAIT_S = 120
"""Longest time until a campaign's conductor is there [s]."""
FIRST_S = 60.0
"""Longest time until a page is given its first picture [s]."""
LOOK_S = 0.1
"""Time between two looks at a campaign's progress [s]."""

CPU_MAX = 0.25
"""Target: the viewer process takes at most this share of a core [-]."""
LAG_MAX_S = 2.0
"""Target: a picture is on a page so long after it came to the console, at most [s]."""
TABLE_MAX_S = 1.5
"""Target: list, campaign and table of a finished campaign take so much processor time [s]."""
TABLE_MEMORY_MAX_MB = 400.0
"""Target: and take at most so much memory [MB]."""
CONSOLE_CPU_MAX = 0.15
"""Target: the console takes at most this share of a core [-]."""
MEMORY_MAX_MB = 600.0
"""Target: and at most so much memory at the end [MB]."""


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """What the command line says."""

    cases: int = 64
    focus: int = 1
    """Cases of these in full."""
    console: int = 256
    """Synthetic live cases that a page of the console looks at; 0: it is not measured."""
    ended: int = 10_240
    """Cases of a finished campaign that the console tells of; 0: none."""
    seconds: float = 60.0
    """Time for which the viewer is measured; 0: not at all [s]."""
    campaign: str = str(CAMPAIGN)
    """What is simulated with and without viewers."""
    rounds: int = 3
    """Runs of each mode, interleaved; 0: none."""
    simulate: int | None = None
    """Cases of it, the first; None: all."""
    workers: int | None = None
    slots: int = 1
    device: str = "cpu"
    page: int = 0
    """Cases of the console's page that is measured in a browser; 0: it is not."""


def bench(options: BenchOptions, *, as_json: bool, check: bool) -> int:
    """Measure and print; the exit code."""
    if options.focus > min(8, options.cases):
        raise UsageError(f"--focus {options.focus}: at most 8, and at most --cases")
    figures: dict[str, Any] = {}
    if options.seconds:
        figures["viewer"] = measure_viewer(options)
    if options.seconds and options.console:
        figures["console"] = measure_console(options)
    if options.page:
        figures["page"] = in_browser.measure_page(options.page)
    if options.seconds and options.ended:
        figures["table"] = measure_table(options)
    if options.rounds:
        figures["simulation"] = measure_simulation(options)
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
    with _source(options.cases) as endpoint:
        full = [word for i in range(options.focus) for word in ("--case", f"case-{i:03d}")]
        with _viewer("--connect", endpoint, "--insecure", *full) as child:
            process = psutil.Process(child.pid)
            time.sleep(WARM_UP_S)
            before, begun_s = process.cpu_times(), time.monotonic()
            first_mb = process.memory_info().rss / 1e6
            time.sleep(options.seconds)
            after, wall_s = process.cpu_times(), time.monotonic() - begun_s
            last_mb = process.memory_info().rss / 1e6
            counts = _counts(child)
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
    with _source(options.console) as endpoint, _console("--connect", endpoint, "--insecure") as web:
        process = psutil.Process(web.child.pid)
        with _page(web.url) as page:
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
        "lag_max_s": max(page.lags_s, default=0.0),
    }


def measure_table(options: BenchOptions) -> dict[str, Any]:
    """Time that the console takes to tell of a finished campaign, and its memory."""
    with _started("a finished campaign", "viewer.bench.table", str(options.ended)) as started:
        return started[1]


def measure_simulation(options: BenchOptions) -> dict[str, Any]:
    """One campaign with nobody, each kind of viewer, and recorders; interleaved."""
    runs: dict[str, list[CampaignRun]] = {mode: [] for mode in MODES}
    with tempfile.TemporaryDirectory(prefix="viewer-bench-") as folder:
        for index in range(options.rounds):
            # Another order every round: machines warm up, and neighbours come and go.
            first = index % len(MODES)
            for mode in MODES[first:] + MODES[:first]:
                out = Path(folder) / f"{mode}-{index}"
                runs[mode].append(_simulate(options, mode, out))
                shutil.rmtree(out, ignore_errors=True)
    return {"campaign": options.campaign, "rounds": options.rounds, **compare(runs)}


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
        if console["lag_max_s"] > LAG_MAX_S:
            missed.append(f"console: pictures lag {console['lag_max_s']} s, at most {LAG_MAX_S:g}")
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
    return missed


def _simulate(options: BenchOptions, mode: str, out: Path) -> CampaignRun:
    view = mode if mode in ("none", "record") else "live"
    arguments = [
        *("run", options.campaign, "--out", str(out), "--view", view, "--output", "json"),
        *("--slots", str(options.slots), "--device", options.device),
        *(() if options.workers is None else ("--workers", str(options.workers))),
        *(() if options.simulate is None else ("--cases", str(options.simulate))),
    ]
    if mode in ("none", "record"):
        summary, course = _run(arguments, out)
    elif mode == "console":
        with ExitStack() as looking:
            summary, course = _run(arguments, out, looks=lambda: _look_on(looking, out))
    else:
        with _viewer("--run", str(out), "--wait", str(WAIT_S)) as child:
            summary, course = _run(arguments, out, child if mode == "frozen" else None)
    sizes = [path.stat().st_size / 1e6 for path in out.glob(f"cases/*/*/{naming.RECORDING_FILE}")]
    measured = window(course.samples, course.workers * options.slots)
    return CampaignRun(summary["cases"], measured, summary["fingerprint"], tuple(sorted(sizes)))


def _run(
    arguments: list[str],
    out: Path,
    freeze: subprocess.Popen[bytes] | None = None,
    looks: Callable[[], None] | None = None,
) -> tuple[dict[str, Any], CampaignCourse]:
    """``conductor run``; with ``freeze`` that viewer is stopped once the first case has ended, and
    ``looks`` is called once there is a conductor."""
    with tempfile.TemporaryFile() as log:
        child = spawn([sys.executable, "-m", "conductor", *arguments], log=log, pipe_output=True)
        try:
            course = CampaignCourse(child.pid, out)
            frozen = freeze is None
            while child.poll() is None:
                course.look()
                if looks is not None and (out / CONDUCTOR_FILE).exists():
                    looks()
                    looks = None
                if freeze is not None and not frozen:
                    frozen = any(out.glob("cases/*/attempt-*"))
                    if frozen:
                        freeze.send_signal(signal.SIGSTOP)
                time.sleep(LOOK_S)
            assert child.stdout is not None
            text = child.stdout.read()
            try:
                summary: dict[str, Any] = json.loads(text)
            except ValueError:
                raise InfrastructureError(f"conductor run: {last_lines(log)}") from None
            return summary, course
        finally:
            if freeze is not None:
                freeze.send_signal(signal.SIGCONT)
            end(child)


@contextmanager
def _started(
    name: str, module: str, *words: str
) -> Iterator[tuple[subprocess.Popen[bytes], dict[str, Any]]]:
    """A module of ours as a process until the block ends; yields it and its first line, decoded.

    Raises:
        InfrastructureError: it ended without one; ``name`` and its last words.
    """
    with tempfile.TemporaryFile() as log:
        child = spawn([sys.executable, "-m", module, *words], log=log, pipe_output=True)
        try:
            assert child.stdout is not None
            line = child.stdout.readline()
            if not line:
                raise InfrastructureError(f"{name}: {last_lines(log)}")
            yield child, json.loads(line)
        finally:
            end(child)


@contextmanager
def _source(cases: int) -> Iterator[str]:
    """Synthetic cases; yields their endpoint."""
    with _started("synthetic cases", "viewer.bench.source", str(cases)) as (_, said):
        yield said["endpoint"]


@dataclass(frozen=True, slots=True)
class RunningConsole:
    """`viewer web` as a child."""

    child: subprocess.Popen[bytes]
    url: str


class SeenPictures:
    """What a child that stands for a page says of itself."""

    def __init__(self, child: subprocess.Popen[bytes]) -> None:
        self.pictures = 0
        """Pictures that it was given."""
        self.lags_s: list[float] = []
        """Of each second, the longest time from a picture's coming to the console to the page."""
        self._child = child
        threading.Thread(target=self._read, name="page", daemon=True).start()

    def wait(self) -> None:
        """Wait for the first picture.

        Raises:
            InfrastructureError: none comes.
        """
        until_s = time.monotonic() + FIRST_S
        while not self.pictures:
            if time.monotonic() > until_s or self._child.poll() is not None:
                raise InfrastructureError("the page is given no picture by viewer web")
            time.sleep(LOOK_S)

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            said = json.loads(line)
            self.pictures = said["pictures"]
            self.lags_s.append(said["lag_s"])


@contextmanager
def _console(*arguments: str) -> Iterator[RunningConsole]:
    """`viewer web` over running cases."""
    words = ("viewer", "web", *arguments, "--output", "json")
    with _started("viewer web", *words) as (child, said):
        yield RunningConsole(child, said["url"])


@contextmanager
def _page(url: str) -> Iterator[SeenPictures]:
    """A page that looks at a console."""
    with tempfile.TemporaryFile() as log:
        child = spawn([sys.executable, "-m", "viewer.bench.page", url], log=log, pipe_output=True)
        try:
            yield SeenPictures(child)
        finally:
            end(child)


def _look_on(looking: ExitStack, out: Path) -> None:
    """A console over a running campaign, and a page that looks at it, until ``looking`` ends."""
    console = looking.enter_context(_console("--run", str(out)))
    looking.enter_context(_page(console.url))


@contextmanager
def _viewer(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """``viewer live`` without a window."""
    with tempfile.TemporaryFile() as log:
        command = [sys.executable, "-m", "viewer", "live", *arguments]
        child = spawn([*command, "--no-window", "--output", "json"], log=log, pipe_output=True)
        try:
            assert child.stdout is not None
            if not child.stdout.readline():
                raise InfrastructureError(f"viewer live: {last_lines(log)}")
            yield child
        finally:
            end(child)


def _counts(child: subprocess.Popen[bytes]) -> dict[str, Any]:
    """What the viewer says at its end."""
    child.send_signal(signal.SIGINT)
    assert child.stdout is not None
    counts: dict[str, Any] = json.loads(child.stdout.readline() or "{}")
    return {name: counts.get(name, 0) for name in ("received", "overwritten", "logged", "skipped")}


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
            f"{console['pictures_per_s']} pictures a second for one page, at most "
            f"{console['lag_max_s']} s after they came"
        )
    if page := figures.get("page"):
        lines += in_browser.lines(page)
    if table := figures.get("table"):
        lines.append(bench_table.line(table))
    if simulation := figures.get("simulation"):
        lines.append(f"{Path(simulation['campaign']).name}, {simulation['rounds']} runs of each:")
        lines += [f"  {line}" for line in bench_compare.lines(simulation)]
    return lines + [f"missed: {line}" for line in figures["missed"]]
