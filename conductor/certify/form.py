"""The file of a certificate: what is signed, what is bound by digests, and how it is read.

It is one line of JSON without blanks::

    {"format": ..., "head": ..., "key": ..., "signature": ..., "rows": ..., "campaign": ..., "lock":
     ..., "files": ..., "timestamp": ...}

The signature is Ed25519 over :data:`SIGNED` and the bytes of ``head`` as they stand. The head holds
the root of the rows, SHA-256 of the bytes of ``campaign`` and ``lock``, and the software digest,
which is that of ``files`` and the libraries in the head; so a proof of a single row needs no more
than the head. Nothing of a file is believed before its signature fits; then every
part is held against the head, and the whole against its own encoding, of which there is one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, Raw, Struct, UnsetType

from conductor.certify.given import read_given
from conductor.certify.merkle import root_of
from conductor.certify.rows import (
    ENTRIES_MAX,
    OptionalSha,
    Row,
    Sha,
    Text,
    counts_of,
    leaves_of,
)
from conductor.trust.signing import TRUSTED_FOLDER, fits
from schemas.campaign import CASES_MAX
from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.files.software import is_digest_of
from twin.base.errors import InfrastructureError, UsageError
from twin.base.own_folder import own_folder

FORMAT: Literal["drivetwin certificate 1"] = "drivetwin certificate 1"
SIGNED = b"drivetwin certificate 1\0"
"""Stands before the bytes that are signed."""
FILE_BYTES_MAX = 64 << 20
"""Largest certificate [bytes]."""
HEAD_BYTES_MAX = 1 << 20
"""Largest head [bytes]."""
CAMPAIGN_BYTES_MAX = 16 << 20
"""Largest campaign in one [bytes]."""
LOCK_BYTES_MAX = 4 << 20
"""Largest list of installed distributions in one [bytes]."""
SOFTWARE_FILES_MAX = 20_000
"""Most files of our own software in one."""
TOKEN_CHARS_MAX = 65536
"""Longest timestamp token, as Base64 [characters]."""

_Count = Annotated[int, Meta(ge=1, le=CASES_MAX)]
_Signature = Annotated[str, Meta(pattern="^[0-9a-f]{128}\\Z")]
_FileName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_./+-]{1,300}\Z")]
_Files = Annotated[dict[_FileName, Sha], Meta(max_length=SOFTWARE_FILES_MAX)]


class MadeIn(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the certificate was made, which is the environment that ran the campaign."""

    python: Text
    system: Text
    machine: Text
    """Kind of processor, such as ``x86_64``."""
    device_classes: Annotated[list[Text], Meta(max_length=ENTRIES_MAX)]
    """Device classes of the results, sorted; a row names its own by its place here."""


class SignedHead(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is signed."""

    name: Text
    """Name of the campaign."""
    digest: Sha
    """Digest of the campaign (:func:`schemas.identity.campaign_digest`)."""
    fingerprint: Sha
    """Fingerprint of the run."""
    count: _Count = 1
    """Number of rows."""
    outcomes: Annotated[dict[Text, int], Meta(max_length=ENTRIES_MAX)] = {}
    """Outcome, with verdict -> number of rows."""
    root: Sha = ""
    """Root of the tree over the rows (:func:`leaf_of`)."""
    campaign: Sha = ""
    """SHA-256 over the part of the file with this name."""
    lock: Sha = ""
    """The same."""
    software: Sha
    """Software digest."""
    libraries: Annotated[dict[Text, Text], Meta(max_length=ENTRIES_MAX)]
    """Versions of the libraries that reach a KPI."""
    stack: Text
    """The stack under test, for people."""
    stack_digest: OptionalSha
    """Digest of the stack's files; empty: a shipped one, which the software digest has."""
    protected: bool
    """Whether every attempt ran in a sandbox, or was ``noop``."""
    protection: Annotated[list[Text], Meta(max_length=ENTRIES_MAX)]
    """What kept the stack from the machine, as the run tells it."""
    made_in: MadeIn
    made: Text
    """When the certificate was made, UTC, by the clock of who made it."""
    by: Text
    """Who made it, in words of his own."""
    run_key: Sha
    """Public key that signed the run's manifest."""
    run_signature: _Signature
    """Signature of the run's manifest."""


class Certificate(Struct, frozen=True, kw_only=True):
    """A certificate whose signature fits and whose parts are those that were signed."""

    head: SignedHead
    signed: bytes
    """The bytes of the head, as they were signed."""
    key: str
    """Public key of who signed it, hexadecimal."""
    signature: str
    rows: list[Row]
    campaign: bytes
    """JSON of the campaign."""
    lock: bytes
    """JSON of the installed distributions (:mod:`conductor.certify.lock`)."""
    files: dict[str, str] | None = None
    """Files of our software -> SHA-256, sorted, of which the head has the digest; None: it was made
    by a version that did not tell."""
    timestamp: str = ""
    """Timestamp token (RFC 3161), Base64; empty: none is attached."""

    def device_class(self, row: Row) -> str:
        """Device class of a row; empty: it has none."""
        return self.head.made_in.device_classes[row.device] if row.device >= 0 else ""


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    """The file as it stands; parts are decoded when the signature has been looked at."""

    format: Literal["drivetwin certificate 1"]
    head: Raw
    key: Sha
    signature: _Signature
    rows: Raw
    campaign: Raw
    lock: Raw
    files: Raw | UnsetType = UNSET
    timestamp: (
        Annotated[str, Meta(pattern="^[A-Za-z0-9+/]+={0,2}\\Z", max_length=TOKEN_CHARS_MAX)]
        | UnsetType
    ) = UNSET


def encode_certificate(certificate: Certificate) -> bytes:
    """The one encoding of a certificate."""
    file = _File(
        format=FORMAT,
        head=Raw(certificate.signed),
        key=certificate.key,
        signature=certificate.signature,
        rows=Raw(msgspec.json.encode(certificate.rows)),
        campaign=Raw(certificate.campaign),
        lock=Raw(certificate.lock),
        files=UNSET if certificate.files is None else Raw(msgspec.json.encode(certificate.files)),
        timestamp=certificate.timestamp or UNSET,
    )
    return msgspec.json.encode(file) + b"\n"


def read_certificate(path: Path, trusted: Collection[str]) -> Certificate:
    """Read a certificate that somebody gave us.

    Args:
        path: the file.
        trusted: public keys, hexadecimal, that may have signed it.

    Raises:
        UsageError: there is no such file, or it is no certificate.
        InfrastructureError: it does not hold what was signed, or nobody who is trusted signed it.
    """
    return decode_certificate(read_given(path, FILE_BYTES_MAX), str(path), trusted)


def decode_certificate(data: bytes, shown: str, trusted: Collection[str]) -> Certificate:
    """Like :func:`read_certificate`, from the bytes of a file that is called ``shown``."""
    try:
        file: _File = decode_json(data, _File)
    except JsonError as error:
        raise UsageError(
            f"{shown}: no certificate, or damaged or cut off: {escape(str(error), 300)}; give a "
            "file that `conductor certify` wrote"
        ) from None
    require_signed(shown, bytes(file.head), file.key, file.signature, trusted)
    certificate = Certificate(
        head=decode_head(shown, bytes(file.head)),
        signed=bytes(file.head),
        key=file.key,
        signature=file.signature,
        rows=_part(shown, "rows", bytes(file.rows), list[Row], FILE_BYTES_MAX),
        campaign=_bounded(shown, "campaign", bytes(file.campaign), CAMPAIGN_BYTES_MAX),
        lock=_bounded(shown, "lock", bytes(file.lock), LOCK_BYTES_MAX),
        files=None
        if file.files is UNSET
        else _part(shown, "files", bytes(file.files), _Files, FILE_BYTES_MAX),
        timestamp="" if file.timestamp is UNSET else file.timestamp,
    )
    _check_parts(shown, certificate)
    if encode_certificate(certificate) != data:
        raise InfrastructureError(
            f"{shown}: not as `conductor certify` writes it: bytes were added or written otherwise"
        )
    return certificate


def require_signed(
    shown: str, head: bytes, key: str, signature: str, trusted: Collection[str]
) -> None:
    """Refuse a head whose signature does not fit, or is of somebody who is not trusted.

    Raises:
        InfrastructureError: one line that says which.
    """
    if not fits(key, signature, SIGNED + head):
        raise InfrastructureError(
            f"{shown}: its signature does not fit: the head was changed, or another key signed it"
        )
    if key not in trusted:
        raise InfrastructureError(
            f"{shown}: signed by key {key}, which is not trusted here; if you know whose it is, "
            f"give it as --public-key, or write it into {own_folder() / TRUSTED_FOLDER}/NAME.pub"
        )


def decode_head(shown: str, signed: bytes) -> SignedHead:
    """The head of which these bytes were signed.

    Raises:
        InfrastructureError: they are none.
    """
    head: SignedHead = _part(shown, "head", signed, SignedHead, HEAD_BYTES_MAX)
    return head


def _check_parts(shown: str, certificate: Certificate) -> None:
    """Hold the parts of a certificate against its signed head."""
    head, rows = certificate.head, certificate.rows
    for name in ("campaign", "lock"):
        if hashlib.sha256(getattr(certificate, name)).hexdigest() != getattr(head, name):
            raise InfrastructureError(f"{shown}: its {name} is not the one that was signed")
    files = certificate.files
    if files is not None and not is_digest_of(head.software, files, head.libraries):
        raise InfrastructureError(
            f"{shown}: its files and libraries are not those of the software that was signed"
        )
    if len(rows) != head.count:
        raise InfrastructureError(f"{shown}: has {len(rows)} rows, signed were {head.count}")
    classes = head.made_in.device_classes
    if any(row.device >= len(classes) for row in rows):
        raise InfrastructureError(f"{shown}: a row names a device class that the head does not")
    if root_of(leaves_of(rows, classes)).hex() != head.root:
        raise InfrastructureError(
            f"{shown}: its rows are not those that were signed: one was changed, or they were "
            "reordered"
        )
    if len({row.case for row in rows}) != len(rows):
        raise InfrastructureError(f"{shown}: a case stands in two rows")
    if counts_of(rows) != head.outcomes:
        raise InfrastructureError(f"{shown}: its head counts other outcomes than its rows have")


def _bounded(shown: str, name: str, data: bytes, most: int) -> bytes:
    if len(data) > most:
        raise InfrastructureError(
            f"{shown}: its {name} has {len(data)} bytes, at most {most} are read"
        )
    return data


def _part(shown: str, name: str, data: bytes, type_: Any, most: int) -> Any:
    try:
        return decode_json(_bounded(shown, name, data, most), type_)
    except JsonError as error:
        raise InfrastructureError(f"{shown}: its {name}: {escape(str(error), 300)}") from None
