"""What several sites cost beside one: the same workers, the same cases, the same two cores.

``PYTHONPATH=tests:tests/e2e python tests/sites_bench.py [--rounds N] [--output json] [--check]``
(root; the packages that tests/e2e/site_networks.py names). For each way it prints how long it took
from the command until the first lease (start), and from the first lease to the last result of
cases of the real simulator (work). Rounds alternate; the best of each way counts. --check exits
with 1 if three sites take 5 % more than one.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import yaml
from processes import Marked
from three_sites import MISSING, ThreeSites, three_sites
from waiting import wait_for

import conductor
from conductor.records.fingerprint import fingerprint

WORKERS = 3
REPEATS = 5
TARGET = 1.05


def campaign(folder: Path) -> Path:
    """chaos-16, several times."""
    source = Path(conductor.__file__).parent / "campaigns" / "chaos-16.yaml"
    data = yaml.safe_load(source.read_text())
    data["campaign"] = "bench"
    data["matrix"]["repeat"] = list(range(REPEATS))
    path = folder / "bench.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def one_machine(sites: ThreeSites, file: Path, out: Path) -> None:
    """Workers of this machine."""
    words = ("run", str(file), "--workers", str(WORKERS), "--slots", "1", "--out", str(out))
    child = sites.marked.start("conductor", *words, folder=sites.hub)
    child.communicate(timeout=600)


def one_site(sites: ThreeSites, file: Path, out: Path) -> None:
    """An allocation of three workers in the north."""
    at_sites(sites, file, out, ("--on", "slurm:north"), {"north": WORKERS})


def several_sites(sites: ThreeSites, file: Path, out: Path) -> None:
    """One worker each: north, pool, and a second cluster of Slurm's in the south."""
    on = ("--on", "slurm:north", "--on", "pbs:south", "--on", "k8s:pool")
    at_sites(sites, file, out, on, dict.fromkeys(("north", "south", "pool"), 1))


def at_sites(
    sites: ThreeSites, file: Path, out: Path, on: tuple[str, ...], workers: dict[str, int]
) -> None:
    """Submit with so many workers per allocation, and wait for the end."""
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
    sites.run("conductor", "resume", "bench", "--state", str(out))
    wait_for((out / "report.html").exists, "the end of the campaign")
    wait_for(lambda: not sites.marked.processes("serve"), "the end of the conductor")


def present(sites: ThreeSites, out: Path) -> int:
    """Workers that the conductor sees."""
    text = sites.run("conductor", "status", "--state", str(out), "--output", "json")
    return sum(bool(worker["present"]) for worker in json.loads(text)["workers"])


def measure(way, sites: ThreeSites, file: Path, out: Path) -> dict[str, float | str]:
    """Run one way; what it took."""
    began_s = time.time()
    way(sites, file, out)
    rows = [json.loads(line) for line in (out / "timeline.jsonl").read_text().splitlines()]
    first_s = min(row["at_s"] for row in rows if row["event"] == "leased")
    results = [row for row in rows if row["event"] == "committed"]
    # The first case of each worker waits for its simulator to start.
    firsts = {row["worker"]: row["at_s"] for row in reversed(results)}
    steady = [row["at_s"] for row in results if row["at_s"] > max(firsts.values())]
    assert len(firsts) == WORKERS, f"{len(firsts)} workers have brought results"
    return {
        "start_s": first_s - began_s,
        "work_s": results[-1]["at_s"] - first_s,
        "steady_per_s": len(steady) / (steady[-1] - max(firsts.values())),
        "steady_cases": len(steady),
        "fingerprint": fingerprint(out).sha256,
    }


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--output", choices=("human", "json"), default="human")
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    if MISSING:
        print(f"sites_bench: {MISSING}", file=sys.stderr)
        return 3
    ways = {"one machine": one_machine, "one site": one_site, "three sites": several_sites}
    found: dict[str, list[dict[str, float | str]]] = {name: [] for name in ways}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["DRIVETWIN_HOME"] = str(folder / "hub" / "home")
        marked = Marked()
        try:
            with three_sites(marked, folder) as sites:
                file = campaign(sites.hub)
                for round_ in range(asked.rounds):
                    for way, run in ways.items():
                        out = sites.hub / "runs" / f"{way.replace(' ', '-')}-{round_}"
                        found[way].append(measure(run, sites, file, out))
        finally:
            marked.end()
    best = {
        way: {
            "start_s": min(float(row["start_s"]) for row in rows),
            "work_s": min(float(row["work_s"]) for row in rows),
            "steady_per_s": max(float(row["steady_per_s"]) for row in rows),
        }
        for way, rows in found.items()
    }
    same = len({row["fingerprint"] for rows in found.values() for row in rows}) == 1
    ratio = best["one site"]["steady_per_s"] / best["three sites"]["steady_per_s"]
    result = {"ways": best, "three_to_one": ratio, "same_fingerprint": same}
    if asked.output == "json":
        print(json.dumps(result))
    else:
        for way, row in best.items():
            print(
                f"{way:12} start {row['start_s']:5.1f} s, work {row['work_s']:5.1f} s, "
                f"then {row['steady_per_s']:5.2f} cases/s"
            )
        print(f"three sites take {100 * (ratio - 1):+.1f} % of one's time per case; same: {same}")
    return 1 if asked.check and (ratio > TARGET or not same) else 0


if __name__ == "__main__":
    sys.exit(main())
