"""Which key a request to the conductor goes to: one for each role that may make it."""

from __future__ import annotations

from schemas import topics
from schemas.messages import (
    Beat,
    Bye,
    Control,
    Explain,
    Hello,
    Next,
    Request,
    StatusRequest,
    Stop,
    Submit,
)
from schemas.topics import Topic

DOORS: dict[type[Request], Topic] = {
    Hello: topics.RPC_WORKER,
    Next: topics.RPC_WORKER,
    Beat: topics.RPC_WORKER,
    Bye: topics.RPC_WORKER,
    Explain: topics.RPC_STATUS,
    StatusRequest: topics.RPC_STATUS,
    # Whoever submits says what workers run: apart from steering, so that nobody gets it with that.
    Submit: topics.RPC_SUBMIT,
    Control: topics.RPC_ADMIN,
    Stop: topics.RPC_ADMIN,
}


def door(request: Request) -> str:
    """Key that ``request`` is sent to; the conductor refuses it on any other."""
    return DOORS[type(request)].key
