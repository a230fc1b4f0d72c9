"""The table of attacks: `python tests/redteam/run.py --out build/redteam` (`make redteam`).

Real processes and two users. Started again, it goes on where it was. Exit code 1: something is
open.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import sys
import time
from dataclasses import asdict
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[1] / "e2e"))
sys.path.append(str(Path(__file__).parents[1] / "faults"))
sys.path.append(str(Path(__file__).parents[1] / "unit" / "viewer"))

import redteam_table
from attacks import ATTACKS, ROWS, Attack, Found
from table import put_into
from theatre import Theatre

from twin.base.progress import progress


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/redteam"), help="where it goes on")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        type=int,
        choices=ROWS,
        metavar="ROW",
        help="only the attacks of this row, 1 to 16; may be repeated",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=10.0,
        help="how long the attack with garbage takes, half of it in quiet [min]",
    )
    parser.add_argument(
        "--cases", type=int, default=100, help="how many the stack drives that cheats in each"
    )
    parser.add_argument("--page", type=Path, help="put the table into this Markdown page")
    return parser.parse_args()


def one(attack: Attack, out: Path, minutes: float, cases: int) -> Found:
    """What came of an attack, from its file if there is one."""
    path = out / f"{attack.name}.json"
    if path.exists():
        return Found(**json.loads(path.read_text()))
    if attack.root and os.geteuid() != 0:
        return Found("not run", "needs root, to be two users")
    with Theatre(minutes, cases) as theatre:
        found = attack.attempt(theatre)
    if found.outcome != "not run":
        path.write_text(json.dumps(asdict(found), indent=1) + "\n")
    return found


def main() -> int:
    """Try what is left, then write the table."""
    asked = options()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # end in good order
    asked.out.mkdir(parents=True, exist_ok=True)
    out = asked.out.absolute()
    attacks = [each for each in ATTACKS if not asked.only or each.row in asked.only]
    found: list[tuple[Attack, Found]] = []
    with progress("redteam", "attacking", "attacks") as report:
        for number, each in enumerate(attacks):
            report(number, len(attacks))
            found.append((each, one(each, out, asked.minutes, asked.cases)))
            if found[-1][1].outcome == "open":
                report.say(f"row {each.row}: {each.what}: open: {found[-1][1].by}")
        report(len(attacks), len(attacks))
    text = redteam_table.markdown(found)
    print(text, end="")
    if asked.page is not None:
        when = time.strftime("%Y-%m-%d", time.gmtime())
        machine = f"{os.cpu_count()} cores, Linux {platform.release().partition('-')[0]}"
        told = f"\n{text}\n`make redteam`, {when}, {machine}.\n"
        put_into(asked.page, told, redteam_table.BEGIN, redteam_table.END)
    return 1 if any(each.outcome == "open" for _, each in found) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("redteam: interrupted; the same command goes on", file=sys.stderr)
        sys.exit(130)
