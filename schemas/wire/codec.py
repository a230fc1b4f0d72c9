"""Wire codec: MessagePack maps to and from frozen Structs, with size limits and version check.

A message is decoded straight into its type, so nothing is built that the type does not ask for.
What is refused is looked at again for its version alone: "another version" is the better reason.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Any, TypeVar, cast

import msgpack
import msgspec

from schemas import SCHEMA_VERSION
from schemas.escape import escape

T = TypeVar("T")

MESSAGE_BYTES_MAX = 16 << 20
"""Largest control message [bytes]: a campaign file of 4 MiB with room to spare."""

ATTACHMENT_BYTES_MAX = 1 << 20
"""Largest attachment of a frame [bytes]."""

FREE_BYTES_MAX = 1 << 20
"""A message up to this size may hold as many values as fit [bytes]."""

CONTAINERS_MAX = 500_000
"""Most maps and lists in a larger message; a campaign of 100,000 listed cases has 100,001."""

_encoder = msgspec.msgpack.Encoder()


class WireError(ValueError):
    """The bytes are not a message of this type and version; one line."""

    def __init__(self, words: str) -> None:
        super().__init__(escape(words))


def encode(message: msgspec.Struct) -> bytes:
    """Struct -> MessagePack map."""
    return _encoder.encode(message)


def decode(data: bytes, type_: type[T] | Any, size_max: int = MESSAGE_BYTES_MAX) -> T:
    """MessagePack map -> validated Struct of ``type_``.

    Raises:
        WireError: too large, not MessagePack, too many values, another schema version, or not this
            type.
    """
    if len(data) > size_max:
        raise WireError(f"message of {len(data)} bytes, at most {size_max} are accepted")
    if size_max <= MESSAGE_BYTES_MAX and len(data) > FREE_BYTES_MAX:
        _check_count(data)
    try:
        message: T = _decoder(cast(Hashable, type_)).decode(data)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        _check_form(data)
        _check_version(data)
        raise WireError(f"not a valid message: {error or 'nested too deeply'}") from None
    if _version(message) != SCHEMA_VERSION:
        _check_version(data)
    return message


@lru_cache(maxsize=256)
def _decoder(type_: Hashable) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(type_)


class _Versioned(msgspec.Struct):
    """What every version of every message has; other keys are skipped, not built."""

    v: Any = SCHEMA_VERSION


_raw = msgspec.msgpack.Decoder(msgspec.Raw).decode
_version_of = msgspec.msgpack.Decoder(_Versioned).decode


def _version(message: Any) -> Any:
    """The version that a message states; one that states none is of ours."""
    if isinstance(message, dict):
        return message.get("v", SCHEMA_VERSION)
    return getattr(message, "v", SCHEMA_VERSION)


def _check_form(data: bytes) -> None:
    """Whether these are the bytes of one value, whatever it is; nothing is built."""
    try:
        _raw(data)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise WireError(f"not MessagePack: {error or 'nested too deeply'}") from None


def _check_version(data: bytes) -> None:
    try:
        version = _version_of(data).v
    except (msgspec.MsgspecError, RecursionError, ValueError):
        return  # no map: what is wrong with it is said by its own type
    if version != SCHEMA_VERSION:
        raise WireError(
            f"schema version {str(version)[:20]} given, this side speaks {SCHEMA_VERSION}; "
            "install the same version on both sides"
        )


def _check_count(data: bytes) -> None:
    """Refuse a large message that would be many times larger in memory: an empty map is one byte
    on the wire and 64 here. Containers are counted as they close and forgotten at once."""
    left = CONTAINERS_MAX

    def forget(_container: Any) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise WireError(f"message of more than {CONTAINERS_MAX} maps and lists; send less")

    try:
        msgpack.unpackb(data, object_hook=forget, list_hook=forget, strict_map_key=False)
    except WireError:
        raise
    except Exception:  # msgpack raises a zoo of types; the decoder says what is wrong
        return
