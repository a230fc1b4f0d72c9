"""Results that wait for the conductor, as bytes for a file each; no file is opened here.

A torn or damaged file must not become a result: the bytes begin with their digest.
"""

from __future__ import annotations

import hashlib

import msgspec

from schemas import SCHEMA_VERSION
from schemas.messages import Result
from schemas.wire import WireError, decode, encode

_DIGEST_BYTES = 32


class Spooled(msgspec.Struct, frozen=True):
    """Content of one file."""

    v: int
    result: Result


def pack(result: Result) -> bytes:
    """Result -> content of its file."""
    data = encode(Spooled(v=SCHEMA_VERSION, result=result))
    return hashlib.sha256(data).digest() + data


def unpack(data: bytes) -> Result | None:
    """Content of a file -> result; None: it is damaged, or of another version."""
    digest, content = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        return None
    try:
        spooled: Spooled = decode(content, Spooled)
    except WireError:
        return None
    return spooled.result
