"""Results that wait for the conductor, as bytes for a file each; no file is opened here.

Whoever may write the folder may not make results: they are sealed by the session that ran them, and
only the conductor decides what they are worth. A torn or damaged file is told from others by the
digest in front.
"""

from __future__ import annotations

import hashlib

import msgspec

from schemas import SCHEMA_VERSION
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Hello, Result, Sealed
from twin.fabric.session import seal

_DIGEST_BYTES = 32


class Spooled(msgspec.Struct, frozen=True):
    """Content of one file."""

    v: int
    sealed: Sealed


def pack(result: Result, own: Hello) -> bytes:
    """Result of the worker that introduced itself so -> content of its file."""
    plain = encode(result)
    sealed = Sealed(result.token, own.worker, plain, seal(own.session, plain))
    data = encode(Spooled(v=SCHEMA_VERSION, sealed=sealed))
    return hashlib.sha256(data).digest() + data


def unpack(data: bytes) -> Sealed | None:
    """Content of a file -> sealed result; None: it is damaged, or of another version."""
    digest, content = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        return None
    try:
        spooled: Spooled = decode(content, Spooled)
    except WireError:
        return None
    return spooled.sealed
