"""The children of ``viewer bench``: campaigns, synthetic cases, viewers, and pages that look."""

from __future__ import annotations

import json
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

from twin.base.errors import InfrastructureError
from twin.base.process import end, last_lines, spawn
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.discovery import OUTCOMES_NAME
from viewer.bench.compare import CampaignRun, LookedOn, lag_of, window
from viewer.bench.course import CampaignCourse
from viewer.recording import naming

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
    pairs: int = 0
    """Runs with a page of the console, each beside one without; 0: none."""
    page: int = 0
    """Cases of the console's page that is measured in a browser; 0: it is not."""


def simulate(options: BenchOptions, mode: str, out: Path) -> CampaignRun:
    view, looked = mode if mode in ("none", "record") else "live", None
    arguments = [
        *("run", options.campaign, "--out", str(out), "--view", view, "--output", "json"),
        *("--slots", str(options.slots), "--device", options.device),
        *(() if options.workers is None else ("--workers", str(options.workers))),
        *(() if options.simulate is None else ("--cases", str(options.simulate))),
    ]
    if mode in ("none", "record", "alone"):
        summary, course = _run(arguments, out)
    elif mode == "console":
        with ExitStack() as until:
            onlooker = Onlooker(until, out)
            summary, course = _run(arguments, out, looks=onlooker.begin)
            looked = onlooker.look()
    else:
        with viewer("--run", str(out), "--wait", str(WAIT_S)) as child:
            summary, course = _run(arguments, out, child if mode == "frozen" else None)
    sizes = [path.stat().st_size / 1e6 for path in out.glob(f"cases/*/*/{naming.RECORDING_FILE}")]
    measured = window(course.samples, course.workers * options.slots)
    return CampaignRun(
        *(summary["cases"], measured, summary["fingerprint"], tuple(sorted(sizes))),
        rig_wall_s=_rig_wall_s(out),
        looked=looked,
    )


def _rig_wall_s(out: Path) -> dict[str, float]:
    """Wall time that each case took of its rig, start and end of workers left out [s]."""
    cases = json.loads((out / OUTCOMES_NAME).read_bytes())["cases"]
    return {case: row.get("rig_wall_s", 0.0) for case, row in cases.items()}


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
def started(
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
def source(cases: int) -> Iterator[str]:
    """Synthetic cases; yields their endpoint."""
    with started("synthetic cases", "viewer.bench.source", str(cases)) as (_, said):
        yield said["endpoint"]


@dataclass(frozen=True, slots=True)
class RunningConsole:
    """`viewer web` as a child."""

    child: subprocess.Popen[bytes]
    url: str


class SeenPictures:
    """What a child that stands for a page says of itself."""

    def __init__(
        self, child: subprocess.Popen[bytes], first: Callable[[], None] = lambda: None
    ) -> None:
        """``first``: called when it has been given its first picture."""
        self.pictures = 0
        """Pictures that it was given."""
        self.lags_s: list[float] = []
        """Of each second with pictures, the longest time from the simulator to the page; seconds
        in which it was not known of all are left out."""
        self._child, self._first = child, first
        threading.Thread(target=self._read, name="page", daemon=True).start()

    def wait(self) -> None:
        """Wait for the first picture whose age is known.

        Raises:
            InfrastructureError: none comes.
        """
        until_s = time.monotonic() + FIRST_S
        while not self.lags_s:
            if time.monotonic() > until_s or self._child.poll() is not None:
                what = "no picture" if not self.pictures else "no age of a picture"
                raise InfrastructureError(f"the page is given {what} by viewer web")
            time.sleep(LOOK_S)

    def lag(self) -> dict[str, float | None]:
        """How far pictures lagged behind the simulators; None: nobody knows."""
        return lag_of(self.lags_s)

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            said = json.loads(line)
            if said["pictures"] and not self.pictures:
                self._first()
            self.pictures = said["pictures"]
            if said["lag_s"] is not None:
                self.lags_s.append(said["lag_s"])


@contextmanager
def console(*arguments: str) -> Iterator[RunningConsole]:
    """`viewer web` over running cases."""
    words = ("viewer", "web", *arguments, "--output", "json")
    with started("viewer web", *words) as (child, said):
        yield RunningConsole(child, said["url"])


@contextmanager
def page(url: str, first: Callable[[], None] = lambda: None) -> Iterator[SeenPictures]:
    """A page that looks at a console; ``first`` as for :class:`SeenPictures`."""
    with tempfile.TemporaryFile() as log:
        child = spawn([sys.executable, "-m", "viewer.bench.page", url], log=log, pipe_output=True)
        try:
            yield SeenPictures(child, first)
        finally:
            end(child)


class Onlooker:
    """A console over a running campaign, and a page that looks at it, from :meth:`begin` on."""

    def __init__(self, until: ExitStack, out: Path) -> None:
        self._until, self._out = until, out
        self._page: SeenPictures | None = None
        self._web: psutil.Process | None = None
        self._first: tuple[float, float] | None = None
        """When the first picture was seen, and what the console had used by then [s]."""

    def begin(self) -> None:
        """Start both; they end with the stack that was given."""
        web = self._until.enter_context(console("--run", str(self._out)))
        self._web = psutil.Process(web.child.pid)
        self._page = self._until.enter_context(page(web.url, self._seen))

    def look(self) -> LookedOn:
        """What came of it so far.

        Raises:
            InfrastructureError: nobody has seen a picture.
        """
        if self._page is None or self._first is None:
            raise InfrastructureError("the campaign was over before anybody saw a picture of it")
        wall_s = time.monotonic() - self._first[0]
        share = (self._used_s() - self._first[1]) / wall_s
        return LookedOn(share, self._page.pictures, tuple(self._page.lags_s))

    def _seen(self) -> None:
        # As of workers, the start of the console does not count.
        self._first = time.monotonic(), self._used_s()

    def _used_s(self) -> float:
        assert self._web is not None
        used = self._web.cpu_times()
        return used.user + used.system


@contextmanager
def viewer(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
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


def counts(child: subprocess.Popen[bytes]) -> dict[str, Any]:
    """What the viewer says at its end."""
    child.send_signal(signal.SIGINT)
    assert child.stdout is not None
    counts: dict[str, Any] = json.loads(child.stdout.readline() or "{}")
    return {name: counts.get(name, 0) for name in ("received", "overwritten", "logged", "skipped")}
