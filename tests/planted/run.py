"""Whether the tests notice: `python tests/planted/run.py` (`make planted`).

Plants one bug of the catalogue at a time in a copy of the working tree, runs the test that must
fail, then the file that holds it, and prints a table. Started again, it goes on where it was.
Exit codes: 0 every bug was caught; 1 one survived, or its entry or test does not hold; 2 usage.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import signal
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from queue import SimpleQueue

from copies import ROOT, Copy
from planting import Planted, PlantingError, load_catalogue, planted_source
from rich.console import Console
from rich.table import Table

from twin.base.progress import progress

NAMED_S = 300
"""Longest run of a named test; one that hangs with the bug planted has noticed it [s]."""
FILE_S = 180
"""Longest run of the file that holds it; what takes longer is not counted [s]."""
CAUGHT = "caught"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one planted bug."""

    name: str
    key: str
    """Digest of everything that the outcome was made from."""
    outcome: str
    """``caught``, ``survived``, ``does not apply`` or ``test fails without it``."""
    detail: str = ""
    seconds: float = 0.0
    """The named test took [s]."""
    file_failed: int = 0
    """Tests that failed in its file."""
    file_total: int = 0
    """Tests that ran there; 0: they took too long."""


def carry_out(copy: Copy, bug: Planted, key: str) -> Outcome:
    """Plant, test, undo."""
    path, text = planted_source(copy.root, bug)
    before = path.read_bytes()
    path.write_text(text, encoding="utf-8")
    try:
        begin_s = time.monotonic()
        code, output = copy.pytest(["-x", bug.test], NAMED_S)
        seconds = round(time.monotonic() - begin_s, 1)
        if code == 0:
            return Outcome(bug.name, key, "survived", bug.test, seconds)
        if code not in (1, None):
            return Outcome(bug.name, key, "does not apply", _last(output), seconds)
        failed, total = 0, 0
        if code is not None:  # or its file hangs as well
            _, output = copy.pytest([bug.test_file], FILE_S)
            failed, total = _counts(output)
        return Outcome(bug.name, key, CAUGHT, "", seconds, failed, total)
    finally:
        path.write_bytes(before)


def _last(output: str) -> str:
    lines = [line for line in output.splitlines() if line.strip()]
    return lines[-1] if lines else "pytest said nothing"


def _counts(output: str) -> tuple[int, int]:
    """Failed tests and all that ran, from pytest's last line."""
    numbers = {word: int(n) for n, word in re.findall(r"(\d+) (failed|passed|error)", output)}
    failed = numbers.get("failed", 0) + numbers.get("error", 0)
    return failed, failed + numbers.get("passed", 0)


def key_of(bug: Planted) -> str:
    """Digest of the entry, the planted file and the test's file: an outcome holds as long."""
    try:
        text = planted_source(ROOT, bug)[1]
    except PlantingError as error:
        text = str(error)
    test = ROOT / bug.test_file
    parts = [
        bug.name,
        bug.symbol,
        bug.test,
        text,
        test.read_text(encoding="utf-8") if test.is_file() else "",
    ]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def unsound(copy: Copy, bugs: Iterable[Planted]) -> dict[str, str]:
    """Named tests that do not pass without a bug, with what pytest says."""
    tests = sorted({bug.test for bug in bugs})
    if not tests:
        return {}
    code, output = copy.pytest(["-rfE", *tests], NAMED_S * 4)
    if code == 0:
        return {}
    if code == 1:
        failing = re.findall(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
        wrong = {t: "fails" for t in tests if any(f.startswith(t) for f in failing)}
        if wrong:
            return wrong
    return dict.fromkeys(tests, _last(output))


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build/planted", help="it goes on there")
    parser.add_argument("--jobs", type=int, default=2, help="bugs at once (default: 2)")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="only bugs of this name, package or module; may hold * and be repeated",
    )
    parser.add_argument("--fresh", action="store_true", help="forget earlier outcomes")
    parser.add_argument("--output", choices=["human", "json"], default="human")
    asked = parser.parse_args()
    if asked.jobs < 1:
        parser.error(f"--jobs {asked.jobs}: expected 1 or more")
    return asked


def chosen(only: list[str]) -> list[Planted]:
    """The bugs that were asked for."""
    bugs = load_catalogue()
    if not only:
        return bugs
    return [
        bug
        for bug in bugs
        if any(fnmatch(n, o) for n in (bug.name, bug.package, bug.module) for o in only)
    ]


def main() -> int:
    """Carry out what is left, then print the table."""
    asked = options()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        bugs = chosen(asked.only)
    except PlantingError as error:
        print(f"planted: {error}", file=sys.stderr)
        return 1
    if not bugs:
        print(f"planted: no bug is called {', '.join(asked.only)}", file=sys.stderr)
        return 2
    out = asked.out.absolute()
    if asked.fresh:
        shutil.rmtree(out / "outcomes", ignore_errors=True)
    outcomes = _carry_out_all(bugs, out, asked.jobs)
    (out / "planted.json").write_text(_json(outcomes))
    if asked.output == "json":
        print(_json(outcomes), end="")
    else:
        _print(bugs, outcomes)
    return 0 if all(outcome.outcome == CAUGHT for outcome in outcomes) else 1


def _carry_out_all(bugs: list[Planted], out: Path, jobs: int) -> list[Outcome]:
    """In the order of the catalogue; each is kept as soon as it is known."""
    folder = out / "outcomes"
    folder.mkdir(parents=True, exist_ok=True)
    known: dict[str, Outcome] = {}
    for bug in bugs:
        kept = folder / f"{bug.name}.json"
        if kept.exists():
            outcome = Outcome(**json.loads(kept.read_text()))
            if outcome.key == key_of(bug) and outcome.outcome == CAUGHT:
                known[bug.name] = outcome
    left = [bug for bug in bugs if bug.name not in known]
    with progress("planted", "planting bugs", "bugs") as report:
        report(len(known), len(bugs))
        copies: SimpleQueue[Copy] = SimpleQueue()
        made = [Copy(out / f"tree-{n}") for n in range(min(jobs, len(left)))]
        for copy in made:
            copies.put(copy)
        wrong = unsound(made[0], left) if made else {}

        def one(bug: Planted) -> Outcome:
            key = key_of(bug)
            if bug.test in wrong:
                words = f"{bug.test}: {wrong[bug.test]}"
                return Outcome(bug.name, key, "test fails without it", words)
            copy = copies.get()
            try:
                return carry_out(copy, bug, key)
            except PlantingError as error:
                return Outcome(bug.name, key, "does not apply", str(error))
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(jobs) as pool:
            running = [pool.submit(one, bug) for bug in left]
            try:
                for future in as_completed(running):
                    outcome = future.result()
                    known[outcome.name] = outcome
                    (folder / f"{outcome.name}.json").write_text(json.dumps(asdict(outcome)))
                    if outcome.outcome != CAUGHT:
                        report.say(f"{outcome.name}: {outcome.outcome}: {outcome.detail}")
                    report(len(known), len(bugs))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    return [known[bug.name] for bug in bugs]


def _json(outcomes: list[Outcome]) -> str:
    return json.dumps([asdict(outcome) for outcome in outcomes], indent=1) + "\n"


def _print(bugs: list[Planted], outcomes: list[Outcome]) -> None:
    table = Table("planted bug", "symbol", "kind", "outcome", "test [s]", "its file fails")
    for bug, outcome in zip(bugs, outcomes, strict=True):
        counts = f"{outcome.file_failed} of {outcome.file_total}" if outcome.file_total else "-"
        style = None if outcome.outcome == CAUGHT else "red"
        cells = (bug.name, bug.symbol, bug.kind, outcome.outcome, f"{outcome.seconds:.1f}", counts)
        table.add_row(*cells, style=style)
    Console(width=None if sys.stdout.isatty() else 160).print(table)
    caught = sum(outcome.outcome == CAUGHT for outcome in outcomes)
    seconds = sum(outcome.seconds for outcome in outcomes)
    print(f"{caught} of {len(outcomes)} planted bugs caught; named tests took {seconds:.0f} s")


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("planted: interrupted; the same command goes on", file=sys.stderr)
        sys.exit(130)
