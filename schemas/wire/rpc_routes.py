"""Which key a request to the conductor goes to, and what may come on it: kinds and size.

There is a key for each role that may ask. A request is decoded only as what may come on its key, so
nobody can make the conductor work through a message that is none of the sender's business.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

from msgspec import MsgspecError, Struct
from msgspec.msgpack import Decoder

from schemas.wire import topics
from schemas.wire.codec import MESSAGE_BYTES_MAX, WireError, decode
from schemas.wire.control import (
    Beat,
    Bye,
    Control,
    Explain,
    Hello,
    Next,
    Recorded,
    Request,
    StatusRequest,
    Stop,
    Submit,
)
from schemas.wire.topics import Topic

WORKER_BYTES_MAX = 4 << 20
"""Largest request of a worker [bytes]; its results are sent in portions that fit."""

COMMAND_BYTES_MAX = 4096
"""Largest question about the status, and command [bytes]: a few names."""

PEEK_BYTES = 1 << 16
"""A request above this size is asked for its verb before anything else of it is read [bytes]."""


@dataclass(frozen=True, slots=True)
class RpcRoute:
    """What may come on one key."""

    topic: Topic
    requests: tuple[type[Request], ...]
    bytes_max: int


_ALL = (
    RpcRoute(topics.RPC_WORKER, (Hello, Next, Beat, Bye, Recorded), WORKER_BYTES_MAX),
    RpcRoute(topics.RPC_STATUS, (Explain, StatusRequest), COMMAND_BYTES_MAX),
    # Whoever submits says what workers run: apart from steering, so that nobody gets it with that.
    RpcRoute(topics.RPC_SUBMIT, (Submit,), MESSAGE_BYTES_MAX),
    RpcRoute(topics.RPC_ADMIN, (Control, Stop), COMMAND_BYTES_MAX),
)
RPC_ROUTES: dict[str, RpcRoute] = {route.topic.key: route for route in _ALL}
"""Key -> what may come on it."""

_UNIONS: dict[str, Any] = {key: reduce(or_, route.requests) for key, route in RPC_ROUTES.items()}
_ROUTE_OF: dict[type[Request], RpcRoute] = {
    kind: route for route in _ALL for kind in route.requests
}
_NAMED: dict[str, type[Request]] = {str(kind.__struct_config__.tag): kind for kind in _ROUTE_OF}


def route_key(request: Request) -> str:
    """Key that ``request`` is sent to; the conductor refuses it on any other."""
    return _ROUTE_OF[type(request)].topic.key


def bytes_max(key: str) -> int:
    """Largest request on ``key`` [bytes]; on none: from inside the process."""
    return RPC_ROUTES[key].bytes_max if key in RPC_ROUTES else MESSAGE_BYTES_MAX


def read_request(payload: bytes, key: str) -> Request:
    """The request that came on ``key``; empty: from inside the process, where all may.

    Raises:
        WireError: too large for this key, none that may come on it, or no request at all.
    """
    route = RPC_ROUTES.get(key)
    if route is None:
        return decode(payload, Request)
    if PEEK_BYTES < len(payload) <= route.bytes_max:
        _check_verb(payload, route)
    try:
        request: Request = decode(payload, _UNIONS[key], route.bytes_max)
        return request
    except WireError:
        if len(payload) <= route.bytes_max:
            _check_verb(payload, route)
        raise


class _Verb(Struct):
    """What names a request; the rest is skipped, not built."""

    verb: str = ""


_verb_of = Decoder(_Verb).decode


def _check_verb(payload: bytes, route: RpcRoute) -> None:
    """Raise WireError for a request that belongs on another key."""
    try:
        kind = _NAMED.get(_verb_of(payload).verb)
    except (MsgspecError, RecursionError, ValueError):
        return  # no request at all: its decoder says why
    if kind is not None and _ROUTE_OF[kind] is not route:
        raise WireError(
            f"{kind.__name__} came on {route.topic.key}; send it to {_ROUTE_OF[kind].topic.key}"
        )
