"""What is installed where a certificate is made, so that an audit can have the same.

A lock lists every installed distribution with its version and SHA-256 over what its RECORD says of
its files. Hashes of the archives that `pip` downloads stand in no environment: they come from a
report of `pip install --report`, if one is given.
"""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from conductor.certify.given import read_given
from conductor.certify.rows import Sha, Text
from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.kinds.registry import OUR_DISTRIBUTIONS
from twin.base.errors import InfrastructureError, UsageError
from twin.stack_identity.installed import record_digest

DISTRIBUTIONS_MAX = 5000
"""Most distributions of a lock."""
HASHES_MAX = 100
"""Most archives of a distribution."""
REPORT_BYTES_MAX = 64 << 20
"""Largest report of `pip` [bytes]."""


class Distribution(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An installed distribution."""

    name: Annotated[str, Meta(pattern="^[a-z0-9][a-z0-9-]{0,199}\\Z")]
    """Normalised name."""
    version: Annotated[str, Meta(pattern="^[0-9A-Za-z][0-9A-Za-z.+!_-]{0,199}\\Z")]
    record: Sha
    """SHA-256 over the lines of its RECORD that name its files with their digests."""
    archives: Annotated[list[Sha], Meta(max_length=HASHES_MAX)] = []
    """SHA-256 of archives that hold it; empty: not known."""

    @property
    def requirement(self) -> str:
        """Line of the package in a file for ``pip install --requirement``."""
        hashes = "".join(f" --hash=sha256:{sha}" for sha in self.archives)
        return f"{self.name}=={self.version}{hashes}"


Lock = Annotated[list[Distribution], Meta(max_length=DISTRIBUTIONS_MAX)]


class _ArchiveInfo(Struct, frozen=True):
    hashes: dict[str, str] = {}


class _DownloadInfo(Struct, frozen=True):
    archive_info: _ArchiveInfo = _ArchiveInfo()


class _Metadata(Struct, frozen=True):
    name: Text
    version: Text


class _Entry(Struct, frozen=True):
    metadata: _Metadata
    download_info: _DownloadInfo = _DownloadInfo()


class _Report(Struct, frozen=True):
    """Parts of the report that ``pip`` documents."""

    version: str
    install: list[_Entry]


def installed() -> list[Distribution]:
    """All distributions that are installed here, but ours, by name; no archives."""
    known = {}
    for distribution in importlib.metadata.distributions():
        name = _normal(distribution.metadata["Name"] or "")
        if (
            name and name not in OUR_DISTRIBUTIONS and name not in known
        ):  # the first of a name is imported
            record = record_digest(distribution.read_text("RECORD") or "")
            known[name] = Distribution(name=name, version=distribution.version, record=record)
    return [known[name] for name in sorted(known)]


def with_archives(lock: Sequence[Distribution], report: Path) -> list[Distribution]:
    """The lock with the hashes that a report of ``pip install --report`` has.

    Raises:
        UsageError: it is no such report, or lacks a distribution in the version that is installed.
    """
    data = read_given(report, REPORT_BYTES_MAX, "--lock")
    try:
        read: _Report = decode_json(data, _Report)
    except JsonError as error:
        raise UsageError(f"--lock {report}: no report of pip: {escape(str(error), 200)}") from None
    archives = {
        (_normal(entry.metadata.name), entry.metadata.version): sha
        for entry in read.install
        if (sha := entry.download_info.archive_info.hashes.get("sha256"))
    }
    missing = [d for d in lock if (d.name, d.version) not in archives]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise UsageError(
            f"--lock {report}: has no hash of {missing[0].name} {missing[0].version}{more}, which "
            "is installed here; docs/audit.md says how to make the report"
        )
    hashed = [
        msgspec.structs.replace(each, archives=[archives[each.name, each.version]]) for each in lock
    ]
    return decode_lock(encode_lock(hashed), f"--lock {report}")


def encode_lock(lock: Sequence[Distribution]) -> bytes:
    """A lock as JSON."""
    return msgspec.json.encode(lock)


def decode_lock(data: bytes, shown: str) -> list[Distribution]:
    """The lock in JSON that was signed.

    Raises:
        InfrastructureError: it is none.
    """
    try:
        lock: list[Distribution] = decode_json(data, Lock)
    except JsonError as error:
        raise InfrastructureError(f"{shown}: its lock: {escape(str(error), 300)}") from None
    return lock


def requirements(lock: Sequence[Distribution]) -> str:
    """A file for ``pip install --requirement``; with ``--require-hashes`` if every archive's hash
    is known."""
    return "".join(f"{each.requirement}\n" for each in lock)


def differences(lock: Sequence[Distribution], here: Sequence[Distribution]) -> list[str]:
    """What is installed otherwise here, a line per distribution; what is here beside it counts
    for nothing."""
    present = {each.name: each for each in here}
    lines = []
    for each in lock:
        other = present.get(each.name)
        if other is None:
            lines.append(f"{each.name} {each.version}: not installed here")
        elif other.version != each.version:
            lines.append(f"{each.name} {each.version}: here {other.version}")
        elif other.record != each.record:
            lines.append(f"{each.name} {each.version}: its files here are others")
    return lines


def _normal(name: Any) -> str:
    return re.sub(r"[-_.]+", "-", str(name)).lower()
