"""What it means that a decoder stands hostile bytes: a value, or its own refusal in one line."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

SEEDS = Path(__file__).parent / "seeds"
"""A folder per target; what is in it is tried by every run of the tests."""

LINE_MAX = 2000
"""Longest line of a refusal [characters]: hostile input must not fill a terminal."""


@dataclass(frozen=True, slots=True)
class Target:
    """One decoder."""

    run: Callable[[bytes], object]
    """Decodes the bytes, and goes as far with them as the program would."""
    refusals: tuple[type[Exception], ...]
    """What its documentation says that it raises."""
    shipped: tuple[Path, ...] = ()
    """Files of the repository that serve as seeds beside those of its folder."""
    lines_max: int = 1
    """A campaign's refusal has a line per mistake."""
    cost: int = 1
    """About how many milliseconds a try takes; the dearer, the fewer tries in the tests."""


class BrokenTargetError(AssertionError):
    """A refusal that is no line for people."""


def attempt(target: Target, data: bytes) -> bool:
    """Give ``data`` to the target; whether it was accepted.

    Raises:
        Exception: anything but a refusal as documented: what fuzzing is meant to find.
    """
    try:
        target.run(data)
    except target.refusals as error:
        _check_words(str(error), target.lines_max)
        return False
    return True


def seed_files(name: str, target: Target) -> list[Path]:
    """Everything that the tests and the fuzzer begin with."""
    return [*sorted((SEEDS / name).glob("*")), *target.shipped]


def _check_words(words: str, lines_max: int) -> None:
    lines = words.splitlines()
    if not lines or not all(line.strip() for line in lines):
        raise BrokenTargetError("a refusal without words")
    if len(lines) > lines_max:
        raise BrokenTargetError(f"a refusal of {len(lines)} lines: {words[:500]!r}")
    longest = max(map(len, lines))
    if longest > LINE_MAX:
        raise BrokenTargetError(f"a refusal of {longest} characters: {words[:500]!r}")


@contextmanager
def in_file(name: str, data: bytes) -> Iterator[Path]:
    """A file of that name with that content, alone in a folder."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm"))
    try:
        path = folder / name
        path.write_bytes(data)
        yield path
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def of_file(name: str, run: Callable[[Path], object]) -> Callable[[bytes], object]:
    """``run`` on a file of that name instead of bytes."""

    def on_bytes(data: bytes) -> object:
        with in_file(name, data) as path:
            return run(path)

    return on_bytes
