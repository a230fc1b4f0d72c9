"""Fingerprints of shipped campaigns, recorded against those of today: ``python fingerprints.py``.

Every campaign that was recorded on this machine's device class is run; names as arguments choose
some of them. Exit code 1: a fingerprint differs, so some KPI value has changed. The file beside it
is not to be made again when that happens.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import msgspec

from twin.base.software import device_class

RECORDED: dict[str, dict[str, Any]] = msgspec.json.decode(
    Path(__file__).with_suffix(".json").read_bytes()
)
"""Campaign -> ``device_class``, ``fingerprint`` and ``from``, where and when it was measured."""


def fingerprint_of(campaign: str, out: Path, *options: str) -> str:
    """Run a shipped campaign on this machine's CPU into ``out``; SHA-256 over its KPI values.

    ``options``: more of them for the run.

    Raises:
        AssertionError: the run did not come to its end.
    """
    conductor = [sys.executable, "-m", "conductor"]
    run = [
        *conductor,
        "run",
        campaign,
        "--out",
        str(out),
        "--view",
        "none",
        "--device",
        "cpu",
        *options,
    ]
    done = subprocess.run(run, capture_output=True, text=True)
    # 1: a verdict is not a pass, which is what some of these campaigns are for.
    assert done.returncode in (0, 1), done.stdout + done.stderr
    told = subprocess.run([*conductor, "fingerprint", str(out)], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return told.stdout.strip()


def main(names: list[str]) -> int:
    """Print recorded against now, a line per campaign."""
    here = device_class("cpu")
    differing = 0
    for name, recorded in RECORDED.items():
        if names and name not in names:
            continue
        if recorded["device_class"] != here:
            print(f"{name:10} left out: recorded on {recorded['device_class']}, this is {here}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            now = fingerprint_of(name, Path(folder) / name)
        same = now == recorded["fingerprint"]
        differing += not same
        said = "same" if same else "DIFFERS"
        print(f"{name:10} {said}: recorded {recorded['fingerprint'][:16]}, now {now[:16]}")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
