"""Coverage-guided fuzzing of every decoder with atheris, round robin: ``make fuzz``.

Every finding is written as a seed file, so that the tests fail until it is mended.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import hashlib
import importlib.util
import io
import multiprocessing
import os
import re
import resource
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
    parser.add_argument("--only", nargs="+", default=[""], help="parts of the targets' names")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed; pip install 'drivetwin[fuzz]'", file=sys.stderr)
        return 2
    import atheris

    end_s = time.monotonic() + options.minutes * 60
    # Once for all: it takes longer than the share of a target.
    words = io.StringIO()  # a line for each module
    with contextlib.redirect_stderr(words), atheris.instrument_imports(include=[*INSTRUMENTED]):
        _targets()
    unknown = [part for part in options.only if not any(part in name for name in _targets())]
    if unknown:
        print(f"--only {unknown[0]}: no such target; {', '.join(_targets())}", file=sys.stderr)
        return 2
    names = [name for name in _targets() if any(part in name for part in options.only)]
    return _round(names, end_s, options.corpus)


def _targets() -> dict[str, Target]:
    from fuzz_table import TARGETS

    return TARGETS


def _round(names: list[str], end_s: float, corpus: Path) -> int:
    """Fuzz each in a process of its own, with its share of what is left; 1: something was found."""
    found = 0
    for number, name in enumerate(names):
        began_s = time.monotonic()
        share_s = (end_s - began_s) / (len(names) - number)
        crashes = _fuzz(name, began_s + share_s, corpus / name)
        took_s = time.monotonic() - began_s
        words = f"{len(crashes)} found: {', '.join(crashes)}" if crashes else "nothing found"
        tries = _tries(_log(corpus / name))
        line = f"{number + 1}/{len(names)} {name}: {took_s:.0f} s, {tries:,} tries, {words}"
        print(line, flush=True)
        found += len(crashes)
    return 1 if found else 0


def _log(corpus: Path) -> Path:
    return corpus.with_name(f"{corpus.name}.log")


def _tries(log: Path) -> int:
    """How often the decoder was called, as libFuzzer says last."""
    numbers = re.findall(rb"^#(\d+)\s|executed_units: (\d+)", log.read_bytes(), re.MULTILINE)
    return max((int(a or b) for a, b in numbers), default=0)


def _fuzz(name: str, end_s: float, corpus: Path) -> list[str]:
    corpus.mkdir(parents=True, exist_ok=True)
    artifacts = corpus.parent / "found" / name
    artifacts.mkdir(parents=True, exist_ok=True)
    for path in seed_files(name, _targets()[name]):
        data = path.read_bytes()
        (corpus / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    options = {
        "max_total_time": max(1, round(end_s - time.monotonic())),
        "timeout": TRY_S,
        "rss_limit_mb": MEMORY_MB,
        "max_len": INPUT_BYTES_MAX,
        "artifact_prefix": f"{artifacts}/",
        "print_final_stats": 1,
        "close_fd_mask": 1,
    }
    arguments = [str(corpus), *(f"-{key}={value}" for key, value in options.items())]
    child = multiprocessing.get_context("fork").Process(
        target=_child, args=[name, arguments, _log(corpus)]
    )
    child.start()
    child.join()
    written = sorted(artifacts.iterdir())
    found = [_kept(name, path) for path in written if not _only_waited(name, path)]
    if child.exitcode and not written:
        return [f"ended with exit code {child.exitcode}, see {_log(corpus)}"]
    return found


def _only_waited(name: str, artifact: Path) -> bool:
    """Whether a try that took long got no processor, which others had: then it is no finding."""
    if not artifact.name.startswith(("timeout", "slow")):
        return False
    data = artifact.read_bytes()

    def again() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (TRY_S, TRY_S))
        with contextlib.suppress(Exception):
            attempt(_targets()[name], data)

    child = multiprocessing.get_context("fork").Process(target=again)
    child.start()
    child.join()
    if child.exitcode:
        return False
    artifact.unlink()
    return True


def _kept(name: str, artifact: Path) -> str:
    """Make a finding a seed."""
    kind = artifact.name.partition("-")[0]
    seed = SEEDS / name / f"{kind}-{hashlib.sha256(artifact.read_bytes()).hexdigest()[:12]}"
    artifact.replace(seed)
    return seed.name


def _child(name: str, arguments: list[str], log: Path) -> None:
    """libFuzzer ends its process, with whatever it has found."""
    import atheris

    with log.open("wb") as file:
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
    target = _targets()[name]

    def one(data: bytes) -> None:
        attempt(target, data)

    atheris.Setup([sys.argv[0], *arguments], one)
    try:
        atheris.Fuzz()
    except SystemExit as stop:
        # An exception was found. libFuzzer writes it to a file when C says that the process ends,
        # which `multiprocessing` would not.
        ctypes.CDLL(None).exit(int(stop.code or 0))


if __name__ == "__main__":
    sys.exit(main())
