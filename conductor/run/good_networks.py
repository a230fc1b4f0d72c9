"""Networks that were loaded here before, so that the next run of a campaign need not try them.

A file in the user's cache folder holds one digest per network, of all that decides whether it can
be loaded. Only good verdicts are kept: what was refused may have been put right outside its files.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated

from msgspec import Meta, json

from schemas.files.assets import file_digest
from schemas.files.json_text import JsonError, decode_json
from schemas.identity import digest
from schemas.sections.perception import NetworkPerception, file_fields
from twin.base.errors import UsageError
from twin.base.files import write_atomic
from twin.base.software import device_class, software_digest

KEPT_MAX = 1024
"""Most networks remembered; the oldest are forgotten."""

BYTES_MAX = 1 << 20
"""Most that is read of the file [bytes]."""

_Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


def identities(
    variants: Mapping[str, NetworkPerception],
    files: Mapping[str, str],
    device: str,
    size_px: tuple[int, int],
) -> dict[str, str]:
    """Name -> digest of what decides whether the network can be loaded; without those of which
    that is not known.

    Args:
        variants: paths in them are absolute.
        files: path -> SHA-256 of the files that they name.
        device: where the networks are loaded, ``cpu`` or ``cuda:N``.
        size_px: width and height of the pictures [px].
    """
    try:
        place = (software_digest(), device_class(device), *map(str, size_px))
    except UsageError:
        return {}  # no such device: whoever loads them says so
    return {
        name: digest(part.encode() for part in (*place, *_parts(variant, files)))
        for name, variant in variants.items()
        if all(path in files for path in file_fields(variant).values())
    }


def _parts(variant: NetworkPerception, files: Mapping[str, str]) -> list[str]:
    """Where a file lies does not matter, but what its name ends with does."""
    named = file_fields(variant)
    parts = [variant.runtime, "" if "model" in named else variant.model]
    for key, path in named.items():
        parts += [key, Path(path).suffix, files[path]]
    return parts


def unchanged(variant: NetworkPerception, files: Mapping[str, str]) -> bool:
    """Whether the files of ``variant`` are still those of ``files``."""
    try:
        return all(file_digest(Path(p)) == files[p] for p in file_fields(variant).values())
    except OSError:
        return False


def remembered() -> list[str]:
    """Digests of networks that could be loaded, oldest first; a damaged file is as none."""
    found: list[str] = []
    with contextlib.suppress(OSError, RuntimeError, JsonError):
        # No pipe keeps us waiting, and no file without end.
        descriptor = os.open(_path(), os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as file:
            found = decode_json(file.read(BYTES_MAX), list[_Digest])
    return found


def remember(good: Collection[str]) -> None:
    """Keep digests of networks that could be loaded; where that cannot be written, none is kept."""
    if not good:
        return
    kept = list(dict.fromkeys([*(old for old in remembered() if old not in good), *good]))
    with contextlib.suppress(OSError, RuntimeError):
        path = _path()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.encode(kept[-KEPT_MAX:]), sync=False)


def _path() -> Path:
    """Beside compiled kernels, by the same variables.

    Raises:
        RuntimeError: the user has no home.
    """
    cache = os.environ.get("WARP_CACHE_PATH") or os.environ.get("XDG_CACHE_HOME")
    return Path(cache or Path.home() / ".cache") / "drivetwin" / "good-networks.json"
