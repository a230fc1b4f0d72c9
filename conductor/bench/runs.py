"""``conductor bench-run``: what a run costs that simulates nothing, from the command to its end."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import msgspec

from schemas.campaign import WEATHERS
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, UsageError
from twin.base.files import write_atomic

RATIO_MIN = 3.0
"""Target: so many times the processor time must the installation take that is compared with."""

_KEEPS_NOTHING = "PYTHONDONTWRITEBYTECODE"
"""Variable of Python with which every start compiles all modules again: no installation does."""


@dataclass(frozen=True, slots=True)
class RunCost:
    """What one run took."""

    cpu_s: float
    """Processor time of the command and of all processes that it started and waited for [s]."""
    wall_s: float
    """Duration of the command [s]."""


def bench_run(
    cases: int, rounds: int, against: Path | None, folder: Path, *, as_json: bool, check: bool
) -> int:
    """Run a campaign of ``simulator: noop`` with one worker, again and again; the exit code.

    Args:
        cases: number of cases, a multiple of the weathers.
        rounds: counted runs of each installation, which take turns; one before them is not counted.
        against: Python interpreter of another installation; None: none.
        folder: where runs are written, on a real disk.
        as_json: one JSON object instead of lines.
        check: exit code 1 below :data:`RATIO_MIN`.

    Raises:
        UsageError: no such interpreter, or another number of cases.
        InfrastructureError: a run did not end well; its last line.
    """
    if cases % len(WEATHERS):
        raise UsageError(f"--cases {cases}: give a multiple of {len(WEATHERS)}")
    if against is not None and not (against.is_file() and os.access(against, os.X_OK)):
        raise UsageError(f"--against {against}: not a program; give a Python interpreter")
    pythons = {"here": Path(sys.executable), **({"against": against} if against else {})}
    folder.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix="bench-run-", dir=folder.absolute()))
    costs: dict[str, list[RunCost]] = {name: [] for name in pythons}
    try:
        write_atomic(scratch / "campaign.yaml", _campaign(cases))
        for number in range(rounds + 1):
            for name, python in pythons.items():
                cost = _measure(python, scratch, f"{name}-{number}")
                costs[name] += [cost] if number else []
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    typical = {name: _typical(each) for name, each in costs.items()}
    ratios = _ratios(typical["against"], typical["here"]) if against else {}
    if as_json:
        runs = {name: [asdict(cost) for cost in each] for name, each in costs.items()}
        print(json.dumps({"cases": cases, "runs": runs, "ratios": ratios}))
    else:
        for name, python in pythons.items():
            cpu_s, wall_s = typical[name].cpu_s, typical[name].wall_s
            print(f"{python}: {cpu_s:.2f} s of processor time, {wall_s:.2f} s by the clock")
        for what, ratio in ratios.items():
            print(f"ratio {what}: {ratio:.2f}")
    missed = bool(ratios) and ratios["cpu_s"] < RATIO_MIN
    if missed:
        print(
            f"missed: the other one takes {ratios['cpu_s']:.2f} times the processor time, the "
            f"target is {RATIO_MIN:g}",
            file=sys.stderr,
        )
    return EXIT_FAILED if check and missed else EXIT_PASS


def _campaign(cases: int) -> bytes:
    """A campaign file; JSON is YAML."""
    matrix = {"weather": list(WEATHERS), "repeat": list(range(cases // len(WEATHERS)))}
    return msgspec.json.encode({"campaign": "bench-run", "simulator": "noop", "matrix": matrix})


def _measure(python: Path, scratch: Path, name: str) -> RunCost:
    left_out = {_KEEPS_NOTHING} if str(python) == sys.executable else {_KEEPS_NOTHING, "PYTHONPATH"}
    environment = {key: value for key, value in os.environ.items() if key not in left_out}
    words = [*("-m", "conductor", "run", "campaign.yaml"), *("--workers", "1", "--out", name)]
    with tempfile.TemporaryFile() as log:
        began_s = time.perf_counter()
        child = subprocess.Popen(
            [os.path.normpath(python.absolute()), *words],
            cwd=scratch,  # no package of the folder in which the bench was started
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=log,
        )
        try:
            _, status, usage = os.wait4(child.pid, 0)
        except BaseException:
            child.terminate()  # it drains; its workers end with it
            child.wait()
            raise
        wall_s = time.perf_counter() - began_s
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            log.seek(0)
            last = log.read().decode("utf-8", "replace").strip().rpartition("\n")[2]
            raise InfrastructureError(f"{python}: the run ended with {child.returncode}: {last}")
    return RunCost(usage.ru_utime + usage.ru_stime, wall_s)


def _typical(costs: list[RunCost]) -> RunCost:
    """Medians."""
    return RunCost(median(cost.cpu_s for cost in costs), median(cost.wall_s for cost in costs))


def _ratios(other: RunCost, here: RunCost) -> dict[str, float]:
    """What the other installation takes, per what this one does."""
    return {"cpu_s": other.cpu_s / here.cpu_s, "wall_s": other.wall_s / here.wall_s}
