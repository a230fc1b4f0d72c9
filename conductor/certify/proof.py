"""The proof of a single case: that its row stands in the table whose root was signed.

It holds the signed head, the row and the hashes that lead from it to the root, so that somebody may
be shown one case of a certificate without the others. It is one line of JSON with the keys
``format``, ``head``, ``key``, ``signature``, ``index``, ``row`` and ``path``.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Raw, Struct

from conductor.certify.form import (
    HEAD_BYTES_MAX,
    Certificate,
    SignedHead,
    decode_head,
    require_signed,
)
from conductor.certify.given import read_given
from conductor.certify.merkle import path_of, root_from
from conductor.certify.rows import Row, Sha, leaf_of, leaves_of
from schemas.campaign import CASES_MAX
from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from schemas.words import counted
from twin.base.errors import InfrastructureError, UsageError

FORMAT: Literal["drivetwin proof 1"] = "drivetwin proof 1"
FILE_BYTES_MAX = HEAD_BYTES_MAX + (1 << 16)
"""Largest proof [bytes]."""
CLOSE_MAX = 3
"""Names of cases that are suggested for one that is not there."""
PATH_MAX = 32
"""Most hashes of a proof: enough for more cases than a campaign may have."""


class Proof(Struct, frozen=True, kw_only=True):
    """A proof that holds."""

    head: SignedHead
    key: str
    row: Row
    device_class: str


class _ProofFile(Struct, frozen=True, forbid_unknown_fields=True):
    format: Literal["drivetwin proof 1"]
    head: Raw
    key: Sha
    signature: Annotated[str, Meta(pattern="^[0-9a-f]{128}\\Z")]
    index: Annotated[int, Meta(ge=0, lt=CASES_MAX)]
    row: Row
    path: Annotated[list[Sha], Meta(max_length=PATH_MAX)]


def prove(certificate: Certificate, case: str) -> bytes:
    """The proof of a case, as the bytes of its file.

    Raises:
        UsageError: the certificate has no such case.
    """
    names = [row.case for row in certificate.rows]
    if case not in names:
        close = difflib.get_close_matches(case, names, n=CLOSE_MAX, cutoff=0.4) or names[:CLOSE_MAX]
        raise UsageError(
            f"--proof {case}: no case of '{certificate.head.name}'; it has "
            f"{counted(len(names), 'case')}, e.g. {', '.join(close)}"
        )
    index = names.index(case)
    leaves = leaves_of(certificate.rows, certificate.head.made_in.device_classes)
    file = _ProofFile(
        format=FORMAT,
        head=Raw(certificate.signed),
        key=certificate.key,
        signature=certificate.signature,
        index=index,
        row=certificate.rows[index],
        path=[each.hex() for each in path_of(leaves, index)],
    )
    return msgspec.json.encode(file) + b"\n"


def read_proof(path: Path, trusted: Collection[str]) -> Proof:
    """Read a proof that somebody gave us, and check it.

    Raises:
        UsageError: there is no such file, or it is no proof.
        InfrastructureError: it does not lead to what was signed, or nobody trusted signed that.
    """
    return decode_proof(read_given(path, FILE_BYTES_MAX), str(path), trusted)


def decode_proof(data: bytes, shown: str, trusted: Collection[str]) -> Proof:
    """Like :func:`read_proof`, from the bytes of a file that is called ``shown``."""
    try:
        file: _ProofFile = decode_json(data, _ProofFile)
    except JsonError as error:
        raise UsageError(
            f"{shown}: no proof, or damaged: {escape(str(error), 300)}; give a file that "
            "`conductor certify --proof` wrote"
        ) from None
    require_signed(shown, bytes(file.head), file.key, file.signature, trusted)
    head = decode_head(shown, bytes(file.head))
    classes = head.made_in.device_classes
    if file.row.device >= len(classes):
        raise InfrastructureError(f"{shown}: its row names a device class that the head does not")
    device_class = classes[file.row.device] if file.row.device >= 0 else ""
    path = [bytes.fromhex(each) for each in file.path]
    root = root_from(leaf_of(file.row, device_class), file.index, head.count, path)
    if root is None or root.hex() != head.root:
        raise InfrastructureError(
            f"{shown}: case {escape(file.row.case, 200)} is not in the table that was signed, or "
            "not with this result"
        )
    if msgspec.json.encode(file) + b"\n" != data:
        raise InfrastructureError(
            f"{shown}: not as `conductor certify` writes it: bytes were added or written otherwise"
        )
    return Proof(head=head, key=file.key, row=file.row, device_class=device_class)
