"""Withdrawn keys: a list of certificates' serial numbers beside the authority, in hexadecimal."""

from __future__ import annotations

from pathlib import Path

from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.fabric.keys.key_file import read_certificate
from twin.fabric.keys.roles import Role

FILE_NAME = "revoked"
"""Name of the list of withdrawn keys in a folder of keys."""

FILE_BYTES_MAX = 4 << 20
"""Most that is read of it [bytes]."""


def serial_of(said: str) -> int:
    """The serial number that a command line means: a key file's, or the number itself.

    Raises:
        UsageError: it is neither.
    """
    path = Path(said)
    if path.is_file():
        return read_certificate(path).serial_number
    try:
        return int(said, 16)
    except ValueError:
        raise UsageError(
            f"{said}: no such key file, and no serial number; give the file, or the hexadecimal "
            "number that audit.jsonl names"
        ) from None


def check_of_fabric(said: str, folder: Path) -> None:
    """Raise UsageError for the file of a key that the authority of ``folder`` has not signed."""
    path, ours = Path(said), folder / f"{Role.conductor}.key"
    if path.is_file() and ours.is_file():
        certificate, our_certificate = read_certificate(path), read_certificate(ours)
        if certificate.issuer != our_certificate.issuer:
            raise UsageError(
                f"{said}: of another fabric than {folder}; give the folder of the keys that its "
                "conductor serves with, --state or --key"
            )


def read_revoked(folder: Path) -> frozenset[int]:
    """Serial numbers of the withdrawn keys of the fabric in ``folder``; lines that are no number
    are skipped.

    Raises:
        OSError: there is a list, and it cannot be read.
    """
    try:
        with (folder / FILE_NAME).open("rb") as file:
            lines = file.read(FILE_BYTES_MAX).decode("ascii", "replace").splitlines()
    except FileNotFoundError:
        return frozenset()
    return frozenset(serial for line in lines if (serial := _number(line)) is not None)


def revoke(folder: Path, serial: int) -> None:
    """Add to the list; once is enough.

    Raises:
        UsageError: the list cannot be written.
        InfrastructureError: the disk is full or broken.
    """
    try:
        known = read_revoked(folder) | {serial}
        lines = "".join(f"{number:x}\n" for number in sorted(known))
        write_atomic(folder / FILE_NAME, lines.encode(), mode=0o600)
    except OSError as error:
        raise storage_error(error, str(folder / FILE_NAME)) from None


def _number(line: str) -> int | None:
    try:
        return int(line.split("#")[0], 16)
    except ValueError:
        return None
