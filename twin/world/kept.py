"""What takes seconds to work out and follows from files alone, kept beside the compiled kernels.

A simulator that starts for the hundredth time finds the world of its scene there. What is kept is
named by everything it follows from, the software's digest included, and carries its own checksum: a
damaged entry is worked out anew. Entries are pickles, so the folder must be the user's own, as that
of the compiled kernels must be.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import warp as wp

from twin.base.files import write_atomic
from twin.base.software import software_digest
from twin.world.kernel_cache import kept_folder, prepare_kernels

ENTRIES_MAX = 8
"""Entries of one kind unless it says otherwise; the oldest ones go."""

_SUM_BYTES = 32

T = TypeVar("T")


def kept(kind: str, key: bytes, make: Callable[[], T], entries_max: int = ENTRIES_MAX) -> T:
    """What ``make`` returns, from the disk if it was made for ``key`` by this software before.

    Args:
        kind: names a folder.
        key: all that the result follows from beside the software.
        make: must depend on ``key`` alone; what it raises passes through.
        entries_max: most entries of this kind.
    """
    if not wp.config.kernel_cache_dir:
        prepare_kernels()
    name = hashlib.sha256(_software() + b"\0" + key).hexdigest()
    path = kept_folder(kind) / name
    found = _read(path)
    if found is not None:
        return found[0]  # type: ignore[no-any-return]
    made = make()
    _write(path, made, entries_max)
    return made


@functools.cache
def _software() -> bytes:
    return software_digest().encode()


def _read(path: Path) -> tuple[Any] | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    body = memoryview(data)[_SUM_BYTES:]
    if hashlib.sha256(body).digest() != data[:_SUM_BYTES]:
        return None
    return (pickle.loads(body),)


def _write(path: Path, value: object, entries_max: int) -> None:
    body = pickle.dumps(value, protocol=5)
    with contextlib.suppress(OSError):  # what cannot be kept only costs time
        path.parent.mkdir(parents=True, exist_ok=True)
        whole = hashlib.sha256(body).digest() + body
        write_atomic(path, whole, mode=0o600, sync=False)  # half of it would be found out
        entries = [e for e in path.parent.iterdir() if not e.name.startswith(".")]
        if len(entries) > entries_max:
            oldest = sorted(entries, key=lambda e: e.stat().st_mtime)
            # A few more, so that this is not done every time.
            for old in oldest[: len(entries) - entries_max + entries_max // 16]:
                old.unlink(missing_ok=True)
