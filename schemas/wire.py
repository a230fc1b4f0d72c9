"""Wire codec: MessagePack maps to and from frozen Structs, with size limits and version check.

A valid message is decoded straight into its type. What that refuses, and what has another version,
is unpacked into plain values to be explained, and then validated by ``msgspec.convert``, as YAML
is: the slow way says why, in the same words for both.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Any, TypeVar, cast

import msgpack
import msgspec

from schemas import SCHEMA_VERSION

T = TypeVar("T")

MESSAGE_BYTES_MAX = 16 << 20
"""Largest control message [bytes]: a campaign file of 4 MiB with room to spare."""

ATTACHMENT_BYTES_MAX = 1 << 20
"""Largest attachment of a frame [bytes]."""

_encoder = msgspec.msgpack.Encoder()


class WireError(ValueError):
    """The bytes are not a message of this type and version; one line."""


def encode(message: msgspec.Struct) -> bytes:
    """Struct -> MessagePack map."""
    return _encoder.encode(message)


def decode(data: bytes, type_: type[T] | Any, size_max: int = MESSAGE_BYTES_MAX) -> T:
    """MessagePack map -> validated Struct of ``type_``.

    Raises:
        WireError: too large, not MessagePack, another schema version, or not this type.
    """
    if len(data) > size_max:
        raise WireError(f"message of {len(data)} bytes, at most {size_max} are accepted")
    try:
        message: T = _decoder(cast(Hashable, type_)).decode(data)
    except (msgspec.MsgspecError, RecursionError, ValueError):
        message = _explained(data, type_)
    if _version(message) != SCHEMA_VERSION:
        message = _explained(data, type_)
    return message


@lru_cache(maxsize=256)
def _decoder(type_: Hashable) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(type_)


def _version(message: Any) -> Any:
    """The version that a message states; one that states none is of ours."""
    if isinstance(message, dict):
        return message.get("v", SCHEMA_VERSION)
    return getattr(message, "v", SCHEMA_VERSION)


def _explained(data: bytes, type_: Any) -> Any:
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
