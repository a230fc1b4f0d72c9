"""Which networks are the same, so that one that was loaded here before is not tried again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from schemas.files.assets import file_digest
from schemas.identity import digest
from schemas.sections.perception import NetworkPerception, file_fields
from twin.base.errors import UsageError
from twin.base.software import device_class, software_digest

FILE = "good-networks.json"
"""Where digests of good ones are kept, see :mod:`conductor.run.known_good`."""


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
