"""Many short cases of the real simulator, and what grows meanwhile.

``python tests/soak.py --cases 20000`` runs conductor, worker, simulator, stack, recorder and a web
viewer, and prints the slope of memory, threads and file descriptors of each per 1,000 cases.
Exit code 1: something grows.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil

ROLES = {
    "conductor": ("conductor", "run"),
    "worker": ("twin", "worker"),
    "simulator": ("twin", "sim"),
    "stack": ("devkit", "host"),
    "recorder": ("viewer", "record"),
    "viewer": ("viewer", "web --run"),
    "hub": ("viewer", "live --run"),
}
"""Role -> module or command, and its subcommand."""
MEMORY_MAX_MB = {"conductor": 8.0}
"""Per 1,000 cases; the conductor keeps what it knows of every case, by design, and Python's heap
grows in steps. Others: :data:`OTHERS_MEMORY_MAX_MB`."""
OTHERS_MEMORY_MAX_MB = 2.0
COUNT_MAX = 0.2
"""Threads, and file descriptors, per 1,000 cases."""
WARM_SHARE = 0.25
"""Of the cases, which fill caches and pools before anything is measured."""
SAMPLE_S = 2.0
SLOTS = 2
"""Cases together: they share ticks, leases and commits, most of what so short a case costs."""


@dataclass(slots=True)
class Course:
    """What one process used, over the cases that had ended."""

    pid: int
    cases: list[int] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    threads: list[float] = field(default_factory=list)
    files: list[float] = field(default_factory=list)


def main() -> int:
    """Run, and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--minutes", type=float, default=0.0, help="stop after this; 0: never")
    parser.add_argument("--folder", type=Path, help="where the campaign is written")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # what was started ends too
    folder = options.folder or Path(tempfile.mkdtemp(prefix="soak-"))
    folder.mkdir(parents=True, exist_ok=True)
    shared_mb = _shared_mb()
    until_s = time.monotonic() + options.minutes * 60 if options.minutes else float("inf")
    courses, done = _run(folder, options.cases, until_s)
    return _judge(courses, done, _shared_mb() - shared_mb)


def _run(folder: Path, cases: int, until_s: float) -> tuple[dict[str, Course], int]:
    out = folder / "soak"
    campaign = folder / "soak.yaml"
    campaign.write_text(json.dumps(_campaign(cases)))
    command = [sys.executable, "-m", "conductor", "run", str(campaign), "--out", str(out)]
    command += ["--workers", "1", "--slots", str(SLOTS)]
    run = subprocess.Popen(command, stdout=sys.stderr)
    viewer = None
    courses: dict[str, Course] = {}
    done = 0
    try:
        while run.poll() is None and time.monotonic() < until_s:
            if viewer is None and (out / "conductor.json").exists():
                viewer = subprocess.Popen(
                    [sys.executable, "-m", "viewer", "web", "--run", str(out)],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            done = _committed(out / "timeline.jsonl", done)
            # After the last case the conductor's process writes the report of all.
            for process in _family(run, viewer) if done < cases else ():
                _sample(courses, process, done)
            try:
                run.wait(SAMPLE_S)
            except subprocess.TimeoutExpired:
                continue
        return courses, _committed(out / "timeline.jsonl", done)
    finally:
        for child in (viewer, run):
            if child is not None and child.poll() is None:
                child.terminate()
                child.wait()


def _campaign(cases: int) -> dict[str, object]:
    """A few ticks of a tiny camera; recordings are made, and thrown away."""
    return {
        "campaign": "soak",
        "seed": 1,
        "view": "record",
        "recording": {"keep": "failed"},
        "scenario": {"duration_s": 0.15, "ego_speed_mps": 12},
        "camera": {"width": 64, "height": 36, "hz": 20},
        "matrix": {"repeat": list(range(cases))},
    }


_read: dict[Path, int] = {}


def _committed(timeline: Path, before: int) -> int:
    """Cases that have ended, by the conductor's own file; only what is new is read."""
    if not timeline.exists():
        return before
    with timeline.open("rb") as file:
        file.seek(_read.get(timeline, 0))
        text = file.read()
        end = text.rfind(b"\n") + 1
        _read[timeline] = _read.get(timeline, 0) + end
    return before + text[:end].count(b'"committed"')


def _family(*roots: subprocess.Popen[bytes] | None) -> list[psutil.Process]:
    found = []
    for root in roots:
        if root is not None and root.poll() is None:
            try:
                process = psutil.Process(root.pid)
                found += [process, *process.children(recursive=True)]
            except psutil.NoSuchProcess:
                continue
    return found


def _sample(courses: dict[str, Course], process: psutil.Process, done: int) -> None:
    try:
        words = " ".join(process.cmdline()[1:8])
        for role, (command, verb) in ROLES.items():
            if f"{command} {verb}" in words:
                course = courses.setdefault(role, Course(process.pid))
                if course.pid != process.pid:
                    courses[role] = course = Course(process.pid)
                course.cases.append(done)
                course.memory_mb.append(process.memory_info().rss / 1e6)
                course.threads.append(process.num_threads())
                course.files.append(process.num_fds())
                return
    except psutil.Error:
        return


def _slope(cases: list[int], values: list[float]) -> float:
    """Least squares, per 1,000 cases."""
    if len(cases) < 3 or cases[-1] == cases[0]:
        return float("nan")
    x_mean, y_mean = sum(cases) / len(cases), sum(values) / len(values)
    over = sum((x - x_mean) * (y - y_mean) for x, y in zip(cases, values, strict=True))
    return 1000.0 * over / sum((x - x_mean) ** 2 for x in cases)


def _judge(courses: dict[str, Course], done: int, shared_mb: float) -> int:
    print(f"{done} cases; per 1,000 of them, after the first {WARM_SHARE:.0%}:")
    print(f"{'process':12} {'memory':>12} {'threads':>9} {'files':>9} {'now':>10}  verdict")
    grows = []
    for role in ROLES:
        course = courses.get(role)
        if course is None or len(course.cases) < 3:
            grows.append(f"{role} (never seen)")
            continue
        first = next(i for i, n in enumerate(course.cases) if n >= WARM_SHARE * course.cases[-1])
        cases = course.cases[first:]
        memory, threads, files = (
            _slope(cases, values[first:])
            for values in (course.memory_mb, course.threads, course.files)
        )
        limit = MEMORY_MAX_MB.get(role, OTHERS_MEMORY_MAX_MB)
        # NaN, of too few samples, is no pass.
        flat = memory <= limit and threads <= COUNT_MAX and files <= COUNT_MAX
        print(
            f"{role:12} {memory:+9.3f} MB {threads:+9.3f} {files:+9.3f} "
            f"{course.memory_mb[-1]:7.0f} MB  {'flat' if flat else 'GROWS'}"
        )
        if not flat:
            grows.append(role)
    print(f"/dev/shm: {shared_mb:+.1f} MB of this user, after all")
    if shared_mb > 1.0:
        grows.append("/dev/shm")
    print(f"grows: {', '.join(grows)}" if grows else "nothing grows")
    return 1 if grows else 0


def _shared_mb() -> float:
    """What files of ours in /dev/shm take; those of other tests that run meanwhile are left out."""
    size = 0
    for path in Path("/dev/shm").glob("twin*"):
        try:
            found = path.lstat()
        except OSError:
            continue
        if found.st_uid == os.getuid():
            size += found.st_size
    return size / 1e6


if __name__ == "__main__":
    sys.exit(main())
