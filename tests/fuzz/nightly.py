"""Coverage-guided fuzzing of every decoder with atheris, round robin: ``make fuzz``.

Every finding is written as a seed file, so that the tests fail until it is mended.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_target import SEEDS, Target, attempt, seed_files

INPUT_BYTES_MAX = 1 << 16
"""Longest input that is made [bytes]; seeds may be longer."""
TRY_S = 20
"""A try that takes longer hangs [s]."""
MEMORY_MB = 3000
"""A try that needs more leaks, or believed a number in a file [MB]."""
INSTRUMENTED = ("schemas", "conductor", "devkit", "twin.fabric", "twin.world", "viewer", "yaml")


def main() -> int:
    """Parse the command line, and fuzz."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="of all targets together")
    parser.add_argument(
        "--corpus", type=Path, default=Path("build/fuzz"), help="what it has learnt"
    )
    parser.add_argument("--only", default="", help="part of the targets' names")
    parser.add_argument("--child", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed; pip install 'drivetwin[fuzz]'", file=sys.stderr)
        return 2
    if options.child:
        return _child(options.child[0], options.child[1:])
    names = [name for name in _targets() if options.only in name]
    if not names:
        print(f"--only {options.only}: no such target; {', '.join(_targets())}", file=sys.stderr)
        return 2
    return _round(names, options.minutes * 60 / len(names), options.corpus)


def _targets() -> dict[str, Target]:
    from fuzz_table import TARGETS

    return TARGETS


def _round(names: list[str], seconds: float, corpus: Path) -> int:
    """Fuzz each in a process of its own; 1: something was found."""
    found = 0
    for number, name in enumerate(names, 1):
        began = time.monotonic()
        crashes = _fuzz(name, max(1, round(seconds)), corpus / name)
        took_s = time.monotonic() - began
        words = f"{len(crashes)} found: {', '.join(crashes)}" if crashes else "nothing found"
        print(f"{number}/{len(names)} {name}: {took_s:.0f} s, {words}", flush=True)
        found += len(crashes)
    return 1 if found else 0


def _fuzz(name: str, seconds: int, corpus: Path) -> list[str]:
    corpus.mkdir(parents=True, exist_ok=True)
    artifacts = corpus.parent / "found" / name
    artifacts.mkdir(parents=True, exist_ok=True)
    for path in seed_files(name, _targets()[name]):
        data = path.read_bytes()
        (corpus / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    command = [sys.executable, str(Path(__file__)), "--child", name, str(corpus)]
    options = {
        "max_total_time": seconds,
        "timeout": TRY_S,
        "rss_limit_mb": MEMORY_MB,
        "max_len": INPUT_BYTES_MAX,
        "artifact_prefix": f"{artifacts}/",
        "print_final_stats": 1,
        "close_fd_mask": 1,
    }
    with (corpus.parent / f"{name}.log").open("wb") as log:
        subprocess.run(
            [*command, *(f"-{key}={value}" for key, value in options.items())],
            stdout=log,
            stderr=log,
            check=False,
        )
    return [_kept(name, path) for path in sorted(artifacts.iterdir())]


def _kept(name: str, artifact: Path) -> str:
    """Make a finding a seed."""
    kind = artifact.name.partition("-")[0]
    seed = SEEDS / name / f"{kind}-{hashlib.sha256(artifact.read_bytes()).hexdigest()[:12]}"
    artifact.replace(seed)
    return seed.name


def _child(name: str, arguments: list[str]) -> int:
    import atheris

    with atheris.instrument_imports(include=list(INSTRUMENTED)):
        target = _targets()[name]

    def one(data: bytes) -> None:
        attempt(target, data)

    atheris.Setup([sys.argv[0], *arguments], one)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
