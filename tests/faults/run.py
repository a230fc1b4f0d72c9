"""The table of faults: `python tests/faults/run.py --out build/faults` (`make faults`).

Real processes in network namespaces, hurt in every way that docs/reliability.md lists. Started
again, it goes on where it was. Exit code 1: something was lost, doubled or wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import signal
import sys
import time
from dataclasses import asdict
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[1] / "e2e"))

import rows
import table
from injection import Outcome
from kinds import FAULTS
from ledger import run_in_peace
from pace import Pace, measure

from twin.base.progress import progress

PROGRAMS = {"ip": "iproute2", "setpriv": "util-linux", "mount": "mount", "cc": "gcc libc6-dev"}
"""Command -> Debian package."""


def missing() -> str:
    """Why faults cannot be injected here, or nothing."""
    if os.geteuid() != 0:
        return "needs root for network namespaces and mounts"
    absent = [package for name, package in PROGRAMS.items() if shutil.which(name) is None]
    if absent:
        return f"needs the Debian packages {' '.join(absent)}"
    return "" if Path("/dev/net/tun").exists() else "needs /dev/net/tun"


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/faults"), help="where it goes on")
    parser.add_argument("--times", type=int, default=5, help="injections of each fault")
    parser.add_argument(
        "--storms", type=int, default=15, help=f"storms of {rows.STORM_INJECTIONS} injections"
    )
    names = [*FAULTS, rows.STORM]
    what = "only this row; may be repeated: " + ", ".join(names).replace("%", "%%")
    parser.add_argument(
        "--only", action="append", default=[], choices=names, metavar="FAULT", help=what
    )
    parser.add_argument("--page", type=Path, help="put the table into this Markdown page")
    return parser.parse_args()


def one(run: rows.Run, out: Path, quiet: rows.Quiet) -> Outcome:
    """The outcome of a run, from its file if there is one."""
    path = out / "outcomes" / f"{run.name}.json"
    if path.exists():
        found = Outcome(**json.loads(path.read_text()))
        if sum(found.injected.values()) >= run.times:
            return found
    folder = out / "runs" / run.name
    shutil.rmtree(folder, ignore_errors=True)
    found = rows.carry_out(run, folder, quiet)
    path.parent.mkdir(parents=True, exist_ok=True)
    found.write(path)
    return found


def paced(out: Path) -> Pace:
    """Whether viewers slow cases down, from its file if there is one."""
    path = out / "pace.json"
    if not path.exists():
        folder = out / "runs" / "pace"
        shutil.rmtree(folder, ignore_errors=True)
        path.write_text(json.dumps(asdict(measure(folder))) + "\n")
    return Pace(**json.loads(path.read_text()))


def main() -> int:
    """Carry out what is left, then write the table."""
    asked = options()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # end in good order
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored, if started in background
    if problem := missing():
        print(f"faults: {problem}", file=sys.stderr)
        return 2
    asked.out.mkdir(parents=True, exist_ok=True)
    out = asked.out.absolute()
    quiet = run_in_peace(out / "quiet")
    runs = rows.runs(asked.times, asked.storms, asked.only)
    total, done, found = sum(run.times for run in runs), 0, []
    with progress("faults", "hurting processes", "faults") as report:
        report(0, total)
        for run in runs:
            outcome = one(run, out, quiet)
            found.append(outcome)
            done += run.times
            if outcome.lost or outcome.doubled or outcome.wrong or not outcome.ended:
                report.say(f"{run.row}: see {out / 'runs' / run.name}")
            report(done, total)
            table.write(table.tabulate(found), out)
    tabulated = table.tabulate(found)
    text = table.markdown(tabulated)
    if not asked.only:
        text += f"\n{paced(out).words()}\n"
    print(text, end="")
    if asked.page is not None:
        load = f"load {os.getloadavg()[2]:.0f} in the last quarter of an hour"
        machine = f"{os.cpu_count()} cores, {load}, Linux {platform.release().partition('-')[0]}"
        when = time.strftime("%Y-%m-%d", time.gmtime())
        table.put_into(asked.page, f"\n{text}\n`make faults`, {when}, {machine}.\n")
    return 0 if all(row.clean for row in tabulated) and all(o.ended for o in found) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("faults: interrupted; the same command goes on", file=sys.stderr)
        sys.exit(130)
