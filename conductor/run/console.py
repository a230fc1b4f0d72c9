"""A run on a console: its lines, a bar that moves where there is a terminal, and its results."""

from __future__ import annotations

import contextlib
import json
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

from conductor.records.failures import told
from conductor.records.fingerprint import Fingerprint
from conductor.records.outcomes import Outcomes, count_outcomes, count_verdicts
from conductor.records.realtime import too_slow
from conductor.records.search import read_search
from conductor.run.case_lengths import slots_in_use, use_line
from conductor.run.listener import RunListener, RunProgress
from schemas.campaign import Campaign
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from schemas.words import counted

AFTER_DEMO = (
    "; next, try `conductor run aeb-demo --seed 9 --out runs/seed-9` or `conductor campaigns`"
)
"""Words for people who run something for the first time."""


class LineListener:
    """Prints what a run says where there is no terminal; see
    :class:`conductor.run.listener.RunListener`."""

    def __init__(self) -> None:
        self._ended = -1

    def say(self, line: str) -> None:
        """Print a line."""
        print(line, file=sys.stderr, flush=True)

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Nothing is drawn."""
        yield

    def progress(self, progress: RunProgress) -> None:
        """Print a line when a case has ended."""
        if self._ended != progress.ended:
            of = counted(progress.cases, "case")
            self.say(f"{progress.campaign}: {progress.ended} of {of} done")
        self._ended = progress.ended


def listener_here() -> RunListener:
    """A bar on a terminal, elsewhere lines: a redrawn bar is noise there."""
    if not sys.stderr.isatty():
        return LineListener()
    from rich.console import Console

    from conductor.run.bar import BarListener

    return BarListener(Console(stderr=True))


def again() -> str:
    """The command line of this process, to be typed once more."""
    return shlex.join(["conductor", *sys.argv[1:]])


def print_results(
    campaign: Campaign,
    out: Path,
    outcomes: Outcomes,
    kpi_fingerprint: Fingerprint,
    *,
    wall_s: float,
    slots: int,
    as_json: bool,
) -> None:
    """Print what a run came to on standard output, and what is wrong with it on standard error.

    Args:
        campaign: the campaign that has ended.
        out: its folder.
        outcomes: of its cases.
        kpi_fingerprint: of its KPI values.
        wall_s: duration of the run [s].
        slots: of each worker; 0: they are others' workers.
        as_json: as one JSON object.
    """
    counts = count_outcomes(outcomes)
    for line in told(out, outcomes):
        print(line, file=sys.stderr)
    if warning := too_slow(outcomes):
        print(warning, file=sys.stderr)
    if as_json:
        shown = {
            "campaign": campaign.campaign,
            "out": str(out),
            **counts,
            "wall_s": round(wall_s, 3),
            "slots_in_use": slots_in_use(outcomes),
            "fingerprint": kpi_fingerprint.sha256,
        }
        print(json.dumps(shown))
        return
    verdicts = ", ".join(
        f"{n} {verdict}" for verdict, n in sorted(count_verdicts(outcomes).items())
    )
    print(f"{counts['passed']} of {counts['cases']} passed ({verdicts}) in {wall_s:.0f} s")
    if line := use_line(outcomes, slots):
        print(line)
    print(f"fingerprint {kpi_fingerprint.sha256} {kpi_fingerprint.caveat}".rstrip())
    if (out / SEARCH_FILE).exists():
        found = read_search(out)
        if found.answer is not None:
            print(f"search: {found.answer.line()}; {found.ended}")
    if campaign.simulator == "noop":
        print(f"results: {out} (simulator noop: nothing was simulated, no report)")
        return
    print(
        f"report: {out / 'report.html'} - open it in a browser"
        + (AFTER_DEMO if out.name == "aeb-demo" else "")
    )
