"""Checks that a worker on a CPU and one on a GPU share a campaign; needs no test runner.

    python tests/device/mixing_check.py --device cuda:0 --out FOLDER [CAMPAIGN ...]

Runs each portable campaign (default: chaos-16 and aeb-demo-int8) on the CPU alone, on the device
alone and by one worker of each at once. All fingerprints must be the same, and both machines must
have committed cases of the last run. Exit code 1: they are not. ``--device cpu`` is a rehearsal.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from conductor.records.outcomes import read_outcomes
from schemas.device_class import PORTABLE
from twin.base.software import device_class

WAIT_S = 600


def conducted(*words: str) -> subprocess.Popen[str]:
    """A command of the conductor, begun."""
    return subprocess.Popen(
        [sys.executable, "-m", "conductor", *words], text=True, stdout=subprocess.PIPE
    )


def ran(campaign: str, out: Path, device: str, helper: str = "") -> str:
    """Run a campaign with a worker on ``device``, and with another one on ``helper``.

    Returns:
        Its fingerprint.
    """
    run = conducted(
        *("run", campaign, "--out", str(out), "--view", "none"),
        *("--workers", "1", "--slots", "2", "--device", device),
    )
    words = [sys.executable, "-m", "twin", "worker", "--state", str(out), "--wait", "60"]
    words += ["--device", helper, "--slots", "2"]
    beside = subprocess.Popen(words) if helper else None
    try:
        run.communicate(timeout=WAIT_S)
        if run.returncode not in (0, 1):  # 1: a verdict is no pass, which is fine
            raise SystemExit(f"{campaign}: conductor run ended with {run.returncode}")
    finally:
        for process in (run, beside):
            if process is not None and process.poll() is None:
                process.terminate()
                process.wait()
    told, _ = conducted("fingerprint", str(out)).communicate(timeout=60)
    return told.strip()


def main() -> int:
    """Print a line per campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("campaigns", nargs="*", default=["chaos-16", "aeb-demo-int8"])
    options = parser.parse_args()
    wanted = sorted({device_class("cpu"), device_class(options.device)})
    failed = 0
    for campaign in options.campaigns:
        folder: Path = options.out / Path(campaign).stem
        found = [
            ran(campaign, folder / "cpu", "cpu"),
            ran(campaign, folder / "device", options.device),
            ran(campaign, folder / "mixed", "cpu", options.device),
        ]
        outcomes = read_outcomes(folder / "mixed")
        helped = len({case.worker for case in outcomes.cases.values()}) == 2
        same = len(set(found)) == 1
        mixed = helped and outcomes.machines == wanted and outcomes.device_classes == [PORTABLE]
        failed += not (same and mixed)
        print(
            f"{campaign}: fingerprints {'the same' if same else 'DIFFER'} {found}, "
            f"{'both' if helped else 'NOT BOTH'} committed, classes {outcomes.device_classes}, "
            f"machines {outcomes.machines}"
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
