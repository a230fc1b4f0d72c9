"""What several sites cost beside one: the same workers, the same cases, the same two cores.

``PYTHONPATH=tests:tests/e2e python tests/sites_bench.py [--pairs N] [--repeats N] [--output json]
[--check]`` (root; the packages that tests/e2e/site_networks.py names; some minutes per pair).

A pair is a run at one site and a run at three, of the same cases of the real simulator; every other
pair begins with the three. Of each run: time from the command until the first lease (start), then
wall time per case while all workers work, and processor time per case of everything that the bench
has started, by a control group of its own. The ratio of three sites to one is the median of the
pairs, so what others do on the machine has to differ within most pairs to be seen in it. --check
exits with 1 if either ratio is above 1.05.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from processes import Marked
from three_sites import MISSING, ThreeSites, repeated_chaos, three_sites
from waiting import wait_for

from conductor.records.fingerprint import fingerprint

WORKERS = 3
TARGET = 1.05
GROUPS = (("/sys/fs/cgroup/cpuacct", "cpuacct.usage"), ("/sys/fs/cgroup", "cpu.stat"))
"""Where a control group is made, and its file with the processor time; versions 1 and 2."""
PER_CASE = ("wall_per_case_s", "cpu_per_case_s")

Row = dict[str, float | str]


class CpuTime:
    """Processor time of this process and of all that it starts from now on."""

    def __init__(self) -> None:
        for root, name in GROUPS:
            self.folder = Path(root) / f"sites-bench-{os.getpid()}"
            self._file = self.folder / name
            with contextlib.suppress(OSError):
                self.folder.mkdir()
                (self.folder / "cgroup.procs").write_text(str(os.getpid()))
                self.read_s()
                return
            with contextlib.suppress(OSError):
                self.folder.rmdir()
        raise RuntimeError("no control group can be made here")

    def read_s(self) -> float:
        """All of it so far [s]."""
        text = self._file.read_text().split()
        return int(text[0]) / 1e9 if len(text) == 1 else int(text[1]) / 1e6

    def close(self) -> None:
        """Leave the group, and remove it."""
        (self.folder.parent / "cgroup.procs").write_text(str(os.getpid()))
        with contextlib.suppress(OSError):
            self.folder.rmdir()


@contextlib.contextmanager
def cpu_time() -> Iterator[CpuTime]:
    """A group of its own for the block."""
    found = CpuTime()
    try:
        yield found
    finally:
        found.close()


WAYS = {
    # An allocation of three workers, or one worker each.
    "one site": (("--on", "slurm:north"), {"north": WORKERS}),
    "three sites": (
        ("--on", "slurm:north", "--on", "pbs:south", "--on", "k8s:pool"),
        dict.fromkeys(("north", "south", "pool"), 1),
    ),
}
"""Options and workers of each allocation."""


def at_sites(sites: ThreeSites, file: Path, out: Path, way: str, cpu: CpuTime) -> float:
    """Submit, and wait for the end; processor time from the first lease on [s]."""
    on, workers = WAYS[way]
    data = yaml.safe_load(sites.file.read_text())
    for name, count in workers.items():
        data["sites"][name]["workers"] = count
    south = data["sites"]["south"]
    south.pop("dials_out", None)  # how a site is asked is no part of what is measured
    south |= {"reach": sites.pbs.reach(), "folder": str(sites.pbs.folder / "jobs")}
    sites.file.write_text(yaml.safe_dump(data))
    sites.hpc("submit", str(file), *on, "--out", str(out), "--time", "00:30")
    # Begin together: a busy machine may start the last worker when the others are done.
    sites.run("conductor", "pause", "bench", "--state", str(out))
    wait_for(lambda: present(sites, out) == WORKERS, "all workers")
    before_s = cpu.read_s()
    sites.run("conductor", "resume", "bench", "--state", str(out))
    wait_for((out / "report.html").exists, "the end of the campaign", patience_s=3600.0)
    used_s = cpu.read_s() - before_s
    wait_for(lambda: not sites.marked.processes("serve"), "the end of the conductor")
    return used_s


def present(sites: ThreeSites, out: Path) -> int:
    """Workers that the conductor sees."""
    text = sites.run("conductor", "status", "--state", str(out), "--output", "json")
    return sum(bool(worker["present"]) for worker in json.loads(text)["workers"])


def measure(way: str, sites: ThreeSites, file: Path, out: Path, cpu: CpuTime) -> Row:
    """Run one way; what it took."""
    began_s = time.time()
    used_s = at_sites(sites, file, out, way, cpu)
    rows = [json.loads(line) for line in (out / "timeline.jsonl").read_text().splitlines()]
    first_s = min(row["at_s"] for row in rows if row["event"] == "leased")
    results = [row for row in rows if row["event"] == "committed"]
    # The first case of each worker waits for its simulator to start; when one has no more to do,
    # the others have the machine to themselves.
    firsts = {row["worker"]: row["at_s"] for row in reversed(results)}
    lasts = {row["worker"]: row["at_s"] for row in results}
    from_s, until_s = max(firsts.values()), min(lasts.values())
    steady = [row["at_s"] for row in results if from_s < row["at_s"] <= until_s]
    assert len(firsts) == WORKERS, f"{len(firsts)} workers have brought results"
    assert len(steady) > 1, "too few cases: give more --repeats"
    return {
        "start_s": first_s - began_s,
        "work_s": results[-1]["at_s"] - first_s,
        "wall_per_case_s": (steady[-1] - from_s) / len(steady),
        "cpu_per_case_s": used_s / len(results),
        "steady_cases": len(steady),
        "fingerprint": fingerprint(out).sha256,
    }


def summary(pairs: list[dict[str, Row]]) -> dict[str, Any]:
    """Medians, and the ratios of three sites to one."""
    ways = {
        way: {
            name: statistics.median(float(pair[way][name]) for pair in pairs)
            for name in ("start_s", "work_s", *PER_CASE)
        }
        for way in WAYS
    }
    ratios = {
        name: sorted(float(p["three sites"][name]) / float(p["one site"][name]) for p in pairs)
        for name in PER_CASE
    }
    return {
        "ways": ways,
        "ratios": ratios,
        "three_to_one": {name: statistics.median(found) for name, found in ratios.items()},
        "same_fingerprint": len({row["fingerprint"] for p in pairs for row in p.values()}) == 1,
        "load": os.getloadavg()[0],
    }


def measured(pairs: int, repeats: int) -> list[dict[str, Row]]:
    """The rows of all pairs."""
    found: list[dict[str, Row]] = []
    with tempfile.TemporaryDirectory() as name, cpu_time() as cpu:
        folder = Path(name)
        os.environ["DRIVETWIN_HOME"] = str(folder / "hub" / "home")
        marked = Marked()
        try:
            with three_sites(marked, folder) as sites:
                for way in WAYS:  # whose kernels are compiled then, at every site
                    warm = repeated_chaos(sites.hub, 1)
                    at_sites(sites, warm, sites.hub / "runs" / f"warm-{len(way)}", way, cpu)
                file = repeated_chaos(sites.hub, repeats)
                for number in range(pairs):
                    row: dict[str, Row] = {}
                    for way in [*WAYS][:: 1 if number % 2 == 0 else -1]:
                        out = sites.hub / "runs" / f"{way.replace(' ', '-')}-{number}"
                        row[way] = measure(way, sites, file, out, cpu)
                    found.append(row)
                    ratio = {n: row["three sites"][n] / row["one site"][n] for n in PER_CASE}
                    print(f"pair {number + 1} of {pairs}: {ratio}", file=sys.stderr)
        finally:
            marked.end()
    return found


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=10, help="times 16 cases of a run")
    parser.add_argument("--output", choices=("human", "json"), default="human")
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    if MISSING:
        print(f"sites_bench: {MISSING}", file=sys.stderr)
        return 3
    result = summary(measured(asked.pairs, asked.repeats))
    ratios, same = result["ratios"], result["same_fingerprint"]
    if asked.output == "json":
        print(json.dumps(result))
    else:
        for way, row in result["ways"].items():
            print(
                f"{way:12} start {row['start_s']:5.1f} s, work {row['work_s']:5.1f} s, then "
                f"{row['wall_per_case_s']:.3f} s and {row['cpu_per_case_s']:.3f} CPU s per case"
            )
        for name, found in ratios.items():
            middle = 100 * (statistics.median(found) - 1)
            low, high = (100 * (found[at] - 1) for at in (0, -1))
            print(f"three sites to one, {name}: {middle:+.1f} % ({low:+.1f} to {high:+.1f})")
        print(f"same fingerprint: {same}; load at the end {result['load']:.1f}")
    worst = max(result["three_to_one"].values())
    return 1 if asked.check and (worst > TARGET or not same) else 0


if __name__ == "__main__":
    sys.exit(main())
