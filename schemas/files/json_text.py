"""JSON of our own making that may have been damaged since."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from schemas.escape import escape

T = TypeVar("T")


class JsonError(ValueError):
    """The text is not JSON of this type; one line."""


def decode_json(data: bytes | str, type_: type[T] | Any = Any) -> T:
    """JSON -> validated ``type_``.

    Raises:
        JsonError: not UTF-8, not JSON, nested too deeply, or not this type.
    """
    try:
        value: T = msgspec.json.decode(data, type=type_)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise JsonError(escape(str(error))) from None
    except RecursionError:
        raise JsonError("nested too deeply") from None
    return value
