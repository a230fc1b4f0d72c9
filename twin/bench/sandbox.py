"""What the sandbox of stacks costs: at the start of a rig, and over a campaign."""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from schemas.files.yaml_file import load_yaml
from twin.base.errors import InfrastructureError
from twin.base.progress import steps
from twin.base.software import package_folder
from twin.sandbox.possible import why_not
from twin.sandbox.reads import python_reads
from twin.sandbox.start import Sandboxed
from twin.sandbox.view import SandboxView
from twin.worker.resources import read_tree

START_MS_MAX = 50.0
"""Target: what a sandbox may add to the start of a rig [ms]."""

CAMPAIGN_PERCENT_MAX = 2.0
"""Target: what it may add to the processor time of a campaign [%]."""

_LOOK_S = 0.02
"""Between two looks at the processes of a run."""

STARTS = 20
"""Starts of each kind, in turns; the fastest counts, since others may use the machine."""


@dataclass(frozen=True, slots=True)
class SandboxFigures:
    """Figures of the sandbox bench."""

    start_ms: float
    """Added to the start of a process [ms]."""
    first_ms: float
    """Added once per worker: the trial that shows whether the kernel allows it [ms]."""
    campaign: str
    """Campaign that was run; empty: none."""
    campaign_percent: float | None
    """Added to the processor time of the campaign [%]."""
    fingerprints: tuple[str, ...]
    """Fingerprints of the runs with a sandbox and without, per round."""

    @property
    def missed(self) -> list[str]:
        """Targets that were not reached."""
        misses = []
        if self.start_ms > START_MS_MAX:
            misses.append(f"{self.start_ms:.0f} ms per start, allowed are {START_MS_MAX:.0f}")
        if self.campaign_percent is not None and self.campaign_percent > CAMPAIGN_PERCENT_MAX:
            allowed = f"allowed are {CAMPAIGN_PERCENT_MAX:g} %"
            misses.append(f"{self.campaign_percent:.1f} % of {self.campaign}, {allowed}")
        if len(set(self.fingerprints)) > 1:
            misses.append("fingerprints differ")
        return misses


def measure(campaign: str, rounds: int) -> SandboxFigures:
    """Time starts, and a shipped campaign with and without a sandbox in turns.

    Raises:
        InfrastructureError: this machine has no sandbox, or the campaign does not run.
    """
    begun_s = time.perf_counter()
    if reason := why_not():
        raise InfrastructureError(f"no sandbox to measure: {reason}")
    first_ms = (time.perf_counter() - begun_s) * 1e3
    starts = [(_start_s(True), _start_s(False)) for _ in steps("starts", range(STARTS))]
    inside, outside = zip(*starts, strict=True)
    start_ms = (min(inside) - min(outside)) * 1e3
    if not campaign or not rounds:
        return SandboxFigures(start_ms, first_ms, "", None, ())
    pairs = [
        (_run(campaign, "default"), _run(campaign, "off")) for _ in steps("rounds", range(rounds))
    ]
    boxed, plain = (statistics.median(pair[i][0] for pair in pairs) for i in (0, 1))
    prints = tuple(run[1] for pair in pairs for run in pair)
    return SandboxFigures(start_ms, first_ms, campaign, (boxed / plain - 1) * 100, prints)


def _start_s(boxed: bool) -> float:
    """Time from the call to the first word of a Python that does nothing else [s]."""
    command = [sys.executable, "-S", "-c", "print()"]
    begun_s = time.perf_counter()
    with contextlib.ExitStack() as at_end:
        words, variables = command, dict(os.environ)
        descriptors: tuple[int, ...] = ()
        if boxed:
            view = SandboxView(readable=python_reads(), folder=Path.cwd())
            box = at_end.enter_context(Sandboxed(command, view))
            words, variables, descriptors = box.words, box.environment, box.descriptors
        child = subprocess.Popen(words, env=variables, pass_fds=descriptors, stdout=subprocess.PIPE)
        with child:
            assert child.stdout is not None
            child.stdout.read(1)
            return time.perf_counter() - begun_s


def _run(campaign: str, mode: str) -> tuple[float, str]:
    """Processor time of a run with one worker, and its fingerprint."""
    content = load_yaml(package_folder("conductor") / "campaigns" / f"{campaign}.yaml")
    content["autonomy"] = {**content.get("autonomy", {}), "sandbox": mode}
    with tempfile.TemporaryDirectory(prefix="twin-bench-") as folder:
        path = Path(folder, f"{campaign}.yaml")
        path.write_text(json.dumps(content), encoding="utf-8")  # JSON is YAML
        words = [sys.executable, "-m", "conductor", "run", str(path), "--workers", "1"]
        words += ["--view", "none", "--output", "json", "--out", str(Path(folder, "run"))]
        with (
            tempfile.TemporaryFile() as log,
            subprocess.Popen(words, stdout=subprocess.PIPE, stderr=log) as child,
        ):
            took_s = _processor_s(child)
            assert child.stdout is not None
            printed = child.stdout.read()
            log.seek(0)
            errors = log.read().decode(errors="replace")
    if child.returncode not in (0, 1):
        raise InfrastructureError(f"{campaign}: {errors.strip()[-300:]}")
    return took_s, str(json.loads(printed)["fingerprint"])


def _processor_s(child: subprocess.Popen[bytes]) -> float:
    """Processor time of a process and all below it until it ends, by looking often [s].

    What the kernel counts for a parent does not do: a ``bwrap`` ends before the namespace that it
    made, so nobody waits for what ran in there, and its time is counted nowhere.
    """
    used_s: dict[tuple[int, float], float] = {}
    root = psutil.Process(child.pid)
    while child.poll() is None:
        with contextlib.suppress(psutil.NoSuchProcess):
            for reading in read_tree(root):
                used_s[reading.pid, reading.born_s] = reading.cpu_s
        time.sleep(_LOOK_S)
    return sum(used_s.values())
