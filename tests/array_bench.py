"""Leasing beside the job-array way, on one private Slurm, with cases of uneven length.

``PYTHONPATH=tests/e2e python tests/array_bench.py [--long] [--check]`` prints JSON: makespan and
core-seconds of both at equal resources, and, with --long, what becomes of a case that is longer
than the array's fixed wall time (about four minutes more). --check exits with 1 if leasing is not
at least 1.5 times as fast, or loses a case.
"""

from __future__ import annotations

import argparse
import datetime
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from slurm_cluster import ENDED, SlurmCluster

WORKERS = 2
TARGET = 1.5
SECONDS = [5, 5, 10, 5, 40, 5, 10, 5, 20, 5, 5, 10, 5, 40, 5, 10]
"""Sim time of the cases [s]; so unequal are cases that stop early and cases that do not."""
LONG_S = 1500
"""Sim time of a case that does not fit into one minute of wall time [s]."""


def campaign(folder: Path, seconds: list[int]) -> Path:
    """Cases that creep along for so long; real simulator, tiny camera."""
    data = {
        "campaign": "uneven",
        "control_hz": 20,
        "deadline_s": 60,
        "scenario": {"ego_start_m": 180, "ego_speed_mps": 0.1},
        "camera": {"width": 64, "height": 36, "hz": 20},
        "autonomy": {"parameters": {"cruise_speed_mps": 0.1}},
        "cases": [{"scenario.duration_s": s, "repeat": n} for n, s in enumerate(seconds)],
    }
    path = folder / "uneven.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def jobs(cluster: SlurmCluster, job: str) -> list[dict[str, str]]:
    """A job, or all tasks of an array."""
    text = cluster.call("scontrol", "--oneliner", "show", "job", job).stdout
    return [
        dict(word.split("=", 1) for word in line.split() if "=" in word)
        for line in text.splitlines()
        if line
    ]


def run(cluster: SlurmCluster, job: str) -> dict[str, float]:
    """Wait for the end; what it took."""
    started_s = time.monotonic()
    found = jobs(cluster, job)
    while not all(each["JobState"] in ENDED for each in found):
        time.sleep(0.2)
        found = jobs(cluster, job)
    makespan_s = time.monotonic() - started_s
    core_s = 0.0
    for each in found:
        begin, end = (datetime.datetime.fromisoformat(each[k]) for k in ("StartTime", "EndTime"))
        core_s += int(each["NumCPUs"]) * (end - begin).total_seconds()
    return {"makespan_s": round(makespan_s, 1), "core_s": core_s}


def verdicts(folder: Path) -> int:
    """Cases with a verdict below ``folder``."""
    rows = [
        row
        for path in folder.rglob("outcomes.json")
        for row in json.loads(path.read_text())["cases"].values()
    ]
    return sum(row["outcome"] == "verdict" for row in rows)


def compare(cluster: SlurmCluster, seconds: list[int]) -> dict[str, dict[str, float]]:
    """Both ways, one after the other."""
    found = {}
    for way, options in {
        "leasing": ["--time", "00:30"],
        "array": ["--array", "--time", "00:03"],
    }.items():
        folder = Path(tempfile.mkdtemp(prefix=f"{way}-", dir=cluster.folder))
        asked = [
            "render",
            str(campaign(folder, seconds)),
            "--workers",
            str(WORKERS),
            "--nodes",
            "1",
        ]
        script = subprocess.run(
            [sys.executable, "-m", "hpc", *asked, *options, "--out", str(folder / "out")],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        # The request allows no less; what is compared is one minute for each case.
        script = script.replace("--time=00:03:00", "--time=00:01:00")
        (folder / "job.sh").write_text(script)
        result = run(cluster, cluster.submit(folder / "job.sh"))
        found[way] = result | {"lost": len(seconds) - verdicts(folder / "out")}
    return found


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    cluster = SlurmCluster()
    try:
        cluster.start()
        # Compiled kernels are there before anybody's time counts.
        compare(cluster, [1])
        uneven = compare(cluster, SECONDS)
        ratio = uneven["array"]["makespan_s"] / uneven["leasing"]["makespan_s"]
        report = {
            "cases": len(SECONDS),
            "workers": WORKERS,
            "uneven": uneven,
            "ratio": round(ratio, 2),
        }
        good = ratio >= TARGET and uneven["leasing"]["lost"] == 0
        if options.long:
            report["longer_than_the_wall_time"] = found = compare(cluster, [LONG_S, 5])
            good = good and found["leasing"]["lost"] == 0 < found["array"]["lost"]
        print(json.dumps(report, indent=1))
    finally:
        cluster.stop()
    sys.exit(1 if options.check and not good else 0)


if __name__ == "__main__":
    main()
