"""What was found good here before, so that the next run of a campaign need not look at it again.

Files in the user's cache folder hold digests of all that decides a verdict. Only good verdicts are
kept: what was refused may have been put right outside of what the digest is taken over.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection
from pathlib import Path
from typing import Annotated

from msgspec import Meta, json

from schemas.files.json_text import JsonError, decode_json
from twin.base.files import write_atomic

KEPT_MAX = 1024
"""Most digests of a file; the oldest are forgotten."""

BYTES_MAX = 1 << 20
"""Most that is read of a file [bytes]."""

_Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


def remembered(name: str) -> list[str]:
    """Digests in the file ``name``, oldest first; a damaged file is as none."""
    digests: list[str] = []
    with contextlib.suppress(OSError, RuntimeError, JsonError):
        # No pipe keeps us waiting, and no file without end.
        descriptor = os.open(_path(name), os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as file:
            digests = decode_json(file.read(BYTES_MAX), list[_Digest])
    return digests


def remember(name: str, good: Collection[str]) -> None:
    """Keep digests in the file ``name``; where it cannot be written, none is kept."""
    if not good:
        return
    kept = list(dict.fromkeys([*(old for old in remembered(name) if old not in good), *good]))
    with contextlib.suppress(OSError, RuntimeError):
        path = _path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.encode(kept[-KEPT_MAX:]), sync=False)


def _path(name: str) -> Path:
    """Path of the file ``name``, beside compiled kernels, by the same variables.

    Raises:
        RuntimeError: the user has no home.
    """
    cache = os.environ.get("WARP_CACHE_PATH") or os.environ.get("XDG_CACHE_HOME")
    return Path(cache or Path.home() / ".cache") / "drivetwin" / name
