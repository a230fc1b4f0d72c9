"""Wire codec: MessagePack maps to and from frozen Structs, with size limits and version check.

``msgpack`` unpacks, ``msgspec.convert`` validates: one validation path for the wire and for YAML.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgpack
import msgspec

from schemas import SCHEMA_VERSION

T = TypeVar("T")

MESSAGE_BYTES_MAX = 16 << 20
"""Largest control message [bytes]: a campaign file of 4 MiB with room to spare."""

ATTACHMENT_BYTES_MAX = 1 << 20
"""Largest attachment of a frame [bytes]."""


class WireError(ValueError):
    """The bytes are not a message of this type and version; one line."""


def encode(message: msgspec.Struct) -> bytes:
    """Struct -> MessagePack map."""
    packed: bytes = msgpack.packb(msgspec.to_builtins(message))
    return packed


def decode(data: bytes, type_: type[T] | Any, size_max: int = MESSAGE_BYTES_MAX) -> T:
    """MessagePack map -> validated Struct of ``type_``.

    Raises:
        WireError: too large, not MessagePack, another schema version, or not this type.
    """
    if len(data) > size_max:
        raise WireError(f"message of {len(data)} bytes, at most {size_max} are accepted")
    try:
        plain = msgpack.unpackb(data, strict_map_key=True)
    except Exception as error:  # msgpack raises a zoo of types on hostile input
        raise WireError(f"not MessagePack: {' '.join(str(error).split())[:200]}") from None
    if isinstance(plain, dict) and "v" in plain and plain["v"] != SCHEMA_VERSION:
        raise WireError(
            f"schema version {str(plain['v'])[:20]} given, this side speaks {SCHEMA_VERSION}; "
            "install the same version on both sides"
        )
    try:
        return msgspec.convert(plain, type_)
    except (msgspec.ValidationError, RecursionError) as error:
        raise WireError(f"not a valid message: {error}") from None
