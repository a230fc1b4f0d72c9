"""``software.json`` of a run folder: the parts of the software digest, to say later what differs.

Who signs a run writes it, if it is signed by the software that ran it; so the manifest lists it.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
from msgspec import Struct

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import read_regular
from schemas.files.software import digest_of, is_digest_of
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.base.software import library_versions, software_files

FILE_NAME = "software.json"
FILE_BYTES_MAX = 8 << 20
"""Largest file that is read [bytes]."""


class SoftwareParts(Struct, frozen=True, forbid_unknown_fields=True):
    """What a software digest is taken over."""

    files: dict[str, str]
    """Path -> SHA-256."""
    libraries: dict[str, str]
    """Name -> version."""


def write_software(folder: Path, software: str) -> None:
    """Write what is installed here into a run folder, if ``software`` is its digest.

    Raises:
        TwinError: the folder cannot be written.
    """
    parts = SoftwareParts(software_files(), library_versions())
    if digest_of(parts.files, parts.libraries) != software:
        return
    path = folder / FILE_NAME
    try:
        write_atomic(path, msgspec.json.encode(parts) + b"\n")
    except OSError as error:
        raise storage_error(error, str(path)) from None


def read_software(folder: Path, software: str) -> SoftwareParts | None:
    """What a run was made with whose software digest is ``software``; None: it does not say, or
    says it of other software."""
    try:
        parts: SoftwareParts = decode_json(
            read_regular(folder / FILE_NAME, FILE_BYTES_MAX), SoftwareParts
        )
    except (OSError, JsonError):
        return None
    return parts if is_digest_of(software, parts.files, parts.libraries) else None
