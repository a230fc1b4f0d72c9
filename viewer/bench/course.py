"""A campaign's progress, and what its processes have used: samples while it runs."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from viewer.bench.compare import CourseSample

PARTS = {
    ("twin", "sim"): "simulators",
    ("twin", "worker"): "workers",
    ("twin", "judge"): "judge",
    ("devkit", "host"): "stacks",
    ("conductor", "run"): "conductor",
    ("twin.fabric.front.process",): "front",
}
"""Module and command of a process -> part of a campaign that it is."""
OTHERS = "others"


def part_of(words: Sequence[str]) -> str:
    """Part of a campaign that a process is, by its command line."""
    if "-m" not in words:
        return OTHERS
    # Of a sandbox, whose own options come first, the last one.
    first = len(words) - 1 - list(reversed(words)).index("-m")
    module, command = (*words[first + 1 : first + 3], "", "")[:2]
    return PARTS.get((module, command)) or PARTS.get((module,), OTHERS)


class CampaignCourse:
    """Looks at a ``conductor run`` and the timeline that it writes."""

    def __init__(self, pid: int, out: Path) -> None:
        """``pid``: of the conductor; ``out``: its campaign folder."""
        self.samples: list[CourseSample] = []
        self.workers = 0
        """Workers that have had a lease."""
        self._process = psutil.Process(pid)
        self._timeline = out / "timeline.jsonl"
        self._read = 0
        self._names: set[str] = set()
        self._cases = 0

    def look(self) -> bool:
        """A sample, if a case was leased for the first time or has ended since the last one."""
        before = self._cases, bool(self._names)
        for line in self._lines():
            event = json.loads(line)
            if event["event"] == "leased":
                self._names.add(event["worker"])
            elif event["event"] == "committed":
                self._cases += 1
        self.workers = len(self._names)
        if (self._cases, bool(self._names)) == before:
            return False
        used_s = self._used_s()
        sample = CourseSample(self._cases, time.monotonic(), sum(used_s.values()), used_s)
        self.samples.append(sample)
        return True

    def _lines(self) -> list[bytes]:
        """Whole lines that are new."""
        if not self._timeline.exists():
            return []
        with self._timeline.open("rb") as file:
            file.seek(self._read)
            data = file.read()
        data = data[: data.rfind(b"\n") + 1]
        self._read += len(data)
        return data.splitlines()

    def _used_s(self) -> dict[str, float]:
        """Processor time of the conductor and of all below it that run, by part [s]."""
        used: dict[str, float] = {}
        try:
            family = [self._process, *self._process.children(recursive=True)]
        except psutil.NoSuchProcess:
            return used
        for process in family:
            try:
                times, words = process.cpu_times(), process.cmdline()
            except psutil.NoSuchProcess:
                continue
            part = part_of(words)
            used[part] = used.get(part, 0.0) + times.user + times.system
        return used
