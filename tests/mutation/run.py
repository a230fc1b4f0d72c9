"""How many small changes of the pure cores go unnoticed: `python tests/mutation/run.py`
(`make mutation`).

mutmut changes operators, constants, arguments and conditions of the modules in ``[tool.mutmut]`` of
pyproject.toml, and runs for each change the unit tests that reach it. A seeded sample is taken,
because all of them take an hour. What survives is printed with its share; changes that change
nothing are argued one by one in ``equivalent.yaml``.

Exit codes: 0 few enough survive; 1 too many; 2 usage; 3 mutmut itself failed.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

sys.path.append(str(Path(__file__).parents[1] / "planted"))

from copies import ROOT, Copy

SURVIVE_MAX = 0.10
"""Largest share of the sample that may survive [-]."""
UNARGUED_MAX = 0.05
"""Largest share that may survive without being argued to change nothing [-]."""
EQUIVALENT = Path(__file__).with_name("equivalent.yaml")
_SURVIVED, _NO_TEST, _NOT_RUN = 0, 33, None
_TIMED_OUT = (-24, -9, 24, 36, 152, 255)
"""Exit codes that mutmut stores; every other one says that a test failed."""


@dataclass(frozen=True, slots=True)
class Survivor:
    """A change that no test has noticed."""

    name: str
    """As mutmut calls it."""
    function: str
    """``module.function`` or ``module.Class.method``."""
    old: str
    new: str
    tested: bool
    """Some test reaches the function at all."""
    equivalent: str
    """Why it changes nothing; empty: nobody has argued that."""


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500, help="changes in the sample (500)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes at once (2)")
    parser.add_argument("--only", default="", help="only functions that begin so, dotted")
    parser.add_argument("--out", type=Path, default=ROOT / "build/mutation", help="where it works")
    parser.add_argument("--output", choices=["human", "json"], default="human")
    asked = parser.parse_args()
    if asked.count < 1 or asked.jobs < 1:
        parser.error("--count and --jobs: expected 1 or more")
    return asked


class Mutants:
    """mutmut in a copy of the working tree."""

    def __init__(self, folder: Path, jobs: int) -> None:
        self.root = Copy(folder).root
        self._jobs = jobs

    def mutmut(self, *arguments: str) -> str:
        """Run a command of mutmut.

        Raises:
            RuntimeError: it failed; the last of what it said.
        """
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        done = subprocess.run(
            [sys.executable, "-m", "mutmut", *arguments],
            cwd=self.root,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            said = "\n".join((done.stdout + done.stderr).splitlines()[-15:])
            raise RuntimeError(f"mutmut {arguments[0]} ended with {done.returncode}:\n{said}")
        return done.stdout

    def make(self) -> list[str]:
        """Make all of them, without running any but the first one; their names."""
        # There is no command that only makes them.
        self.mutmut(
            "run", "--max-children", str(self._jobs), "conductor.core.lease.x_token_of__mutmut_1"
        )
        return sorted(self.results())

    def run(self, names: list[str]) -> None:
        """Run the tests of these."""
        self.mutmut("run", "--max-children", str(self._jobs), *names)

    def results(self) -> dict[str, int | None]:
        """Exit code of the tests of each; None: they have not been run."""
        found: dict[str, int | None] = {}
        for path in (self.root / "mutants").rglob("*.meta"):
            found |= json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
        return found

    def survivor(self, name: str, code: int | None, known: dict[tuple[str, ...], str]) -> Survivor:
        """What a surviving change is."""
        lines = self.mutmut("show", name).splitlines()
        old, new = (
            " ".join(
                line[1:].strip() for line in lines if line[:1] == sign and line[:3] != sign * 3
            )
            for sign in "-+"
        )
        function = function_of(name)
        why = known.get((function, old, new), "")
        return Survivor(name, function, old, new, code != _NO_TEST, why)


def function_of(name: str) -> str:
    """``conductor.core.fold.x__late__mutmut_3`` -> ``conductor.core.fold._late``."""
    module, _, last = name.rpartition("__mutmut_")[0].rpartition(".")
    parts = last.removeprefix("x").split("ǁ")  # methods: xǁClassǁmethod
    inner = last[2:] if len(parts) == 1 else ".".join(part for part in parts if part)
    return f"{module}.{inner}"


def argued() -> dict[tuple[str, ...], str]:
    """Changes that change nothing, with the reason."""
    entries = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8")) or []
    return {(entry["function"], entry["old"], entry["new"]): entry["why"] for entry in entries}


def main() -> int:
    """Take the sample, run it, print what survives."""
    asked = options()
    begin_s = time.monotonic()
    try:
        mutants = Mutants(asked.out.absolute(), asked.jobs)
        names = [n for n in mutants.make() if function_of(n).startswith(asked.only)]
        if not names:
            print(f"mutation: no function begins with {asked.only}", file=sys.stderr)
            return 2
        random.Random(asked.seed).shuffle(names)
        sample = sorted(names[: asked.count])
        mutants.run(sample)
        results = mutants.results()
        known = argued()
        survivors = [
            mutants.survivor(name, results[name], known)
            for name in sample
            if results[name] in (_SURVIVED, _NO_TEST, _NOT_RUN)
        ]
    except RuntimeError as error:
        print(f"mutation: {error}", file=sys.stderr)
        return 3
    timed_out = sum(results[name] in _TIMED_OUT for name in sample)
    report(asked, len(names), sample, survivors, timed_out, time.monotonic() - begin_s)
    unargued = sum(not survivor.equivalent for survivor in survivors)
    few = len(survivors) <= SURVIVE_MAX * len(sample) and unargued <= UNARGUED_MAX * len(sample)
    return 0 if few else 1


def report(
    asked: argparse.Namespace,
    population: int,
    sample: list[str],
    survivors: list[Survivor],
    timed_out: int,
    seconds: float,
) -> None:
    """Print what survived, and how many."""
    if asked.output == "json":
        print(json.dumps([asdict(survivor) for survivor in survivors], indent=1))
        return
    for survivor in survivors:
        why = survivor.equivalent or ("" if survivor.tested else "no test reaches it")
        print(f"{survivor.function}{f'  ({why})' if why else ''}")
        print(f"  - {survivor.old}\n  + {survivor.new}")
    sampled = Counter(function_of(name).rpartition(".")[0] for name in sample)
    survived = Counter(survivor.function.rpartition(".")[0] for survivor in survivors)
    for module, count in sorted(sampled.items()):
        print(f"{module}: {survived[module]} of {count}")
    unargued = sum(not survivor.equivalent for survivor in survivors)
    print(
        f"{len(survivors)} of {len(sample)} changes survive ({len(survivors) / len(sample):.1%}), "
        f"{unargued} of them not argued to change nothing ({unargued / len(sample):.1%}); "
        f"{timed_out} ran out of time; seed {asked.seed}, {population} in all, {seconds:.0f} s"
    )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("mutation: interrupted", file=sys.stderr)
        sys.exit(130)
